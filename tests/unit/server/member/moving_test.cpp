// A camera that goes from one server of a world to another, by real meshes, points and messages; the engine between them is simulated.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "client/core/mesh/follower.h"
#include "common/terrain/terrain.h"
#include "common/wire/wire.h"
#include "server/directory/directory.h"
#include "server/member/camera_session.h"
#include "tests/support/decoded.h"
#include "tests/support/flight.h"
#include "tests/support/simulated_bus.h"
#include "tests/support/simulated_timer.h"
#include "tests/support/waiting.h"

namespace ridgecast::member {
namespace {

using namespace std::chrono_literals;
using testing_support::await;
using testing_support::SimulatedEngine;
using testing_support::SimulatedTimer;

class Line final : public conversation::Sender {
 public:
  void send(wire::ServerMessage message, std::shared_ptr<const void>) override {
    const std::lock_guard lock(mutex_);
    messages_.emplace_back(wire::encode(message));
  }
  void sendShared(std::shared_ptr<const std::string> bytes, std::shared_ptr<const void>) override {
    const std::lock_guard lock(mutex_);
    messages_.push_back(*bytes);
  }
  std::size_t queuedBytes() const override { return 0; }
  void fail(wire::ErrorMessage message) override { send(std::move(message), nullptr); }
  std::optional<std::string> next() {
    const std::lock_guard lock(mutex_);
    if (messages_.empty()) return {};
    std::string first = std::move(messages_.front());
    messages_.pop_front();
    return first;
  }

 private:
  std::mutex mutex_;
  std::deque<std::string> messages_;
};

struct Server {
  explicit Server(std::shared_ptr<bus::Bus> bus, session::Record record = {}) {
    auto made = std::make_shared<session::Resources>();
    made->executor = executor.get();
    made->makeMesh = session::pipelineMeshes();
    made->serverName = "test";
    made->record = std::move(record);
    if (bus) made->bus = std::move(bus);
    directory = std::make_unique<directory::Directory>(made, terrain::create("alpine", 7).value());
  }
  ~Server() { executor.reset(); }
  std::unique_ptr<scheduling::Executor> executor = std::make_unique<scheduling::Executor>(2);
  std::unique_ptr<directory::Directory> directory;
};

wire::Hello helloOf() {
  wire::Hello hello;
  hello.points = true;
  hello.settings.threshold = 2;
  hello.settings.triangleBudget = 60'000;
  return hello;
}

// A client, with a camera that flies on.
struct Guest {
  explicit Guest(SimulatedTimer& t, wire::Hello h = helloOf()) : timer(t), hello(std::move(h)) {}
  ~Guest() { leave(); }
  void leave() {
    if (camera) camera->close();
    camera.reset();
  }
  // A connection begins: says what is held, then the newest pose.
  void enter(Server& server) {
    line = std::make_shared<Line>();
    iterations.clear();
    bytes = 0;
    sequence = 0;
    const auto session = server.directory->find(directory::kDefaultName);
    camera = std::make_shared<CameraSession>(session, std::move(*session->enter()), server.directory->nextCameraId(), line);
    camera->receive(hello);
    world.reset();
    ASSERT_TRUE(awaits([&] { return world.has_value(); }));
    follower.follow({hello.points, false, hello.settings.triangleBudget});
    for (const wire::Resume& part : follower.enter(*world)) camera->receive(tamper(part));
    fly();
  }
  void fly() {
    seconds += 0.1;
    camera->receive(wire::PoseMessage{++sequence, testing_support::straight(*terrain, seconds)});
  }
  bool awaits(const std::function<bool()>& is) {
    return await([&] {
      timer.advance(0s);
      take();
      return is();
    });
  }
  void take() {
    while (line) {
      const auto next = line->next();
      if (!next) return;
      wire::ServerMessage message = testing_support::decoded(*next);
      if (auto* w = std::get_if<wire::World>(&message)) world = std::move(*w);
      if (auto* error = std::get_if<wire::ErrorMessage>(&message)) ADD_FAILURE() << error->message;
      auto* const iteration = std::get_if<wire::Iteration>(&message);
      if (!iteration) continue;
      bytes += next->size();
      if (iterations.empty()) firstBytes = next->size();
      const auto answer = follower.apply(*iteration);
      EXPECT_FALSE(answer.wrong) << answer.wrong->message;
      least = std::min(least, follower.scene().triangles());
      iterations.push_back(std::move(*iteration));
      camera->receive(answer.acknowledge);
    }
  }
  bool settles() {
    return awaits([&] { return !iterations.empty() && iterations.back().poseSequence == sequence && iterations.back().settled; });
  }
  // Until its mesh may go; false: it may not.
  bool handOver() {
    const auto isDone = std::make_shared<std::atomic<bool>>(false);
    if (!camera->handOver([isDone] { *isDone = true; })) return false;
    EXPECT_TRUE(awaits([&] { return isDone->load(); }));
    take();
    leave();
    return true;
  }

