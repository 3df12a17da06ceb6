#include "tests/simulation/world.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <utility>

#include "common/edits/edited_terrain.h"

namespace ridgecast::simulation {

using namespace std::chrono_literals;

Met met;

namespace {

constexpr std::uint64_t kMost = 64;                                     // members
constexpr std::uint64_t kOld = 3000;                                    // edits
const std::string kDefault{directory::kDefaultName}, kOther = "other";  // sessions

const edits::Layer& layer(const terrain::Terrain& ground) {
  static const edits::Layer kNone;
  const auto* edited = dynamic_cast<const edits::EditedTerrain*>(&ground);
  return edited ? *edited->layer() : kNone;
}

}  // namespace

World::World(std::uint64_t seed) : random_(seed), hasOther_(seed < kSeveral && seed % 3 == 1) {
  session::Limits limits;
  limits.window = static_cast<std::uint32_t>(1 + random_() % 4);
  constexpr std::size_t kQueues[] = {2000, 20'000, 8 << 20};
  limits.maxQueuedBytes = kQueues[random_() % 3];
  if (random_() % 2 == 0) limits.sessionIdle = 1s;
  if (serversOf(seed) > 1) limits.sessionIdle = std::min<std::chrono::milliseconds>(limits.sessionIdle, 10s);
  limits.turn = 1h;  // it is by the processor's clock, which is not simulated
  const char* const terrains[] = {"alpine", "canyon", "archipelago"};
  terrain_ = terrain::create(terrains[random_() % 3], 5).value();
  for (const std::string& name : {kDefault, kOther}) truths_.try_emplace(name, terrain_, name);
  cluster_.emplace(serversOf(seed), terrain_, limits, timer_, seed, truths_, random_, [this](const Server& server) {
    for (const auto& member : members_) member->fall(server);
  });
  const lattice::Point site{static_cast<lattice::Step>(random_() % 2'000'000), static_cast<lattice::Step>(random_() % 2'000'000)};
  if (seed % 16 == 3 && !cluster_->isShared()) {  // undos reach beneath thousands
    met.old += kOld;
    server().fill(kOld, site);
  }
  EXPECT_TRUE(cluster_->isShared() || server().start());
  EXPECT_TRUE(!hasOther_ || server().start());
  std::uint64_t members = 2 + random_() % 4;
  if (cluster_->isShared()) members = seed % 32 == 0 ? kMost : members + cluster_->size();
  for (; members > 0; --members) admit(members, site);
  if (hasLiar(seed)) liar_ = std::make_unique<Liar>(server(), truths_.at(kDefault), timer_, random_, site);
}

void World::admit(std::uint64_t number, lattice::Point site) {
  Member::Nature nature;
  nature.hello.clientName = number % 2 == 0 ? "member" : "";  // who a member is, the server knows
  nature.hello.settings.threshold = 10 + static_cast<double>(random_() % 40);
  nature.hello.settings.triangleBudget = settings::kMinBudget;
  if (random_() % 4 == 0) nature.hello.settings.bytesPerSecond = 50'000 + random_() % 100'000;
  nature.hello.pacing = random_() % 3 == 0 ? wire::Pacing::kLockstep : wire::Pacing::kFree;
  nature.hello.points = random_() % 4 != 0;
  nature.hello.members = random_() % 2 == 0;
  nature.hello.clock = random_() % 2 == 0;
  nature.hello.edits = random_() % 2 == 0;
  nature.way.delay = std::chrono::microseconds(random_() % 3 == 0 ? 0 : random_() % 200'000);
  if (random_() % 3 == 0) nature.way.bytesPerSecond = 20'000 + static_cast<double>(random_() % 200'000);
  if (random_() % 2 == 0) nature.think = std::chrono::milliseconds(random_() % 300);
  if (random_() % 2 == 0) nature.leaving = std::chrono::microseconds(random_() % 20'000);
  if (random_() % 2 == 0) nature.stateBytes = random_() % (wire::kMaxStateBytes + 1);
  if (number > 1 && random_() % 4 == 0) nature.session = kOther;
  Truth& truth = truths_.at(nature.session);
  members_.push_back(std::make_unique<Member>("member " + std::to_string(number), *cluster_, truth, timer_, random_, nature, site));
}

void World::live(const Events& events) {
  const auto before = random_;
  for (const Event& event : events) {
    if (testing::Test::HasFailure()) return;
    random_.seed(event.dice);
    act(event);
    run(std::chrono::microseconds(event.pause));
    judge();
  }
  random_ = before;
}

void World::calm() {
  liar_.reset();
  breaks_ = false;
  cluster_->isShared() ? cluster_->heal() : server().disk().restorePower();
  for (std::size_t k = 0; k < cluster_->size(); ++k) (*cluster_)[k].starve({});
  rest();
  for (const auto& member : members_) {
    if (testing::Test::HasFailure()) return;
    // At rest, with a queue that takes its time, and nothing else that comes.
    member->ask(true);
    member->setThreshold(10 + static_cast<double>(random_() % 40));
    if (random_() % 2 == 0) member->fly(1);
  }
  rest();
}

void World::rest() {
  for (int k = 0; k < 3000 && !testing::Test::HasFailure();) {
    bool rest = true, isIdle = true;
    for (const auto& member : members_) {
      if (member->isAway()) member->join();
      if (rests(*member)) continue;
      rest = false;
      isIdle = isIdle && knowsAll(*member);
      if (!hasAll(*member)) member->insist();
    }
    if (rest) return;
    const Duration time = met.time;
    run(100ms);
    if (isIdle)
      met.time = time;  // only a step waits, and judge() says how long it may
    else
      ++k;
    judge();
  }
  for (const auto& member : members_) EXPECT_TRUE(rests(*member)) << stateOf(*member);
  EXPECT_TRUE(!cluster_->isShared() || cluster_->isWhole());
}

void World::judgeEnd() {
  if (testing::Test::HasFailure()) return;
  if (cluster_->isShared()) return endShared();
  std::map<std::string, std::pair<std::uint64_t, std::uint64_t>> grounds;  // the hash, and the last edit
  for (const auto& [name, truth] : truths_)
    if (const auto session = server().session(name)) grounds[name] = {layer(*session->terrain()).hash(), session->ground().edit};
  for (const auto& member : members_) member->leave(between(0, 20));
  judgeEmptiness();
  fall(true);
  if (testing::Test::HasFailure()) return;
  for (const auto& [name, ground] : grounds) {
    const auto truth = truths_.at(name).ground();
    EXPECT_EQ(truth->hash(), ground.first) << name;
    EXPECT_EQ(truths_.at(name).last(), ground.second) << name;
    const edits::EditedTerrain edited(terrain_, truth);
    for (const auto& member : members_)
      if (member->session() == name) member->judge(edited);
  }
  run(between(5, 6));
  ASSERT_TRUE(server().runs());
  for (const auto& [name, ground] : grounds) {
    const auto session = server().enter(name);
    ASSERT_TRUE(session) << name;
    EXPECT_EQ(layer(*session->terrain()).hash(), ground.first) << name << " starts with another ground";
  }
}

void World::endShared() {
  Duration time = met.time;
  run(45s);  // until it is heard of every line that was lost
  met.time = time;
  for (const auto& [name, truth] : truths_)
    cluster_->judgeRest(name, std::ranges::count_if(members_, [&](const auto& member) { return member->session() == name; }));
  for (const auto& member : members_) member->leave(between(0, 20));
  time = met.time;
  run(1min);
  met.time = time;
  for (std::size_t k = 0; k < cluster_->size(); ++k) {
    const Server& server = (*cluster_)[k];
    EXPECT_EQ(server.directory()->cameras(), 0u);
    EXPECT_EQ(server.directory()->all().size(), 1u) << "a session goes on without members";
    EXPECT_FALSE(server.hasCameras());
    EXPECT_TRUE(server.session()->presence().state().members.empty());
  }
  cluster_->end();
  if (testing::Test::HasFailure()) return;
  for (auto& [name, truth] : truths_) {
    const auto ground = truth.ground();
    EXPECT_EQ(ground->hash(), truth.layer(truth.last())->hash()) << name;
    for (const auto& member : members_)
      if (member->session() == name) member->judge(edits::EditedTerrain(terrain_, ground));
  }
  run(10s);
  ASSERT_TRUE(cluster_->isWhole()) << "not all servers start again";
  for (std::size_t k = 0; k < cluster_->size(); ++k)
    EXPECT_TRUE(cluster_->hasAll(*(*cluster_)[k].session())) << "server " << k << " starts with another ground";
  cluster_->judge();
}

void World::judgeEmptiness() {
  const Duration time = met.time;
  run(std::chrono::minutes(10));
  server().stopOther();
  run(1s);
  met.time = time;
  const directory::Directory& directory = *server().directory();
  EXPECT_EQ(directory.cameras(), 0u);
  EXPECT_EQ(directory.triangles(), 0u);
  EXPECT_FALSE(server().hasCameras());
  EXPECT_EQ(directory.all().size(), 1u) << "a session goes on without members";
  EXPECT_TRUE(server().session()->presence().state().members.empty());
  EXPECT_EQ(timer_.pending(), 0u) << "something still waits for its time";
}

void World::undoAll() {
  auto edits = truths_.at(kDefault).counting();
  std::vector<Member*> editors;
  for (const auto& member : members_)
    if (member->session() == kDefault) editors.push_back(member.get());
  std::ranges::shuffle(edits, random_);  // an older one may go before those that were made on it
  for (const std::uint64_t edit : edits) {
    Member& member = *editors[edit % editors.size()];
    bool done = false;
    for (int tries = 0; tries < 10 && !done; ++tries) {  // its budget may be spent
      ASSERT_TRUE(member.mayAsk()) << member.state();
      member.undo(edit);
      for (int k = 0; k < 1000 && !member.mayAsk(); ++k) run(10ms);
      done = !member.wasRefused();
      if (!done) run(1s);
    }
    ASSERT_TRUE(done) << "edit " << edit << " cannot be undone";
    ++met.undone;
  }
  EXPECT_EQ(layer(*server().session()->terrain()).hash(), edits::Layer().hash()) << "all is undone, and something is left";
}

World::~World() {
  if (cluster_->isShared()) {
    members_.clear();
    cluster_->finish();
    run(1s);
  }
  for (const auto& [name, truth] : truths_) met.edits += truth.last(), met.acknowledgements += truth.acknowledgements();
  met.lostWrites += server().disk().lost();
}

std::uint64_t World::history() const {
  std::uint64_t sum = 0;
  for (const auto& [name, truth] : truths_) sum = lattice::mix(sum + truth.last());
  for (const auto& member : members_) sum = lattice::mix(sum + member->history());
  return sum;
}

bool World::canUndoAll() const { return truths_.at(kDefault).counting().size() <= 100; }

bool World::hasAll(const Member& member) const {
  const Server& its = member.server();
  const auto session = its.runs() ? its.session(member.session()) : nullptr;
  return session && member.rests(session->ground().edit) && (!its.isShared() || cluster_->hasAll(*session));
}

std::string World::stateOf(const Member& member) const {
  const auto session = member.server().runs() ? member.server().session(member.session()) : nullptr;
  if (!session) return member.state() + ", its server has no session " + member.session();
  const auto state = session->presence().state();
  return member.state() + ", server at edit " + std::to_string(session->ground().edit) + " with " + std::to_string(state.members.size()) +
         " members and step " + std::to_string(state.clock.step) + " that waits for " + std::to_string(state.clock.waitsFor.size()) +
         (hasAll(member) ? "" : ", edits are missing") + (knowsAll(member) ? "" : ", others are missing");
}

bool World::knowsAll(const Member& member) const {
  return hasAll(member) && member.knows(member.server().session(member.session())->presence().state());
}

bool World::rests(const Member& member) const {
  return knowsAll(member) && member.server().session(member.session())->clock().state().waitsFor.empty();
}

Duration World::between(int least, int most) {
  return std::chrono::seconds(least) + std::chrono::milliseconds(random_() % static_cast<std::uint64_t>(1000 * (most - least)));
}

// ---- events ----

void World::act(const Event& event) {
  if (cluster_->isShared() && cluster_->act(event)) return;
  Member& member = *members_[event.who % members_.size()];
  Server& server = (*cluster_)[event.who % cluster_->size()];
  const auto time = std::chrono::milliseconds(event.amount);
  switch (event.kind) {
    case Kind::kFly:
      return member.isAway() ? member.join() : member.fly(static_cast<double>(event.amount));
    case Kind::kLose:
      return member.lose(time);
    case Kind::kLeave:
      return member.leave(time);
    case Kind::kMute:
      return member.mute(time);
    case Kind::kClock:
      return member.takeClock();
    case Kind::kStep:
      return member.step();
    case Kind::kThreshold:
      return member.setThreshold(static_cast<double>(event.amount));
    case Kind::kAsk:
      return member.ask();
    case Kind::kEdit:
      return member.edit();
    case Kind::kPost:
      return member.post();
    case Kind::kStall:
      return member.stall(time);
    case Kind::kStarve:
      return server.starve(time);
    case Kind::kLie:
      return liar_ ? liar_->lie() : void();
    case Kind::kWait:
      return run(time);
    case Kind::kStorm:
      return storm(server, event.amount);
    case Kind::kClaim:
      return server.isUp() && !server.isShared() ? server.claim(event.who % 2 == 0 ? kDefault : kOther, time) : void();
    case Kind::kStop:
    case Kind::kCrash:
      return server.runs() ? fall(event.kind == Kind::kStop) : void();
    case Kind::kCut:
      return server.runs() ? server.disk().cutPowerAfter(event.amount) : void();
    case Kind::kFill:
      if (!server.runs()) return;
      server.disk().fillAfter(event.amount);
      return timer_.at(timer_.now() + between(0, 3), [&server] { server.disk().empty(); });
    default:
      return;  // of several servers
  }
}

void World::storm(Server& server, std::uint64_t edits) {
  if (!server.runs()) return;
  ++met.storms;
  server.hold();
  if (liar_ && edits == wire::kMaxEdits) liar_->flood();
  for (; edits > 0; --edits)
    for (const auto& member : members_) member->edit();
  run(std::chrono::milliseconds(random_() % 250));
  server.release();
  settle();
}

// What has happened is judged before it starts again.
void World::fall(bool withPower) {
  ++met.falls;
  fell_ = true;
  for (const auto& member : members_) member->fall(server());
  server().fall(withPower);
  if (liar_) liar_->leave();
  for (auto& [name, truth] : truths_) truth.judge(server().folder());
  fellAt_ = timer_.now();
  met.handedOver += server().isUp();
  timer_.at(timer_.now() + between(0, 5), [this] { start(); });
}

void World::start() {
  if (breaks_ && random_() % 8 == 0) server().disk().cutPowerAfter(1 + random_() % 8);
  if (!server().start() || (hasOther_ && !server().hasOther())) timer_.at(timer_.now() + between(0, 5), [this] { start(); });
}

// No step waits for a member for ever, and no member for the server.
void World::judge() {
  if (cluster_->isShared()) return judgeShared();
  EXPECT_TRUE(!server().isUp() || server().runs() || timer_.now() - fellAt_ < 3s) << "the next server does not take the default session";
  if (!server().runs()) return;
  const wire::Clock clock = server().session()->clock().state();
  if (clock.step != step_ || clock.waitsFor.empty() || fell_) {
    fell_ = false;
    step_ = clock.step;
    stepSeen_ = timer_.now();
  }
  EXPECT_LE(timer_.now() - stepSeen_, clock::SessionClock::kStepTimeout + 4s) << "step " << step_ << " waits";
  for (const auto& member : members_) member->judgeWait();
}

void World::judgeShared() {
  cluster_->judge();
  for (const auto& member : members_) member->judgeWait();
  const Server& some = cluster_->next();
  if (!some.runs()) return;
  const wire::Clock clock = some.session()->clock().state();
  if (clock.step != step_ || clock.waitsFor.empty()) stepSeen_ = timer_.now();
  step_ = clock.step;
  EXPECT_LE(timer_.now() - std::max(stepSeen_, cluster_->calmFrom()), clock::SessionClock::kStepTimeout + 8s)
      << "step " << step_ << " waits";
}

void World::run(Duration time) {
  met.time += time;
  settle();
  for (const Time end = timer_.now() + time; timer_.step(end);) settle();
}

void World::settle() {
  if (cluster_->isShared()) return cluster_->settle();
  server().settle();
  if (server().isUp() && server().lostPower()) fall(false);
}

}  // namespace ridgecast::simulation
