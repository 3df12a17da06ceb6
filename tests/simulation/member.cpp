#include "tests/simulation/member.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <utility>

#include "common/edits/author.h"
#include "server/http/map_tiles.h"
#include "server/map/mercator.h"
#include "tests/support/random_edits.h"

namespace ridgecast::simulation {

using namespace std::chrono_literals;

Member::Member(std::string name, Server& server, Truth& truth, SimulatedTimer& timer, Random& random, const Nature& nature,
               lattice::Point near)
    : name_(std::move(name)),
      server_(server),
      truth_(truth),
      timer_(timer),
      random_(random),
      nature_(nature),
      editor_(edits::toText({name_, nature.hello.clientName}), truth, random),
      poster_(name_, nature.session, server, truth, timer, random) {
  camera_.pose.x = near.x + static_cast<lattice::Step>(random_() % 60'000);
  camera_.pose.z = near.z + static_cast<lattice::Step>(random_() % 60'000);
  // High up a mesh has a quarter of the leaves, and all that is judged here happens the same.
  const double altitude = 30 + static_cast<double>(random_() % 5 == 0 ? random_() % 400 : 4000 + random_() % 6000);
  camera_.pose.y = server_.terrain()->height({camera_.pose.x, camera_.pose.z}) + altitude;
  site_ = {camera_.pose.x, camera_.pose.z};
  camera_.pose.pitch = -0.4;
  camera_.projection = {.verticalFov = 1.0, .width = 160, .height = 90};
  heading_ = static_cast<double>(random_() % 628) / 100;
}

// ---- the line ----

void Member::connect() {
  const auto hear = [this, number = ++connections_](wire::ServerMessage message) {
    if (line_ && number == connections_) std::visit([this](auto& m) { take(m); }, message);
  };
  const Duration entering = std::chrono::milliseconds(random_() % 2 == 0 ? 0 : random_() % 400);
  line_ = Line::open(server_, nature_.session, name_, timer_, nature_.way, hear, entering);
  if (!line_) return;  // the server does not run, makes the session, or has not yet noticed which lines are lost
  wire::Hello hello = nature_.hello;
  hello.editsAfter = editor_.followed();
  line_->say(hello);
}

void Member::lose(Duration unheard) {
  if (!line_) return;
  line_->cut(unheard);
  line_.reset();
  world_.reset();
  roster_ = {};
  clock_ = {};
  lastNumber_ = undigested_ = lastStepDone_ = stepAsked_ = edit_ = 0;
  lastPose_ = sequence_;
  settled_ = false;
  asked_.clear();
  grounds_.clear();
  editor_.lost();
}

void Member::mute(Duration noticed) {
  if (!line_) return;
  line_->cut(2 * noticed);
  timer_.at(timer_.now() + noticed, [this, noticed, number = connections_] {
    if (line_ && number == connections_) lose(noticed);
  });
}

void Member::stall(Duration time) {
  if (line_) line_->stall(time);
}

void Member::fall() {
  poster_.fall();
  timer_.at(timer_.now() + nature_.way.delay + 2ms, [this, number = connections_] {
    if (line_ && number == connections_) lose({});
  });
}

void Member::leave(Duration unheard) {
  lose(unheard);
  follower_ = {};
  followed_ = false;
  editor_.forget();
}

// ---- what it does ----

void Member::pose() {
  settled_ = false;
  ++sequence_;
  line_->say(wire::PoseMessage{sequence_, camera_, std::vector<std::uint8_t>(nature_.stateBytes, static_cast<std::uint8_t>(sequence_))});
}

void Member::fly(double metres) {
  if (!connected()) return;
  if (isLockstep() && sequence_ - lastPose_ >= 8) return;  // as a client does that waits for its iterations
  heading_ += static_cast<double>(random_() % 100) / 500 - 0.1;
  camera_.pose.yaw = heading_;
  camera_.pose.x -= static_cast<lattice::Step>(metres * std::sin(heading_) * lattice::kStepsPerMetre);
  camera_.pose.z -= static_cast<lattice::Step>(metres * std::cos(heading_) * lattice::kStepsPerMetre);
  pose();
}

void Member::insist() {
  if (connected() && isLockstep() && lastPose_ == sequence_ && undigested_ == 0) pose();
}

void Member::ask(bool much) {
  if (!connected() || asked_.size() >= wire::kMaxQueries) return;
  wire::Query query;
  query.id = ++questions_;
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
  asked_[query.id] = query;
  line_->say(query);
}

void Member::askGround() {
  if (!connected() || grounds_.size() >= wire::kMaxGrounds) return;
  const wire::AskGround ask{++questions_, site_, 1 + static_cast<double>(random_() % 30), 0.2 + static_cast<double>(random_() % 20) / 10};
  grounds_[ask.id] = ask;
  line_->say(ask);
}

void Member::askMap() {
  if (!server_.runs() || !server_.session(nature_.session)) return;
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
  const auto answer = http::mapTileRoute(server_.directory())(request);
  ASSERT_TRUE(answer && answer->later) << name_ << " asks for a tile: " << (answer ? answer->body : target);
  // Made sometime later, of the ground of then.
  timer_.at(timer_.now() + std::chrono::milliseconds(random_() % 2000),
            [this, tile, later = answer->later, server = std::weak_ptr(server_.directory())] {
              if (server.expired()) return;
              const http::Answer made = later->work({});
              ASSERT_EQ(made.status, 200u) << made.body;
              const auto known = std::ranges::find(made.headers, http::kEditHeader, [](const auto& header) { return header.first; });
              ASSERT_NE(known, made.headers.end());
              truth_.answered(map::sheetOf(tile, map::Place()), std::stoull(known->second), made.etag, made.body);
              saw(made.body.size());
            });
}

void Member::takeClock() {
  if (connected() && nature_.hello.clock) line_->say(wire::SetClock{true, wire::ClockMode::kStepped, 0});
}

// The next step, when the last one is done; where nobody has the clock, it is taken first.
void Member::step() {
  if (!connected() || !nature_.hello.clock) return;
  const wire::Clock& said = clock_.said();
  if (said.owner == 0) return takeClock();
  if (said.owner != world_->camera || said.mode != wire::ClockMode::kStepped || !said.waitsFor.empty() || stepAsked_ > said.step) return;
  stepAsked_ = said.step + 1;
  line_->say(wire::ClockStep{20'000, true});
}

void Member::setThreshold(double pixels) {
  if (!connected()) return;
  threshold_ = 0;  // a mesh at rest that suits it stays as it is, and nothing but the grant comes
  wire::Settings settings = nature_.hello.settings;
  settings.threshold = pixels;
  line_->say(wire::ChangeSettings{settings});
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

void Member::take(wire::World& world) {
  ASSERT_FALSE(world_) << name_ << ": two worlds";
  if (!std::exchange(followed_, true)) follower_.follow({nature_.hello.points, world.shadedVertices, world.settings.triangleBudget});
  world_ = world;
  threshold_ = world.settings.threshold;
  edit_ = world.edit;
  for (const wire::Resume& held : follower_.resume()) line_->say(held);
  editor_.connected(world, say_);
  pose();
}

void Member::take(wire::Iteration& iteration) {
  ASSERT_TRUE(world_) << name_;
  EXPECT_EQ(iteration.number, ++lastNumber_) << name_;
  EXPECT_LE(++undigested_, world_->window) << name_ << ": more iterations than its window";
  EXPECT_LE(iteration.poseSequence, sequence_) << name_;
  if (isLockstep())
    EXPECT_EQ(iteration.poseSequence, lastPose_ + 1) << name_ << ": not one iteration for each pose";
  else
    EXPECT_GE(iteration.poseSequence, lastPose_) << name_;
  lastPose_ = iteration.poseSequence;
  EXPECT_GE(iteration.edit, edit_) << name_ << "'s ground goes back";
  edit_ = iteration.edit;
  truth_.knows(edit_);
  timer_.at(timer_.now() + nature_.think, [this, iteration, number = connections_] {
    if (line_ && number == connections_) digest(iteration);
  });
}

void Member::digest(const wire::Iteration& iteration) {
  --undigested_;
  const replica::Follower::Answer answer = follower_.apply(iteration);
  EXPECT_FALSE(answer.wrong) << name_ << ": " << answer.wrong->message;
  if (answer.resend) line_->say(*answer.resend);
  line_->say(answer.acknowledge);
  settled_ = iteration.settled && iteration.poseSequence == sequence_;
  saw(iteration.meshHash);
}

void Member::take(const wire::Members& news) {
  EXPECT_TRUE(nature_.hello.members) << name_;
  const auto applied = roster_.apply(news, timer_.now());
  EXPECT_TRUE(applied) << name_ << ": " << applied.error().message;
  EXPECT_FALSE(roster_.others().contains(world_->camera)) << name_ << " is told of itself";
  for (const wire::Moved& moved : news.moved) saw(moved.camera ^ moved.pose.sequence << 32);
}

void Member::take(const wire::Clock& clock) {
  const wire::Clock before = clock_.said();
  if (clock_.version() > 0) {
    EXPECT_GE(clock.time, before.time) << name_ << " sees time go back";
    EXPECT_GE(clock.step, before.step) << name_ << " sees a step undone";
  }
  clock_.hear(clock, timer_.now());
  saw(clock.time);
  if (clock.step > before.step || before.waitsFor != clock.waitsFor) {
    if (random_() % 8 != 0) step();  // and the next
  }
  const bool wasPassedOver = clock.notice.starts_with("Member " + std::to_string(world_->camera) + " was passed over");
  if (!wasPassedOver && (!clock_.waitsFor(world_->camera) || clock.step <= lastStepDone_)) return;
  lastStepDone_ = clock.step;
  if (!wasPassedOver && random_() % 4 == 0) return;  // it forgets
  line_->say(wire::StepDone{clock.step});
}

void Member::take(const wire::Answer& answer) {
  const auto question = asked_.extract(answer.id);
  ASSERT_TRUE(question) << name_ << ": an answer to no question";
  ASSERT_EQ(answer.refusal, "") << name_;
  truth_.answered(question.mapped(), answer);
  saw(answer.id);
}

void Member::take(const wire::Ground& ground) {
  const auto question = grounds_.extract(ground.id);
  ASSERT_TRUE(question) << name_ << ": a ground for no question";
  truth_.answered(question.mapped(), ground);
  saw(ground.id + ground.leaves.size());
}

void Member::take(const wire::EditAnswer& answer) {
  editor_.take(answer);
  saw(answer.number);
}

void Member::take(const wire::Edited& edited) {
  EXPECT_TRUE(nature_.hello.edits) << name_;
  editor_.take(edited);
  saw(editor_.followed());
}

void Member::take(const wire::ErrorMessage& error) {
  EXPECT_NE(error.message.find("ran out of memory"), std::string::npos) << name_ << " is refused: " << error.message;
  lose({});
}

bool Member::rests(std::uint64_t edit) const {
  return connected() && line_->isOpen() && asked_.empty() && grounds_.empty() && undigested_ == 0 && settled_ && threshold_ != 0 &&
         edit_ == edit && !editor_.waits() && !poster_.waits() && (!nature_.hello.edits || editor_.followed() == edit);
}

bool Member::knows(const session::Presence::State& state) const {
  const wire::Clock& clock = clock_.said();
  const auto isSame = [&](const auto field) { return clock.*field == state.clock.*field; };
  if (nature_.hello.clock && !(isSame(&wire::Clock::step) && isSame(&wire::Clock::owner) && isSame(&wire::Clock::waitsFor))) return false;
  if (!nature_.hello.members) return true;
  const auto& others = roster_.others();
  return others.size() + 1 == state.members.size() && std::ranges::all_of(state.members, [&](const wire::Member& member) {
           if (member.camera == world_->camera) return true;
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
  if (!line_ || !line_->isOpen() || undigested_ > 0 || timer_.now() - line_->quietFrom() <= most) return;
  EXPECT_TRUE(world_) << name_ << " waits for the world";
  EXPECT_TRUE(asked_.empty()) << name_ << " waits for an answer";
  EXPECT_TRUE(grounds_.empty()) << name_ << " waits for a ground";
  EXPECT_FALSE(editor_.waits()) << name_ << " waits for the answer to an edit";
  EXPECT_TRUE(lastPose_ == sequence_ && (isLockstep() || settled_)) << name_ << " waits for an iteration: " << state();
}

std::string Member::state() const {
  if (!connected()) return name_ + " is not connected";
  return name_ + ": pose " + std::to_string(sequence_) + ", iteration " + std::to_string(lastNumber_) + " for pose " +
         std::to_string(lastPose_) + (settled_ ? ", settled" : "") + ", " + std::to_string(undigested_) + " undigested, " +
         std::to_string(asked_.size()) + " questions open, clock step " + std::to_string(clock_.said().step) + " of " +
         std::to_string(clock_.said().owner);
}

}  // namespace ridgecast::simulation
