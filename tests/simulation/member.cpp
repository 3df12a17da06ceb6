#include "tests/simulation/member.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <utility>

#include "common/edits/author.h"
#include "common/edits/edited_terrain.h"
#include "server/http/map_tiles.h"
#include "server/map/mercator.h"
#include "tests/simulation/world.h"
#include "tests/support/bytes.h"
#include "tests/support/random_edits.h"

namespace ridgecast::simulation {

using namespace std::chrono_literals;

namespace {
const std::string kLost = "lost";  // why requests have no answer
}  // namespace

Member::Member(std::string name, Cluster& cluster, Truth& truth, SimulatedTimer& timer, Random& random, const Nature& nature,
               lattice::Point near)
    : name_(std::move(name)),
      cluster_(cluster),
      server_(&cluster[0]),
      truth_(truth),
      timer_(timer),
      random_(random),
      nature_(nature),
      editor_(edits::toText({name_, nature.hello.clientName}), truth, random),
      poster_(name_, nature.session, cluster, truth, timer, random) {
  camera_.pose.x = near.x + static_cast<lattice::Step>(random_() % 60'000);
  camera_.pose.z = near.z + static_cast<lattice::Step>(random_() % 60'000);
  // High up a mesh has a quarter of the leaves, and all that is judged here happens the same.
  const double altitude = 30 + static_cast<double>(random_() % 5 == 0 ? random_() % 400 : 4000 + random_() % 6000);
  camera_.pose.y = server_->terrain()->height({camera_.pose.x, camera_.pose.z}) + altitude;
  site_ = {camera_.pose.x, camera_.pose.z};
  camera_.pose.pitch = -0.4;
  camera_.projection = {.verticalFov = 1.0, .width = 160, .height = 90};
  heading_ = static_cast<double>(random_() % 628) / 100;
}

// ---- the line ----

void Member::join() {
  client_.emplace(core::Url{.session = nature_.session}, nature_.hello, core::Returns::kToItsWorld, static_cast<std::uint32_t>(random_()));
  threshold_ = nature_.hello.settings.threshold;
  follower_ = {};
  editor_.forget();
  flush();
}

void Member::open() {
  const auto take = [this, number = ++lines_](const std::string& frame) {
    if (line_ && number == lines_) hear(frame);
  };
  const Duration entering = std::chrono::milliseconds(random_() % 2 == 0 ? 0 : random_() % 400);
  server_ = &cluster_.next();
  const auto opened = [this, number = lines_](std::shared_ptr<Line> line) {
    if (number != lines_) return line ? line->cut({}) : void();  // it has left
    line_ = std::move(line);
    opened_ = timer_.now();
    if (!line_) return ended();  // the server does not run, makes the session, or has not yet noticed which lines are lost
    line_->say(client_->opened());
  };
  Line::open(*server_, nature_.session, name_, timer_, nature_.way, take, opened, entering);
}

void Member::ended() {
  ++lines_;
  line_.reset();
  leaving_ = false;
  wakes_.reset();
  editor_.lost();
  client_->ended({kLost}, timer_.now());
  EXPECT_FALSE(client_->otherWorld() && cluster_.isCalm()) << name_;
  if (client_->comesBack())
    flush();
  else
    forget();  // it has not seen its world yet, or has come to a server that is behind
}

void Member::lose(Duration unheard) {
  if (!line_) return;
  line_->cut(unheard);
  ended();
}

void Member::mute(Duration noticed) {
  if (!line_) return;
  line_->cut(2 * noticed);
  later(timer_.now() + noticed, [this, noticed] { lose(noticed); });
}

void Member::stall(Duration time) {
  if (line_) line_->stall(time);
}

void Member::fall(const Server& of) {
  poster_.fall(of);
  if (&of != server_) return;
  later(timer_.now() + nature_.way.delay + 2ms, [this] { lose({}); });
}

void Member::leave(Duration unheard) {
  lose(unheard);
  ++lines_;
  wakes_.reset();
  forget();
}

void Member::forget() {
  ++lives_;
  client_.reset();
  begun_ = thinks_ = false;
}

// A line when it is time for one; on it one frame at a time, as a socket takes them.
void Member::flush() {
  if (!client_ || leaving_) return;
  if (client_->dial(timer_.now())) return open();
  while (line_) {
    const auto frame = client_->next(timer_.now());
    if (!frame) break;
    line_->say(*frame);
    if (nature_.leaving == Duration()) continue;
    leaving_ = true;
    return later(timer_.now() + nature_.leaving, [this] {
      leaving_ = false;
      flush();
    });
  }
  const std::optional<Time> due = client_->due();
  if (!due || (wakes_ && *wakes_ <= *due)) return;
  wakes_ = due;
  later(*due, [this] {
    wakes_.reset();
    flush();
  });
}

void Member::later(Time when, std::function<void()> act) {
  timer_.at(when, [this, act = std::move(act), number = lines_] {
    if (number == lines_) act();
  });
}

void Member::say(const core::Wrong& wrong) {
  EXPECT_FALSE(wrong) << name_ << ": " << *wrong;
  flush();
}

// ---- what it does ----

void Member::pose() {
  settled_ = false;
  ++sequence_;
  say(client_->send({sequence_, camera_, std::vector<std::uint8_t>(nature_.stateBytes, static_cast<std::uint8_t>(sequence_))}));
}

void Member::fly(double metres) {
  if (!begun_) return;
  if (isLockstep() && sequence_ - lastPose_ >= 8) return;  // as a client does that waits for its iterations
  heading_ += static_cast<double>(random_() % 100) / 500 - 0.1;
  camera_.pose.yaw = heading_;
  camera_.pose.x -= static_cast<lattice::Step>(metres * std::sin(heading_) * lattice::kStepsPerMetre);
  camera_.pose.z -= static_cast<lattice::Step>(metres * std::cos(heading_) * lattice::kStepsPerMetre);
  pose();
}

void Member::insist() {
  if (connected() && isLockstep() && lastPose_ == sequence_ && !digests()) pose();
}

void Member::ask(bool much) {
  if (!connected() || questions_ >= wire::kMaxQueries + 8) return;  // the last wait until others are answered
  wire::Query query;
  constexpr std::int64_t kNear = 50 * lattice::kStepsPerMetre;
  const auto near = [&](lattice::Step middle) { return middle - kNear + static_cast<lattice::Step>(random_() % (2 * kNear)); };
  switch (much ? 2 : random_() % 4) {
    case 0:
      query.kind = wire::QueryKind::kRays;
      for (std::uint64_t n = random_() % 8; n > 0; --n)
        query.rays.push_back({near(site_.x), near(site_.z), camera_.pose.y, 0.1, -1, 0.2 * static_cast<double>(n), 5000});
      break;
    case 3:
      return random_() % 16 == 0 ? askMap() : askGround();
    case 1:
      query.kind = wire::QueryKind::kNormals;
      [[fallthrough]];
    default:
      for (std::uint64_t n = much || random_() % 8 == 0 ? 8000 : random_() % 200; n > 0; --n) {
        query.x.push_back(near(site_.x));
        query.z.push_back(near(site_.z));
      }
  }
  ++questions_;
  conversation().ask(query, [this, query](const Outcome<wire::Answer>& answer) {
    --questions_;
    if (!answer && answer.error().message == kLost) return;
    ASSERT_TRUE(answer) << name_ << ": " << answer.error().message;
    truth_.answered(query, *answer);
    saw(answer->id);
  });
  flush();
}

void Member::askGround() {
  if (!connected() || grounds_ >= wire::kMaxGrounds + 2) return;
  const wire::AskGround ask{0, site_, 1 + static_cast<double>(random_() % 30), 0.2 + static_cast<double>(random_() % 20) / 10};
  ++grounds_;
  conversation().ask(ask, [this, ask](const Outcome<wire::Ground>& ground) {
    --grounds_;
    if (!ground && ground.error().message == kLost) return;
    if (!ground) {
      EXPECT_NE(ground.error().message.find("the camera's budget"), std::string::npos) << ground.error().message;
      return;
    }
    truth_.answered(ask, *ground);
    saw(ground->id + ground->leaves.size());
  });
  flush();
}

void Member::askMap() {
  Server& asked = cluster_.next();
  if (!asked.runs() || !asked.session(nature_.session)) return;
  // The tile at a place, where the world's origin lies at 0, 0.
  constexpr int kLevel = 16;
  constexpr double kSide = 2 * std::numbers::pi * 6'378'137 / (1 << kLevel) * lattice::kStepsPerMetre;
  const auto number = [](lattice::Step v) {
    return static_cast<std::uint32_t>((1 << (kLevel - 1)) + std::floor(static_cast<double>(v) / kSide));
  };
  const map::TileAddress tile{kLevel, number(site_.x), number(site_.z)};
  const std::string target = "/v1/sessions/" + nature_.session + "/heights/" + std::to_string(kLevel) + "/" + std::to_string(tile.x) + "/" +
                             std::to_string(tile.y) + ".png?at=0,0";
  const std::string edit = std::to_string(truth_.known());
  http::Request request;
  request.method = "GET";
  request.target = target;
  request.edit = edit;
  const auto reply = http::mapTileRoute(asked.directory())(request);
  const auto* later = reply ? std::get_if<http::DeferredResponse>(&*reply) : nullptr;
  ASSERT_TRUE(later) << name_ << " asks for a tile: " << (reply ? std::get<http::Answer>(*reply).body : target);
  // Made sometime later, of the ground of then.
  const auto asks = std::make_shared<http::DeferredResponse>(*later);
  const Duration pause = std::chrono::milliseconds(random_() % 2000);
  asked.keep(asks, pause + 1ms);
  timer_.at(timer_.now() + pause, [this, tile, weak = std::weak_ptr(asks), isShared = asked.isShared()] {
    const auto work = weak.lock();
    if (!work) return;  // the server fell
    http::Reply turn = work->work({});
    if (auto* const other = std::get_if<http::DeferredResponse>(&turn)) turn = other->work({});
    if (isShared && std::holds_alternative<http::RetryAt>(turn)) return;  // it has not heard of the edit yet
    const auto made = std::get<http::Answer>(std::move(turn));
    if (isShared && made.status == 503) {  // nor will it soon
      EXPECT_FALSE(cluster_.isCalm()) << made.body;
      return;
    }
    ASSERT_EQ(made.status, 200u) << made.body;
    const auto known = std::ranges::find(made.headers, http::kEditHeader, [](const auto& header) { return header.first; });
    ASSERT_NE(known, made.headers.end());
    truth_.answered(map::sheetOf(tile, map::Place()), std::stoull(known->second), made.etag, made.body);
    saw(made.body.size());
  });
}

void Member::takeClock() {
  if (connected() && nature_.hello.clock) say(conversation().setClock({true, wire::ClockMode::kStepped, 0}));
}

// The next step, when the last one is done; where nobody has the clock, it is taken first.
void Member::step() {
  if (!connected() || !nature_.hello.clock) return;
  const wire::Clock& said = conversation().clock().said();
  if (said.owner == 0) return takeClock();
  if (said.owner != world().camera || said.mode != wire::ClockMode::kStepped || !said.waitsFor.empty() || stepAsked_ > said.step) return;
  stepAsked_ = said.step + 1;
  say(conversation().step({20'000, true}));
}

void Member::setThreshold(double pixels) {
  if (!begun_) return;
  threshold_ = pixels;  // a mesh at rest that suits it stays as it is, and nothing but the grant comes
  wire::Settings settings = nature_.hello.settings;
  settings.threshold = pixels;
  say(client_->change(settings));
}

void Member::edit() {
  if (!connected()) return;
  chooseSite();
  editor_.edit(site_, say_);
}

void Member::post() {
  chooseSite();
  edits::Operation operation = testing_support::randomOperation(random_, site_);
  if (truth_.known() > 0 && random_() % 4 == 0) operation = {edits::Undo{1 + random_() % (truth_.known() + 2)}, 0};
  poster_.post(std::move(operation));
}

void Member::chooseSite() {
  const double ahead = 30 + static_cast<double>(random_() % 120);
  if (random_() % 2 == 0)  // else where it was
    site_ = {camera_.pose.x - static_cast<lattice::Step>(ahead * std::sin(heading_) * lattice::kStepsPerMetre),
             camera_.pose.z - static_cast<lattice::Step>(ahead * std::cos(heading_) * lattice::kStepsPerMetre)};
}

void Member::undo(std::uint64_t edit) { editor_.ask({edits::Undo{edit}, 0}, say_); }

// ---- what it sees ----

void Member::hear(const std::string& frame) {
  if (const core::Wrong wrong = client_->heard(testing_support::bytesOf(frame), timer_.now())) {
    EXPECT_TRUE(wrong->find("ran out of memory") != std::string::npos ||
                (cluster_.isShared() && wrong->find("connect again") != std::string::npos) || isBehind(*wrong))
        << name_ << ": " << *wrong;
    return lose({});
  }
  look();
  flush();
}

// A server that cannot reach the others does not have all that its members may know from them.
bool Member::isBehind(const std::string& wrong) const {
  const bool isBehind = !cluster_.isCalm() && wrong.find("has lost edits") != std::string::npos;
  met.behind += isBehind;
  return isBehind;
}

// As a program does that takes an iteration, works on it, and takes the next.
void Member::look() {
  if (!thinks_)
    if (const auto received = conversation().receive()) take(received->iteration);
  if (!thinks_ && client_->hasReturned()) {
    client_->goOn(follower_.enter(client_->coming()));
    begin(sequence_ - 1, true);  // the newest pose was said again
  }
  if (!connected()) return;
  if (!begun_) {
    follower_.follow({nature_.hello.points, world().shadedVertices, world().settings.triangleBudget});
    follower_.enter(world());
    begin(sequence_, false);
    pose();
  }
  if (const std::uint64_t version = conversation().roster().version(); std::exchange(membersSeen_, version) < version) lookAtMembers();
  if (const std::uint64_t version = conversation().clock().version(); std::exchange(clockSeen_, version) < version)
    take(conversation().clock().said());
  if (const auto edits = conversation().takeEdits().made; !edits.empty()) {
    editor_.take(edits);
    saw(editor_.followed());
  }
}

void Member::begin(std::uint64_t lastPose, bool isNext) {
  begun_ = true;
  settled_ = false;
  said_ = {};
  lastNumber_ = lastStepDone_ = stepAsked_ = membersSeen_ = clockSeen_ = 0;
  lastPose_ = lastPose;
  // The first iteration of a mesh that has moved knows what the mesh knew.
  edit_ = cluster_.isShared() && isNext ? std::min(edit_, world().edit) : world().edit;
  isNew_ = true;
  cluster_.greeted(world().camera);
  editor_.connected(world(), say_, !cluster_.isCalm());
}

void Member::take(const wire::Iteration& iteration) {
  EXPECT_EQ(iteration.number, ++lastNumber_) << name_;
  EXPECT_LE(iteration.poseSequence, sequence_) << name_;
  if (isLockstep())
    EXPECT_EQ(iteration.poseSequence, lastPose_ + 1) << name_ << ": not one iteration for each pose";
  else
    EXPECT_GE(iteration.poseSequence, lastPose_) << name_;
  lastPose_ = iteration.poseSequence;
  EXPECT_GE(iteration.edit, iteration.number > 1 ? std::max(edit_, world().edit) : edit_) << name_ << "'s ground goes back";
  const bool isNewGround = std::exchange(isNew_, false) || iteration.edit > edit_;
  edit_ = iteration.edit;
  truth_.knows(edit_);
  thinks_ = true;
  timer_.at(timer_.now() + nature_.think, [this, iteration, life = lives_, isNewGround] {
    if (life != lives_) return;
    digest(iteration);
    judgeIteration(iteration, isNewGround);
  });
}

// Also when its line is lost meanwhile.
void Member::digest(const wire::Iteration& iteration) {
  thinks_ = false;
  const core::Follower::Answer answer = follower_.apply(iteration);
  EXPECT_FALSE(answer.wrong) << name_ << ": " << answer.wrong->message;
  settled_ = iteration.settled && iteration.poseSequence == sequence_;
  saw(iteration.meshHash);
  if (connected()) {
    if (answer.resend) say(conversation().resend(*answer.resend));
    say(conversation().acknowledge(answer.acknowledge));
  }
  look();
  flush();
}

// No edit that it has is missing from it.
void Member::judgeIteration(const wire::Iteration& iteration, bool isNewGround) {
  if (!cluster_.isShared() || (!isNewGround && random_() % 8 != 0) || follower_.scene().leaves().empty()) return;
  ++met.judged;
  if (const auto layer = truth_.layer(iteration.edit)) judge(edits::EditedTerrain(server_->terrain(), layer));
}

void Member::lookAtMembers() {
  EXPECT_TRUE(nature_.hello.members) << name_;
  const auto& others = conversation().roster().others();
  EXPECT_FALSE(others.contains(world().camera)) << name_ << " is told of itself";
  for (const auto& [camera, other] : others)
    if (other.heard == timer_.now() && other.member.moved) saw(camera ^ other.member.moved->pose.sequence << 32);
}

void Member::take(const wire::Clock& clock) {
  const wire::Clock before = std::exchange(said_, clock);
  EXPECT_GE(clock.time, before.time) << name_ << " sees time go back";
  EXPECT_GE(clock.step, before.step) << name_ << " sees a step undone";
  if (cluster_.isShared()) judgeClock(clock);
  if (clock.owner == world().camera && before.owner == clock.owner) {
    EXPECT_LE(clock.step, std::max(stepAsked_, before.step)) << name_ << " sees a step that it has not asked for";
  }
  saw(clock.time);
  if (clock.step > before.step || before.waitsFor != clock.waitsFor) {
    if (random_() % 8 != 0) step();  // and the next
  }
  const bool wasPassedOver = clock.notice.starts_with("Member " + std::to_string(world().camera) + " was passed over");
  if (!wasPassedOver && (!conversation().clock().waitsFor(world().camera) || clock.step <= lastStepDone_)) return;
  lastStepDone_ = clock.step;
  if (!wasPassedOver && random_() % 4 == 0) return;  // it forgets
  say(conversation().stepDone({clock.step}));
}

// One clock for all servers, whichever of them says it.
void Member::judgeClock(const wire::Clock& clock) {
  constexpr std::uint64_t kOnItsWay = 1'000'000;  // a clock that is set goes on elsewhere until that is heard
  if (const auto endings = cluster_.endings(session()); std::exchange(endings_, endings) != endings) stepSeen_ = timeSeen_ = 0;
  if (cluster_.losesTime() || !cluster_.isInTouchSince(opened_, *server_)) return;
  EXPECT_GE(clock.step, stepSeen_) << name_ << " sees a step undone at another server";
  EXPECT_GE(clock.time + kOnItsWay, timeSeen_) << name_ << " sees time go back at another server";
  stepSeen_ = std::max(stepSeen_, clock.step);
  timeSeen_ = std::max(timeSeen_, clock.time);
}

bool Member::rests(std::uint64_t edit) const {
  return connected() && line_->isOpen() && questions_ == 0 && grounds_ == 0 && !digests() && settled_ &&
         conversation().granted().threshold == threshold_ && edit_ == edit && !editor_.waits() && !poster_.waits() &&
         (!nature_.hello.edits || editor_.followed() == edit);
}

bool Member::knows(const presence::Presence::State& state) const {
  const wire::Clock& clock = conversation().clock().said();
  const auto isSame = [&](const auto field) { return clock.*field == state.clock.*field; };
  if (nature_.hello.clock && !(isSame(&wire::Clock::step) && isSame(&wire::Clock::owner) && isSame(&wire::Clock::waitsFor))) return false;
  if (!nature_.hello.members) return true;
  const auto& others = conversation().roster().others();
  return others.size() + 1 == state.members.size() && std::ranges::all_of(state.members, [&](const wire::Member& member) {
           if (member.camera == world().camera) return true;
           const auto known = others.find(member.camera);
           const auto poseOf = [](const wire::Member& m) {
             return m.moved ? std::pair(m.moved->pose.sequence, m.moved->pose.state)
                            : std::pair(std::uint64_t{0}, std::vector<std::uint8_t>());
           };
           return known != others.end() && poseOf(known->second.member) == poseOf(member);
         });
}

void Member::judge(const terrain::Terrain& ground) const {
  constexpr std::int32_t kCoarsest = std::int32_t{1} << lattice::verticalBits(lattice::kMaxLevel);
  std::vector<lattice::Step> x, z;
  std::vector<std::int32_t> y;
  for (const auto& [address, leaf] : follower_.scene().leaves())
    for (const mesh::LocalVertex& v : leaf.mesh->vertices) {
      x.push_back(address.x() + v.x);
      z.push_back(address.z() + v.z);
      y.push_back(v.y);
    }
  std::vector<std::int32_t> truth(y.size());
  ground.heightSteps(x, z, truth);
  for (std::size_t k = 0; k < y.size(); ++k) {
    // Heights are snapped to the spacing of some level, of which this one is a multiple.
    const std::int32_t spacing = std::min(y[k] == 0 ? kCoarsest : y[k] & -y[k], kCoarsest);
    ASSERT_LE(std::abs(y[k] - truth[k]), spacing / 2)
        << name_ << " sees another ground than the log's at " << x[k] << ", " << z[k] << ": " << y[k] << " instead of " << truth[k];
  }
  EXPECT_FALSE(y.empty()) << name_;
}

void Member::judgeWait() const {
  poster_.judgeWait();
  const Duration most = nature_.hello.settings.bytesPerSecond == 0 ? 2s : 10s;
  if (!line_ || !line_->isOpen() || digests() || timer_.now() - std::max(line_->quietFrom(), cluster_.calmFrom()) <= most) return;
  EXPECT_TRUE(connected()) << name_ << " waits for the world";
  EXPECT_EQ(questions_, 0u) << name_ << " waits for an answer";
  EXPECT_EQ(grounds_, 0u) << name_ << " waits for a ground";
  EXPECT_FALSE(editor_.waits()) << name_ << " waits for the answer to an edit";
  EXPECT_TRUE(lastPose_ == sequence_ && (isLockstep() || settled_)) << name_ << " waits for an iteration: " << state();
}

std::string Member::state() const {
  if (!connected()) return name_ + " is not connected";
  return name_ + ": pose " + std::to_string(sequence_) + ", iteration " + std::to_string(lastNumber_) + " for pose " +
         std::to_string(lastPose_) + (settled_ ? ", settled" : "") + ", " + (digests() ? "some undigested, " : "") +
         std::to_string(questions_) + " questions open, clock step " + std::to_string(conversation().clock().said().step) + " of " +
         std::to_string(conversation().clock().said().owner);
}

}  // namespace ridgecast::simulation
