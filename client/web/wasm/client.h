#pragma once
// A client for a page: the core, its messages from and to the page (src/messages.ts), and what the page's painter shows. Times are
// milliseconds since 1970, on one clock.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/core/conversation/reconnector.h"
#include "client/core/ground/held_edits.h"
#include "client/core/hands/brush.h"
#include "client/core/hands/clock_bar.h"
#include "client/core/hands/editing.h"
#include "client/core/mesh/follower.h"
#include "client/web/wasm/painting.h"
#include "client/web/wasm/worker.h"
#include "common/wire/messages.h"

namespace ridgecast::page {

using Instant = core::Reconnector::Instant;
using Milliseconds = std::chrono::duration<double, std::milli>;

inline constexpr std::size_t kMaxPoses = 256;            // without an answer; older ones are forgotten
inline constexpr std::uint32_t kMaxCandidates = 20'000;  // of an iteration

inline Instant instantOf(double now) { return Instant(std::chrono::duration_cast<Instant::duration>(Milliseconds(now))); }
inline lattice::Step stepsOf(double v) { return static_cast<lattice::Step>(std::llround(v)); }

class Client {
 public:
  // Starts or restarts; what is held is resumed. `server`: as core::parseUrl.
  void start(const std::string& server, const std::string& name, double threshold, std::uint32_t random) {
    settings_.metric = wire::Metric::kPixels;
    settings_.threshold = threshold;
    wire::Hello hello{.clientName = name, .settings = settings_, .points = true, .members = true, .clock = true, .near = 24};
    const auto parsed = core::parseUrl(server);
    server_ = parsed ? *parsed : core::Url{.host = server};
    server_.token = "the page's";  // so that the line says where it may be shown
    const auto scheme = server.find("://");
    host_ = scheme == server.npos ? server : server.substr(scheme + 3);
    line_.emplace(server_, std::move(hello), core::Returns::kAlways, random);
    line_->skipSteps(true);
    if (camera_) sendPose(0);
    hasEntered_ = false;
  }
  void stop() { line_.reset(); }

  // ---- the line ----