  SimulatedTimer& timer;
  const wire::Hello hello;
  std::function<wire::Resume(wire::Resume)> tamper = [](wire::Resume r) { return r; };
  std::shared_ptr<const terrain::Terrain> terrain = terrain::create("alpine", 7).value();
  std::shared_ptr<Line> line;
  std::shared_ptr<CameraSession> camera;
  core::Follower follower;
  std::optional<wire::World> world;
  std::vector<wire::Iteration> iterations;
  std::size_t bytes = 0, firstBytes = 0;  // of this connection
  std::uint64_t least = ~std::uint64_t{0}, sequence = 0;
  double seconds = 0;
};

bool bringsNothing(const wire::Iteration& iteration) { return iteration.whole.empty() && iteration.come.empty() && iteration.gone.empty(); }

struct Moving : testing::Test {
  SimulatedTimer timer;
  SimulatedEngine engine{timer};
};

TEST_F(Moving, AMeshGoesOnAtAnotherServer) {
  Server a(engine.connect()), b(engine.connect());
  Guest guest(timer);
  guest.enter(a);
  EXPECT_EQ(guest.world->resumeKey.size(), wire::kMaxResumeKeyBytes);
  ASSERT_TRUE(guest.settles());
  const std::size_t start = guest.bytes;
  for (int round = 0; round < 4; ++round) {
    for (int k = 0; k < 5; ++k) {
      guest.fly();
      ASSERT_TRUE(guest.awaits([&] { return guest.iterations.back().poseSequence == guest.sequence; }));
    }
    ASSERT_TRUE(guest.handOver());
    const std::uint64_t triangles = guest.follower.scene().triangles(), hash = guest.follower.scene().hash();
    const std::string key = guest.world->resumeKey;
    guest.enter(round % 2 == 0 ? b : a);
    EXPECT_NE(guest.world->resumeKey, key);
    ASSERT_TRUE(guest.awaits([&] { return !guest.iterations.empty(); }));
    EXPECT_TRUE(bringsNothing(guest.iterations.front()));
    EXPECT_EQ(guest.iterations.front().meshHash, hash);
    EXPECT_EQ(guest.iterations.front().figures.triangles, triangles);
    EXPECT_LT(guest.firstBytes, start / 20) << "of " << start;
  }
  ASSERT_TRUE(guest.settles());
  EXPECT_EQ(guest.follower.scene().triangles(), guest.iterations.back().figures.triangles);
}

// Without a checkpoint, or with one that is not the client's mesh, all comes by points, once it is as fine as what is held.
TEST_F(Moving, WithoutItsCheckpointAMeshBeginsAnew) {
  struct Case {
    const char* what;
    std::function<void(Guest&, bus::Bus&)> happens;
  };
  const auto replace = [this](Guest& guest, bus::Bus& bus, std::string value) {
    std::string name = "camera/";
    for (const char c : guest.world->resumeKey)
      for (const int half : {c >> 4 & 15, c & 15}) name += "0123456789abcdef"[half];
    bool isDone = false;
    bus.hold(name, {}, 0, 1s, [&](Outcome<bus::Bus::Held> held) {
      EXPECT_FALSE(held->isYours) << "it is there";
      if (value.empty()) value = held->record.value.substr(0, held->record.value.size() / 2);
      bus.hold(name, value, held->record.epoch, 60s, [&](const Outcome<bus::Bus::Held>& written) { isDone = written->isYours; });
    });
    timer.advance(0s);
    EXPECT_TRUE(isDone);
  };
  for (const Case& c : {Case{"the engine has lost it", [&](Guest&, bus::Bus&) { engine.loseRecords(); }},
                        Case{"it is damaged", [&](Guest&g, bus::Bus&bus) { replace(g, bus, "damaged"); }},
                        Case{"it is half", [&](Guest&g, bus::Bus&bus) { replace(g, bus, {}); }},
                        Case{"another key",
                             [](Guest&g, bus::Bus&) {
                               g.tamper = [](wire::Resume r) {
                                 r.key.back() ^= 1;
                                 return r;
                               };
                             }},
                        Case{"no key",
                             [](Guest&g, bus::Bus&) {
                               g.tamper = [](wire::Resume r) {
                                 r.key.clear();
                                 return r;
                               };
                             }},
                        Case{"the engine is away", [&](Guest&, bus::Bus&) { engine.stop(); }},
                        Case{"the engine is slow", [&](Guest&, bus::Bus&) { engine.slow(2s); }}}) {
    SCOPED_TRACE(c.what);
    const auto first = engine.connect(), second = engine.connect();
    Server a(first), b(second);
    Guest guest(timer);
    guest.enter(a);
    ASSERT_TRUE(guest.settles());
    const std::size_t start = guest.bytes;
    ASSERT_TRUE(guest.handOver());
    c.happens(guest, *second);
    const std::uint64_t triangles = guest.least = guest.follower.scene().triangles();
    guest.seconds += 5;  // it has flown on
    guest.enter(b);
    ASSERT_TRUE(guest.settles());
    EXPECT_FALSE(guest.iterations.front().come.empty());
    EXPECT_TRUE(guest.iterations.front().whole.empty());
    EXPECT_GT(guest.least, triangles * 8 / 10) << "detail is kept until the next is as good";
    EXPECT_LT(guest.bytes, start * 11 / 10) << "no more than a start";
    guest.leave();
    engine.start();
    engine.slow(0s);
    timer.advance(2 * bus::BriefRecords::kLife + bus::BriefRecords::kDelay);
  }
}

TEST_F(Moving, BeginsAnewWhereTheEngineHasNoRoomForMoreMeshes) {
  const auto others = engine.connect();
  for (int k = 0; k < bus::BriefRecords::kShares; ++k)
    others->hold("share/checkpoints/" + std::to_string(k), "others", 0, 60s, [](const Outcome<bus::Bus::Held>& h) { ASSERT_TRUE(h); });
  timer.advance(0s);
  Server a(engine.connect()), b(engine.connect());
  Guest guest(timer);
  guest.enter(a);
  ASSERT_TRUE(guest.settles());
  ASSERT_TRUE(guest.handOver()) << "it leaves all the same";
  guest.enter(b);
  ASSERT_TRUE(guest.settles());
  EXPECT_FALSE(bringsNothing(guest.iterations.front()));
}

TEST_F(Moving, ACheckpointServesOnce) {
  Server a(engine.connect()), b(engine.connect());
  Guest guest(timer), thief(timer);
  guest.enter(a);
  ASSERT_TRUE(guest.settles());
  ASSERT_TRUE(guest.handOver());
  guest.enter(b);
  ASSERT_TRUE(guest.awaits([&] { return !guest.iterations.empty(); }));
  EXPECT_TRUE(bringsNothing(guest.iterations.front()));
  guest.leave();
  guest.enter(a);  // with the key of b, where nothing was handed over
  ASSERT_TRUE(guest.settles());
}

TEST_F(Moving, StaysWhereItCannotGo) {
  Server alone(nullptr), shared(engine.connect());
  const auto goes = [&](Server& server, wire::Hello hello) {
    Guest guest(timer, std::move(hello));
    guest.enter(server);
    EXPECT_TRUE(guest.awaits([&] { return !guest.iterations.empty(); }));
    const bool hasKey = !guest.world->resumeKey.empty();
    EXPECT_EQ(guest.handOver(), hasKey);
    return hasKey;
  };
  EXPECT_TRUE(goes(shared, helloOf()));
  EXPECT_FALSE(goes(alone, helloOf()));
  wire::Hello lockstep = helloOf(), leaves = helloOf();
  lockstep.pacing = wire::Pacing::kLockstep;
  leaves.points = false;
  EXPECT_FALSE(goes(shared, lockstep));
  EXPECT_FALSE(goes(shared, leaves));
}

}  // namespace
}  // namespace ridgecast::member
