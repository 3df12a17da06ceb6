#pragma once
// A client for a page: the core, what the page says to it and hears of it (src/messages.ts), and what its painter shows. Times are
// milliseconds since 1970, on one clock.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "client/core/conversation/reconnector.h"
#include "client/core/ground/held_edits.h"
#include "client/core/mesh/follower.h"
#include "client/core/mesh/mesh_ground.h"
#include "client/web/wasm/painting.h"
#include "client/web/wasm/worker.h"
#include "common/wire/messages.h"

namespace ridgecast::page {

using Instant = core::Reconnector::Instant;
using Milliseconds = std::chrono::duration<double, std::milli>;

inline constexpr std::size_t kMostPoses = 256;            // without an answer; older ones are forgotten
inline constexpr std::uint32_t kMostCandidates = 20'000;  // of an iteration
inline constexpr int kAround = 96;                        // places of a brush's outline
inline constexpr double kApart = 4;                       // metres between those of a line
inline constexpr int kMostOfPiece = 256;                  // of them, in a piece of a line

inline Instant instantOf(double now) { return Instant(std::chrono::duration_cast<Instant::duration>(Milliseconds(now))); }
struct Place {
  lattice::Point at;
  double y = 0;  // metres
};
inline Object objectOf(const Place& place) { return Object()("x", place.at.x)("z", place.at.z)("y", place.y); }
inline lattice::Step stepsOf(double v) { return static_cast<lattice::Step>(std::llround(v)); }

class Client {
 public:
  // Begins, or begins anew; what is held is resumed.
  void start(const std::string& host, const std::string& name, double threshold, std::uint32_t random) {
    settings_.metric = wire::Metric::kPixels;
    settings_.threshold = threshold;
    wire::Hello hello{.clientName = name, .settings = settings_, .points = true, .members = true, .clock = true};
    core::Url url;
    url.host = host.substr(0, host.rfind(':'));
    url.port = host.substr(host.rfind(':') + 1);
    line_.emplace(std::move(url), std::move(hello), core::Returns::kAlways, random);
    line_->skipSteps(true);
    if (camera_) sendPose(0);
    hasEntered_ = false;
  }
  void stop() { line_.reset(); }

  // ---- the line ----

  // Whatever is to be done; milliseconds until it is to be called again without an event, below 0: never.
  double step(double now) {
    if (!line_) return -1;
    if (line_->dial(instantOf(now))) pageDial();
    while (const auto frame = line_ ? line_->next(instantOf(now)) : std::nullopt) pageSend(frame->data(), frame->size());
    const auto due = line_ ? line_->due() : std::nullopt;
    return due ? std::max(0.0, std::ceil(Milliseconds(*due - instantOf(now)).count())) : -1;
  }
  void opened() {
    const std::string hello = line_->opened();
    pageSend(hello.data(), hello.size());
  }
  bool isGreeted() const { return line_ && line_->isGreeted(); }
  bool comesBack() const { return line_ && line_->comesBack(); }
  void closed(const std::string& why, double now) {
    isEnding_ = true;
    line_->ended({why}, instantOf(now));
    isEnding_ = false;
    tellMembers({});
  }
  void hurry(double now) {
    if (line_) line_->hurry(instantOf(now));
  }

  void heard(std::span<const std::uint8_t> frame, double now) {
    if (const core::Wrong wrong = line_->heard(frame, instantOf(now))) return hangUp(*wrong);
    if (line_->hasReturned() || (isGreeted() && !hasEntered_)) enter(now);
    if (line_->lost()) return;
    while (auto received = conversation().receive()) take(std::move(*received), now);
    listen(now);
  }

  // ---- what the page says ----

