#include "tests/simulation/cluster.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <utility>

#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"
#include "tests/simulation/world.h"

namespace ridgecast::simulation {

using namespace std::chrono_literals;

namespace {

constexpr const char* kVisited = "visited";  // a session that nobody stays in
constexpr Duration kHeard = 6s;              // within which servers that can hear each other have agreed whose a name is
constexpr Duration kClockHeard = 2s;         // and know each other's clock

std::uint64_t hashOf(const editing::Ground& ground) {
  const auto layer = edits::layerOf(*ground.terrain);
  return layer ? layer->hash() : edits::Layer().hash();
}

}  // namespace

Cluster::Cluster(std::size_t servers, std::shared_ptr<const terrain::Terrain> terrain, const session::Limits& limits,
                 const testing_support::SimulatedTimer& timer, std::uint64_t seed, Truths& truths, Random& random, Falls falls)
    : timer_(timer), truths_(truths), random_(random), falls_(std::move(falls)), jumps_(seed % 4 == 0), losesRecords_(seed % 8 == 5) {
  if (servers == 1) {
    all_.push_back(std::make_unique<Server>(std::move(terrain), limits, timer, seed));
    return;
  }
  engine_ = std::make_unique<testing_support::SimulatedEngine>(timer, seed);
  engine_->notice(std::chrono::milliseconds(random_() % 2 == 0 ? 0 : random_() % 1500));
  engine_->slow(std::chrono::microseconds(200));
  disk_ = std::make_unique<testing_support::ForgetfulDisk>(random_);
  for (std::size_t k = 0; k < servers; ++k)
    all_.push_back(std::make_unique<Server>(terrain, limits, timer, seed + 7 * k, Server::Shared{*engine_, *disk_}));
  for (auto& [name, truth] : truths_)
    truth.follow([this, session = name] {
      auto log = engine_->log(session);
      log.resize(std::min<std::uint64_t>(log.size(), most_[session]));  // what no server has may be lost
      return log;
    });
  for (std::size_t k = 0; k < servers; ++k) begin(k, 0);
}

Cluster::~Cluster() = default;

Server& Cluster::next() const {
  if (all_.size() == 1) return *all_.front();
  const std::size_t first = random_() % all_.size();
  for (std::size_t k = 0; k < all_.size(); ++k)
    if (Server& server = *all_[(first + k) % all_.size()]; server.takesMembers()) return server;
  return *all_[first];
}

void Cluster::greeted(std::uint64_t camera) {
  EXPECT_TRUE(!isShared() || cameras_.insert(camera).second) << "two cameras have the number " << camera;
}

// ---- what breaks ----

void Cluster::away(Duration time) { calmFrom_ = std::max(calmFrom_, timer_.now() + time); }

void Cluster::split(Duration time) {
  away(time);
  splitUntil_ = std::max(splitUntil_, timer_.now() + time + kHeard);
}

bool Cluster::hasTail() const {
  return std::ranges::all_of(most_, [&](const auto& most) { return engine_->last(most.first) >= most.second; });
}

bool Cluster::mayBreak() const { return breaks_ && hasTail(); }

bool Cluster::isWhole() const {
  return !isStopped_ && !isUpgrading_ && cut_.empty() &&
         std::ranges::all_of(all_, [](const auto& server) { return server->takesMembers(); }) && hasTail();
}

void Cluster::begin(std::size_t server, std::uint64_t life) {
  if (isOver_ || lives_[server] != life || all_[server]->start()) return;
  timer_.at(timer_.now() + 300ms, [this, server, life] { begin(server, life); });
}

void Cluster::fall(std::size_t server, bool withPower) {
  Server& its = *all_[server];
  if (!its.isUp() && !its.isStarting()) return;
  ++met.falls;
  falls_(its);
  its.fall(withPower);
  for (auto& [name, lives] : sessions_) lives.at.erase(server);  // it goes on elsewhere, or when a server is there again
  cut_.erase(server);
  const Duration pause = Server::kCeasing + std::chrono::milliseconds(100 + random_() % 3000);
  away(pause + 500ms);
  timer_.at(timer_.now() + pause, [this, server, life = ++lives_[server]] { begin(server, life); });
}

void Cluster::finish() {
  isOver_ = true;
  for (std::size_t k = 0; k < all_.size(); ++k) fall(k, false);
}

// One server after the other sends its members away, ends, and is there again before the next one goes.
void Cluster::upgrade(std::size_t server) {
  if (server == all_.size()) {
    isUpgrading_ = false;
    ++met.upgrades;
    return;
  }
  away(20s);
  if (!all_[server]->isUp() || !hasTail()) return timer_.at(timer_.now() + 100ms, [this, server] { upgrade(server); });
  all_[server]->drain();
  timer_.at(timer_.now() + std::chrono::milliseconds(200 + random_() % 1500), [this, server] {
    fall(server, true);
    await(server);
  });
}

void Cluster::await(std::size_t server) {
  if (all_[server]->takesMembers()) return upgrade(server + 1);
  timer_.at(timer_.now() + 100ms, [this, server] { await(server); });
}

void Cluster::failOver(const Event& event) {
  const std::string session = event.who % 4 == 0 ? "other" : std::string(directory::kDefaultName);
  if (!isWhole() || isCutting_) return;
  const bool isThere = std::ranges::any_of(all_, [&](const auto& server) {
    const auto its = server->session(session);
    return its && its->ground().edit >= most_[session];
  });
  if (!isThere) return;  // nobody could bring it back
  ++met.failovers;
  engine_->loseEnd(session, event.amount % 8);
  truths_.at(session).loseEnd();
  if (losesRecords_) engine_->loseRecords();
  for (std::size_t k = 0; k < all_.size(); ++k) touches(k);
  split(testing_support::SimulatedEngine::kGrace + 2s);
}

bool Cluster::act(const Event& event) {
  const std::size_t server = event.who % all_.size();
  const auto time = std::chrono::milliseconds(event.amount);
  switch (event.kind) {
    case Kind::kStop:
    case Kind::kCrash:
      if (mayBreak()) fall(server, event.kind == Kind::kStop);
      return true;
    case Kind::kUpgrade:
      if (!isUpgrading_) {
        isUpgrading_ = true;
        upgrade(0);
      }
      return true;
    case Kind::kPart:
      if (!mayBreak() || cut_.contains(server) || !all_[server]->bus()) return true;
      cut_.insert(server);
      engine_->cut(*all_[server]->bus());
      split(time + 2s);
      timer_.at(timer_.now() + time, [this, server] { mend(server); });
      return true;
    case Kind::kHalt:
      if (!mayBreak() || isStopped_) return true;
      isStopped_ = true;
      engine_->stop();
      split(time + 2s);
      timer_.at(timer_.now() + time, [this] { halt(false); });
      return true;
    case Kind::kLoseEnd:
      failOver(event);
      return true;
    case Kind::kSlow:
      engine_->slow(std::chrono::milliseconds(event.amount % 30), std::chrono::milliseconds(event.dice % 20));
      return true;
    case Kind::kFull:
      engine_->fill();
      split(time + 2s);
      timer_.at(timer_.now() + time, [this] { engine_->empty(); });
      return true;
    case Kind::kJump:
      if (!jumps_) return true;
      engine_->setClock(std::chrono::milliseconds(event.amount) - 10s);
      return true;
    case Kind::kCut:
      if (mayBreak() && all_[server]->runs() && !disk_->isOff()) disk_->cutPowerAfter(event.amount), isCutting_ = true;
      return true;
    case Kind::kVisit:
      visit(*all_[server], event);
      return true;
    default:
      return false;
  }
}

void Cluster::mend(std::size_t server) {
  if (cut_.erase(server) == 0) return;
  touches(server);
  if (all_[server]->bus()) engine_->mend(*all_[server]->bus());
}

void Cluster::halt(bool stops) {
  if (!std::exchange(isStopped_, stops) || stops) return;
  for (std::size_t k = 0; k < all_.size(); ++k) touches(k);
  engine_->start();
}

void Cluster::touches(std::size_t server) { inTouchFrom_[server] = timer_.now() + kClockHeard; }

bool Cluster::isInTouchSince(Time then, const Server& server) const {
  const auto its = std::ranges::find(all_, &server, [](const auto& one) { return one.get(); }) - all_.begin();
  const auto k = static_cast<std::size_t>(its);
  const auto from = inTouchFrom_.find(k);
  return !isStopped_ && !cut_.contains(k) && (from == inTouchFrom_.end() || from->second <= then);
}

// Who stays for a while.
void Cluster::visit(Server& server, const Event& event) {
  if (!server.takesMembers()) return;
  const auto stays = std::chrono::milliseconds(event.dice % 20'000);
  const auto entered = [this, stays, &server](const std::shared_ptr<session::Session>& session) {
    auto place = session ? session->enter("visitor") : Outcome<session::Membership>(Error{"It was refused."});
    if (!place) return;
    server.keep(std::make_shared<session::Membership>(std::move(*place)), stays);
    if (timer_.now() < splitUntil_) return;
    ++met.visits;
    for (const auto& other : all_) {
      const auto theirs = other->isUp() ? other->session(kVisited) : nullptr;
      EXPECT_TRUE(!theirs || theirs->contentHash() == session->contentHash()) << "a name is two worlds";
    }
  };
  server.join(kVisited, "visitor", entered, 5 + static_cast<std::uint32_t>(event.amount % 2));
}

void Cluster::heal() {
  breaks_ = false;
  halt(false);
  for (std::size_t k = 0; k < all_.size(); ++k) mend(k);
  engine_->empty();
  engine_->slow(std::chrono::microseconds(200));
  if (!disk_->isOff()) {
    disk_->restorePower();
    isCutting_ = false;
  }
  away(3s);
}

void Cluster::settle() {
  for (const auto& server : all_) server->settle();
  if (disk_->isOff() && std::exchange(isCutting_, false)) {  // of all of them
    for (std::size_t k = 0; k < all_.size(); ++k) fall(k, false);
    timer_.at(timer_.now() + Server::kCeasing + 50ms, [this] { disk_->restorePower(); });  // nothing has the files any more
  }
  for (const auto& [name, truth] : truths_) look(name);
}

void Cluster::look(const std::string& session) {
  Lives& lives = sessions_[session];
  const std::size_t before = lives.at.size();
  for (std::size_t k = 0; k < all_.size(); ++k) {
    const auto its = all_[k]->isUp() ? all_[k]->session(session) : nullptr;
    if (its) most_[session] = std::max(most_[session], its->ground().edit);
    its ? void(lives.at.insert(k)) : void(lives.at.erase(k));
  }
  lives.endings += before > 0 && lives.at.empty();
}

std::uint64_t Cluster::endings(const std::string& session) const {
  const auto its = sessions_.find(session);
  return its == sessions_.end() ? 0 : its->second.endings;
}

// ---- whether they agree ----

void Cluster::judge() {
  for (auto& [name, truth] : truths_)
    for (const auto& server : all_) {
      const auto its = server->isUp() ? server->session(name) : nullptr;
      if (!its) continue;
      const editing::Ground ground = its->ground();
      if (std::exchange(judged_[its.get()], ground.edit) == ground.edit) continue;
      const auto layer = truth.layer(ground.edit);
      EXPECT_TRUE(!layer || layer->hash() == hashOf(ground)) << "a server's ground as of edit " << ground.edit << " of " << name;
    }
  if (++judgements_ % 16 == 0) judgeLogs();
}

void Cluster::judgeLogs() {
  if (!isWhole()) return;
  for (auto& [name, truth] : truths_) truth.judgeShared();
}

bool Cluster::hasAll(const session::Session& session) const { return isWhole() && session.ground().edit == engine_->last(session.name()); }

void Cluster::judgeRest(const std::string& session, std::size_t members) {
  judgeLogs();
  std::optional<wire::Clock> clock;
  for (const auto& server : all_) {
    const auto its = server->session(session);
    if (!its) continue;
    EXPECT_EQ(its->ground().edit, engine_->last(session)) << session;
    const auto state = its->presence().state();
    if (!clock) clock = state.clock;
    EXPECT_EQ(state.members.size(), members) << "a server knows other members of " << session;
    EXPECT_EQ(state.clock.step, clock->step) << "servers have other steps of " << session;
    EXPECT_EQ(state.clock.owner, clock->owner) << "servers have other owners of the clock of " << session;
  }
}

void Cluster::end() {
  for (std::size_t k = 0; k < all_.size(); ++k) fall(k, true);
  for (auto& [name, truth] : truths_) {
    truth.judgeShared();
    for (const auto& server : all_) truth.judgeCopy(server->folder());
  }
}

}  // namespace ridgecast::simulation