  // Does what is due; milliseconds until the next call without an event, below 0: never.
  double step(double now) {
    if (!line_) return -1;
    if (const auto to = line_->dial(instantOf(now))) dial(*to);
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
    settings_.candidates = wanted ? kMaxCandidates : 0;
    change();
    if (!wanted) showNoCandidates();
  }
  void setThreshold(double pixels) {
    settings_.threshold = pixels;
    change();
  }
  // A program's.
  void edit(std::uint32_t id, std::string operation) {
    editing_->make(std::move(operation), [id](const Outcome<std::uint64_t>& made) {
      tell(kind("edit answer")("id", id)("number", made ? *made : 0)("refusal", made ? "" : made.error().message));
    });
  }
  void setClock(double rate, double microseconds, double now) {
    set(core::setTo(rate > 0, rate > 0 ? rate : bar_.rate, static_cast<std::uint64_t>(microseconds)), now);
  }
  // A user's actions on the session's clock.
  enum class Drive : std::uint32_t { kToggle, kSlower, kFaster, kBack, kAhead, kTo };
  void drive(Drive drive, double microseconds, double now) {
    hearClock(now);
    if (drive == Drive::kToggle) set(core::toggled(bar_), now);
    if (drive == Drive::kSlower) set(core::faster(bar_, false), now);
    if (drive == Drive::kFaster) set(core::faster(bar_, true), now);
    if (drive == Drive::kBack) set(core::movedBy(bar_, -core::kClockSkip), now);
    if (drive == Drive::kAhead) set(core::movedBy(bar_, core::kClockSkip), now);
    if (drive == Drive::kTo) set(core::movedTo(bar_, static_cast<std::uint64_t>(microseconds)), now);
  }
  // A user's edits: core::Editing's functions, in its order.
  enum class Act : std::uint32_t { kChoose, kPaint, kWiden, kRest, kUndo, kEndRoad };
  void act(Act act, double by) {
    if (act == Act::kChoose) editing_->choose(static_cast<core::Tool>(by));
    if (act == Act::kPaint) editing_->paint(static_cast<std::uint32_t>(by));
    if (act == Act::kWiden) editing_->widen(by);
    if (act == Act::kRest) editing_->rest();
    if (act == Act::kUndo) editing_->undo();
    if (act == Act::kEndRoad) editing_->endRoad();
    tellEditing();
  }
  // What lies under the brush, which may be used there.
  void brush(const ground::Ray& ray, bool uses) {
    Object out = kind("touched");
    const auto at = core::touched(follower_.scene(), ray);
    if (uses && !at) say("There is no ground.");
    if (uses && at) {
      editing_->use(*at);
      tellEditing();
    }
    if (at) {
      const core::Outline outline = core::outlineOf(follower_.scene(), *at, editing_->radius(), editing_->corners());
      const auto listed = [](const std::vector<core::Spot>& spots) {
        List list;
        for (const core::Spot& spot : spots) list(Object()("x", spot.at.x)("z", spot.at.z)("y", spot.y));
        return list;
      };
      out("touched", Object()("outline", listed(outline.around))("line", listed(outline.line)));
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
  void dial(const core::Url& to) {
    const bool isElsewhere = to.host != server_.host || to.port != server_.port || to.secure != server_.secure;
    const std::string origin = isElsewhere ? (to.secure ? "wss://" : "ws://") + to.where() : "";
    pageDial(origin.data(), origin.size(), !to.token.empty());
  }
  void hangUp(const std::string& why) { pageHangUp(why.data(), why.size()); }
  void change() {
    if (line_) line_->change(settings_);
  }
  void sendPose(double now) {
    if (!line_) return;
    poses_.emplace_back(++sequence_, now);
    if (poses_.size() > kMaxPoses) poses_.pop_front();
    if (const core::Wrong wrong = line_->send({sequence_, *camera_})) hangUp(*wrong);
  }

  // A line to this or another world has begun.
  void enter(double now) {
    const bool isFirst = !line_->hasReturned();
    const wire::World& coming = isFirst ? conversation().world() : line_->coming();
    if (std::exchange(contentHash_, coming.contentHash) != coming.contentHash) {
      follower_ = {};
      follower_.follow({.points = true, .triangles = coming.settings.triangleBudget});
    }
    const auto held = follower_.enter(coming);
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
    told("threshold", world.settings.threshold)("takesEdits", world.revision >= 4);
    if (world.heightMap) {
      const lattice::Area area = world.heightMap->area();
      told("map", Object()("x0", area.x0)("z0", area.z0)("x1", area.x1)("z1", area.z1));
    }
    tell(kind("world")("world", told));
    const std::string here = host_ + ' ' + world.session;
    if (const std::string before = std::exchange(editingOf_, here); !before.empty() && before != here) {
      bar_ = {};
      editing_->leave();
      editing_.emplace(editor());
    }
    editing_->connected();
    tellEditing();
  }

  void take(core::Received&& received, double now) {
    const wire::Iteration& iteration = received.iteration;
    const core::Follower::Answer answer = follower_.apply(iteration);
    const core::Scene& scene = follower_.scene();
    figures_.bytes += received.bytes;
    figures_.decoded += scene.came();
    ++figures_.hashes;
    if (answer.resend) ++figures_.mismatches, conversation().resend(*answer.resend);
    if (edits_) edits_->know(iteration.edit);
    if (settings_.candidates != 0 && iteration.candidates) {
      figures_.candidates = iteration.candidates->size();
      painting_.candidates(iteration);
    }
    const bool holdsNothing = scene.iteration() == 0;
    const std::vector<lattice::LeafAddress> gone(scene.gone().begin(), scene.gone().end());
    painting_.change(scene, gone, holdsNothing, Painting::Taken{entered_, answer.acknowledge});
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
    if (std::exchange(seen_.members, heard.roster().version()) != heard.roster().version()) tellMembers(heard.roster());
    if (std::exchange(seen_.clock, heard.clock().version()) != heard.clock().version()) {
      hearClock(now);
      if (heard.clock().isSettled()) tellClock(now);
      if (const std::string& notice = heard.clock().said().notice; !notice.empty()) say(notice);
    }
    if (!edits_) return;
    const core::EditsFound came = heard.takeEditsFound();
    const auto put = [&](const auto& answers) {
      for (const auto& answer : answers)
        if (const auto done = edits_->put(answer); !done) return hangUp(done.error().message), false;
      return true;
    };
    if (put(came.found) && put(came.squares) && !(came.found.empty() && came.squares.empty())) followEdits();
  }

  void tellMembers(const core::Roster& roster) {
    List members;
    for (const auto& [camera, other] : roster.others()) {
      Object member;
      member("camera", std::to_string(camera))("name", core::nameOf(other.member));
      if (other.member.moved) {
        const camera::Pose& pose = other.member.moved->pose.camera.pose;
        member("at", Object()("x", pose.x)("y", pose.y)("z", pose.z));
      }
      members(member);
    }
    tell(kind("members")("members", members)("others", roster.count()));
  }

  core::Editing::To editor() {
    return {[this](const wire::Edit& edit) {
              if (!isConnected()) return;
              conversation().ask(edit, [this, id = edit.id](const Outcome<wire::EditAnswer>& answer) {
                if (isEnding_) return;  // it is sent again over the next line
                editing_->hear(id, answer ? Outcome<std::uint64_t>(answer->number) : Outcome<std::uint64_t>(answer.error()));
                tellEditing();
              });
            },
            say};
  }
  void tellEditing() {
    tell(kind("editing")("editing", Object()("tool", static_cast<std::uint32_t>(editing_->tool()))("words", editing_->words())(
                                        "mayUndo", editing_->mayUndo())));
  }
  static void say(const std::string& sentence) { tell(kind("notice")("sentence", sentence)); }

  void hearClock(double now) {
    if (isConnected() && conversation().clock().version() > 0)
      bar_.hear(conversation().clock(), conversation().world(), conversation().roster().others(), instantOf(now));
  }
  void set(const wire::SetClock& set, double now) {
    const bool isUnknown = isConnected() && !bar_.known;  // the server has told of no clock yet; it says what it makes of this
    if (const std::string why = isUnknown ? "" : (isConnected() ? bar_ : core::ClockBar()).refusal(set); !why.empty()) return say(why);
    for (const wire::SetClock& one : {set, wire::SetClock{.own = false}})
      if (const core::Wrong wrong = conversation().setClock(one)) return hangUp(*wrong);
    bar_.goOn(set);
    if (!isUnknown) tellClock(now);
  }
  void tellClock(double now) {
    tell(kind("clock")("clock", Object()("time", bar_.time)("at", now)("runs", bar_.runs)("rate", bar_.rate)("end", bar_.end)(
                                    "driver", bar_.driver)("jumps", bar_.jumps)));
  }

  void tellFigures() {
    const Figures& f = figures_;
    tell(kind("figures")("figures", Object()("iteration", f.iteration)("triangles", follower_.scene().triangles())(
                                        "leaves", follower_.scene().index().size())("settled", f.isSettled && hasAllEdits())(
                                        "edit", f.edit)("pose", number_)("changes", painting_.changes())("hashOk", f.agrees)(
                                        "effectiveThreshold", f.threshold)("bytes", f.bytes)("decoded", f.decoded)("hashes", f.hashes)(
                                        "mismatches", f.mismatches)("candidates", f.candidates)("decodeMs", 0)("latencyMs", f.latency)));
  }
  void tellGround() {
    if (!camera_) return;
    if (const auto metres = follower_.scene().height({camera_->pose.x, camera_->pose.z})) tell(kind("ground")("metres", *metres));
  }

  // Milliseconds since the answered pose was sent; 0: unknown.
  double answered(std::uint64_t sequence, double now) {
    double since = 0;
    for (; !poses_.empty() && poses_.front().first <= sequence; poses_.pop_front())
      since = poses_.front().first == sequence ? now - poses_.front().second : 0;
    return since;
  }

  void showNoCandidates() {
    painting_.noCandidates();
    if (std::exchange(figures_.candidates, 0) != 0) tellFigures();
  }

  // ---- edited ground ----

  bool hasAllEdits() const { return !edits_ || edits_->complete(); }

  // Requests missing edits around the camera, and shows those that came.
  void followEdits() {
    if (!edits_ || !camera_ || !isConnected()) return;
    edits_->moveTo({camera_->pose.x, camera_->pose.z});
    const auto [find, want] = edits_->take();
    if (find) conversation().find(*find);
    if (!want.squares.empty()) conversation().want(want);
    const std::size_t before = painting_.changes();
    const bool hadAll = std::exchange(figures_.hadAllEdits, hasAllEdits());
    painting_.squares(&*edits_);
    if (figures_.iteration != 0 && (painting_.changes() != before || hadAll != figures_.hadAllEdits)) tellFigures();
  }

  struct Figures {
    std::uint64_t iteration = 0, edit = 0, bytes = 0, decoded = 0, hashes = 0, mismatches = 0;
    std::size_t candidates = 0;
    bool isSettled = false, agrees = false, hadAllEdits = true;
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
  core::Url server_;                                    // of start()
  std::string host_;                                    // what sentences call it
  std::optional<core::Editing> editing_{editor()};      // never empty
  std::string editingOf_;                               // which host and session
  core::ClockBar bar_;
  std::optional<std::uint64_t> contentHash_;  // of what is held
  core::Follower follower_;
  std::optional<core::HeldEdits> edits_;  // of a world that tells them
  std::string editsOf_;                   // which
  Figures figures_;
  Seen seen_;
  Painting painting_;
};

}  // namespace ridgecast::page