  void pose(const camera::Camera& camera, std::uint32_t number, double now) {
    camera_ = camera;
    number_ = number;
    sendPose(now);
    followEdits();
    tellGround();
  }
  void wantCandidates(bool wanted) {
    settings_.candidates = wanted ? kMostCandidates : 0;
    change();
    if (!wanted) showNoCandidates();
  }
  void setThreshold(double pixels) {
    settings_.threshold = pixels;
    change();
  }
  void edit(std::uint32_t id, std::string key, std::string operation) {
    if (!isConnected()) return;
    conversation().ask(wire::Edit{0, std::move(key), std::move(operation)}, [this, id](const Outcome<wire::EditAnswer>& answer) {
      if (isEnding_) return;  // the page sends it again over the next line
      tell(kind("edit answer")("id", id)("number", answer ? answer->number : 0)("refusal", answer ? "" : answer.error().message));
    });
  }
  void setClock(double rate, double microseconds, std::uint32_t number) {
    if (!isConnected()) return;
    clockSet_ = number;
    const auto mode = rate == 0 ? wire::ClockMode::kStepped : rate == 1 ? wire::ClockMode::kRealTime : wire::ClockMode::kScaled;
    for (const wire::SetClock& set :
         {wire::SetClock{true, mode, rate, static_cast<std::uint64_t>(microseconds)}, wire::SetClock{.own = false}})
      if (const core::Wrong wrong = conversation().setClock(set)) return hangUp(*wrong);
  }
  // What lies under a brush: where the ray meets the mesh, a circle around it, and the line of a road that ends there.
  void brush(std::uint32_t number, const ground::Ray& ray, double radius, std::span<const double> line) {
    Object out = kind("touched")("number", number);
    if (const auto hit = core::cast(follower_.scene(), ray)) {
      const double steps = hit->distance * lattice::kStepsPerMetre / std::hypot(ray.directionX, ray.directionY, ray.directionZ);
      const Place at{{ray.x + stepsOf(ray.directionX * steps), ray.z + stepsOf(ray.directionZ * steps)},
                     ray.y + ray.directionY * steps * lattice::kMetresPerStep};
      const auto lay = [&](double x, double z) {
        const lattice::Point p{at.at.x + stepsOf(x), at.at.z + stepsOf(z)};
        return objectOf({p, follower_.scene().height(p).value_or(at.y)});
      };
      List outline, between;
      for (int k = 0; k < kAround; ++k) {
        const double angle = 2 * std::numbers::pi * k / kAround, r = radius * lattice::kStepsPerMetre;
        outline(lay(r * std::cos(angle), r * std::sin(angle)));
      }
      // Each corner as x and z from the place under the brush, at which the line ends.
      for (std::size_t k = 0; k + 1 < line.size(); k += 2) {
        const double x = line[k] - static_cast<double>(at.at.x), z = line[k + 1] - static_cast<double>(at.at.z);
        const bool isLast = k + 3 >= line.size();
        const double dx = (isLast ? 0 : line[k + 2] - static_cast<double>(at.at.x)) - x,
                     dz = (isLast ? 0 : line[k + 3] - static_cast<double>(at.at.z)) - z;
        const int pieces = std::min(kMostOfPiece, static_cast<int>(std::ceil(std::hypot(dx, dz) * lattice::kMetresPerStep / kApart)));
        for (int p = 0; p < pieces; ++p) between(lay(x + dx * p / pieces, z + dz * p / pieces));
        if (isLast) between(objectOf(at));
      }
      out("touched", Object()("at", objectOf(at))("outline", outline)("line", between));
    }
    tell(out);
  }

  // Metres, of the mesh; NaN where it has none.
  double height(lattice::Point at) const { return follower_.scene().height(at).value_or(std::numeric_limits<double>::quiet_NaN()); }

  // The painter has taken a change.
  void taken() {
    const auto taken = painting_.taken();
    if (taken && taken->line == entered_ && isConnected()) conversation().acknowledge(taken->acknowledge);
  }

 private:
  core::Conversation& conversation() { return line_->conversation(); }
  bool isConnected() { return line_ && hasEntered_ && !line_->lost(); }
  void hangUp(const std::string& why) { pageHangUp(why.data(), why.size()); }
  void change() {
    if (line_) line_->change(settings_);
  }
  void sendPose(double now) {
    if (!line_) return;
    poses_.emplace_back(++sequence_, now);
    if (poses_.size() > kMostPoses) poses_.pop_front();
    if (const core::Wrong wrong = line_->send({sequence_, *camera_})) hangUp(*wrong);
  }

  // A line to this or another world has begun.
  void enter(double now) {
    const bool isFirst = !line_->hasReturned();
    const wire::World& coming = isFirst ? conversation().world() : line_->coming();
    if (coming.contentHash != contentHash_ || !hasMesh_) {
      follower_ = {};
      follower_.follow({.points = true, .triangles = coming.settings.triangleBudget});
    }
    contentHash_ = coming.contentHash;
    hasMesh_ = true;
    const auto held = follower_.resume();
    if (isFirst)
      for (const wire::Resume& part : held) conversation().resume(part);
    else
      line_->goOn(held);
    hasEntered_ = true;
    ++entered_;
    seen_ = {};
    poses_.clear();
    if (camera_) poses_.emplace_back(sequence_, now);
    showNoCandidates();
    if (held.empty()) painting_.change(follower_.scene(), {}, true);
    enterWorld(conversation().world());
  }

  void enterWorld(const wire::World& world) {
    const std::string source = world.heightMap ? "" : world.terrainSource;  // which needs samples that the page does not ask for
    const std::string of = !source.empty() && world.revision >= 5 ? text::hexadecimal(world.contentHash) + world.session : "";
    if (edits_ && of == editsOf_) {
      edits_->reconnected(world.edit);
    } else {
      edits_.reset();
      painting_.squares(nullptr);
      if (!of.empty()) edits_.emplace(world.horizon);
      if (edits_) edits_->know(world.edit);
      editsOf_ = of;
    }
    paint(kind("world")("source", source)("seed", world.seed)("horizon", world.horizon));
    Object told;
    told("terrain", world.terrainName)("seed", world.seed)("session", world.session)("camera", std::to_string(world.camera));
    told("lacks", !source.empty()   ? ""
                  : world.heightMap ? "This page has no samples of a height map"
                                    : "The server keeps the terrain to itself");
    told("threshold", world.settings.threshold)("takesEdits", world.revision >= 4)("jumpsClock", world.revision >= 6);
    if (world.heightMap) {
      const lattice::Area area = world.heightMap->area();
      told("map", Object()("x0", area.x0)("z0", area.z0)("x1", area.x1)("z1", area.z1));
    }
    tell(kind("world")("world", told));
  }

  void take(core::Received&& received, double now) {
    const wire::Iteration& iteration = received.iteration;
    const core::Follower::Answer answer = follower_.apply(iteration);
    const core::Scene& scene = follower_.scene();
    if (!answer.wrong) line_->applied();
    figures_.bytes += received.bytes;
    figures_.decoded += scene.came();
    ++figures_.hashes;
    if (answer.resend) ++figures_.mismatches, conversation().resend(*answer.resend);
    if (edits_) edits_->know(iteration.edit);
    if (settings_.candidates != 0 && iteration.candidates) {
      candidates_ = iteration.candidates->size();
      painting_.candidates(iteration);
    }
    const bool holdsNothing = scene.iteration() == 0;
    painting_.change(scene, iteration.gone, holdsNothing, Painting::Taken{entered_, answer.acknowledge});
    const double latency = answered(iteration.poseSequence, now);
    figures_.iteration = iteration.number;
    figures_.edit = iteration.edit;
    figures_.isSettled = iteration.settled && !answer.wrong && poses_.empty();
    figures_.agrees = !answer.wrong;
    figures_.threshold = iteration.figures.effectiveThreshold;
    figures_.latency = latency;
    tellFigures();
    followEdits();
    tellGround();
  }

  // What else has been heard.
  void listen(double now) {
    core::Conversation& heard = conversation();
    if (std::exchange(seen_.settings, heard.granted()) != heard.granted()) tell(kind("granted")("threshold", heard.granted().threshold));
    if (std::exchange(seen_.members, heard.roster().version()) != heard.roster().version()) tellMembers(heard.roster().others());
    if (std::exchange(seen_.clock, heard.clock().version()) != heard.clock().version()) tellClock(heard.clock(), now);
    if (!edits_) return;
    const core::EditsFound came = heard.takeEditsFound();
    const auto put = [&](const auto& answers) {
      for (const auto& answer : answers)
        if (const auto done = edits_->put(answer); !done) return hangUp(done.error().message), false;
      return true;
    };
    if (put(came.found) && put(came.squares) && !(came.found.empty() && came.squares.empty())) followEdits();
  }

  void tellMembers(const std::map<std::uint64_t, core::Other>& others) {
    List members;
    for (const auto& [camera, other] : others) {
      Object member;
      member("camera", std::to_string(camera))("name", other.member.name);
      if (other.member.moved) {
        const camera::Pose& pose = other.member.moved->pose.camera.pose;
        member("at", Object()("x", pose.x)("y", pose.y)("z", pose.z));
      }
      members(member);
    }
    tell(kind("members")("members", members));
  }

  void tellClock(const core::SessionClock& clock, double now) {
    const wire::Clock& said = clock.said();
    tell(kind("clock")("clock", Object()("time", clock.time(instantOf(now)))("at", now)("rate", said.rate)("end", said.end)(
                                    "owner", std::to_string(said.owner))("answers", clock.isSettled() ? clockSet_ : 0)));
    if (!said.notice.empty()) tell(kind("notice")("sentence", said.notice));
  }

  void tellFigures() {
    const Figures& f = figures_;
    tell(kind("figures")("figures", Object()("iteration", f.iteration)("triangles", follower_.scene().triangles())(
                                        "leaves", follower_.scene().index().size())("settled", f.isSettled && hasAllEdits())(
                                        "edit", f.edit)("pose", number_)("changes", painting_.changes())("hashOk", f.agrees)(
                                        "effectiveThreshold", f.threshold)("bytes", f.bytes)("decoded", f.decoded)("hashes", f.hashes)(
                                        "mismatches", f.mismatches)("candidates", candidates_)("decodeMs", 0)("latencyMs", f.latency)));
  }
  void tellGround() {
    if (!camera_) return;
    if (const auto metres = follower_.scene().height({camera_->pose.x, camera_->pose.z})) tell(kind("ground")("metres", *metres));
  }

  // Milliseconds since the pose that is answered was sent; 0: unknown.
  double answered(std::uint64_t sequence, double now) {
    double since = 0;
    for (; !poses_.empty() && poses_.front().first <= sequence; poses_.pop_front())
      since = poses_.front().first == sequence ? now - poses_.front().second : 0;
    return since;
  }

  void showNoCandidates() {
    painting_.noCandidates();
    if (std::exchange(candidates_, 0) != 0) tellFigures();
  }

  // ---- edited ground ----

  bool hasAllEdits() const { return !edits_ || edits_->complete(); }

  // Asks for what is lacking of the edits around the camera, and shows what has come.
  void followEdits() {
    if (!edits_ || !camera_ || !isConnected()) return;
    edits_->moveTo({camera_->pose.x, camera_->pose.z});
    const auto [find, want] = edits_->take();
    if (find) conversation().find(*find);
    if (!want.squares.empty()) conversation().want(want);
    const std::size_t before = painting_.changes();
    const bool hadAll = std::exchange(hadAllEdits_, hasAllEdits());
    painting_.squares(&*edits_);
    if (figures_.iteration != 0 && (painting_.changes() != before || hadAll != hadAllEdits_)) tellFigures();
  }

  struct Figures {
    std::uint64_t iteration = 0, edit = 0, bytes = 0, decoded = 0, hashes = 0, mismatches = 0;
    bool isSettled = false, agrees = false;
    double threshold = 0, latency = 0;
  };
  struct Seen {
    wire::Settings settings;
    std::uint64_t members = 0, clock = 0;
  };

  std::optional<core::Reconnector> line_;
  bool hasEntered_ = false, isEnding_ = false;
  std::uint64_t entered_ = 0;  // lines
  wire::Settings settings_;
  std::optional<camera::Camera> camera_;
  std::uint32_t number_ = 0;                            // the page's, of the newest pose
  std::uint64_t sequence_ = 0;                          // the stream's
  std::deque<std::pair<std::uint64_t, double>> poses_;  // without an answer: their sequences, and when they were sent
  std::uint32_t clockSet_ = 0;
  bool hasMesh_ = false;
  std::uint64_t contentHash_ = 0;  // of what is held
  core::Follower follower_;
  std::optional<core::HeldEdits> edits_;  // of a world that tells them
  std::string editsOf_;                   // which
  bool hadAllEdits_ = true;
  Figures figures_;
  Seen seen_;
  std::size_t candidates_ = 0;
  Painting painting_;
};

}  // namespace ridgecast::page
