// Edits over loopback: everybody's mesh follows them, hash for hash, and answers know them.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <memory>
#include <random>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "client/link/client.h"
#include "client/query/ground.h"
#include "common/edits/edited_terrain.h"
#include "tests/integration/edits_fixture.h"
#include "tests/support/relay.h"
#include "tests/support/sanitized.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using lattice::Step;

TEST_F(EditsTest, AreNumberedAndInEverybodysGround) {
  Member a(port(), "ann"), b(port(), "bob");
  const double y = base->height({0, 0}) + 60;
  a.stand(0, 0, y);
  b.stand(30, 20, y);
  a.settle(0);
  b.settle(0);
  const std::uint64_t before = b.hash();
  const auto answer = a.edit(craterAt(10, -80));
  ASSERT_TRUE(answer) << answer.error().message;
  EXPECT_EQ(answer->number, 1u);
  a.settle(1);
  b.settle(1);
  EXPECT_NE(b.hash(), before);
  const auto seen = b.edits(1);
  ASSERT_EQ(seen.size(), 1u);
  EXPECT_EQ(seen[0].author, "address 127.0.0.1");
  EXPECT_EQ(seen[0].name, "ann");
  EXPECT_EQ(seen[0].operation, craterAt(10, -80));
  EXPECT_TRUE(seen[0].ground.holds({m(10), m(-80)}));
  // Queries know it, and say so.
  wire::Query query;
  query.x = {m(10)};
  query.z = {m(-80)};
  const auto height = b.connection().ask(query).get();
  ASSERT_TRUE(height);
  EXPECT_EQ(height->edit, 1u);
  EXPECT_NEAR(height->heights[0], base->height({m(10), m(-80)}) - 8.0 / 3, 0.02);
  // Undone, it is the mesh of before.
  ASSERT_EQ(b.edit(R"({"op":"undo","edit":1})")->number, 2u);
  b.settle(2);
  float own = 0;
  base->heights(query.x, query.z, {&own, 1});
  EXPECT_EQ(b.connection().ask(query).get()->heights[0], own);
}

// A mesh that knows an edit since its return, before anybody has asked for posts, and then rests.
TEST_F(EditsTest, PostsKnowAnEditThatCameWithTheReturn) {
  Member editor(port(), "ann");
  testing_support::Relay relay(port(), {});
  const auto client = link::Client::open({"127.0.0.1", std::to_string(relay.port()), "default"}, wire::Hello{});
  ASSERT_TRUE(client) << client.error().message;
  core::HeldEdits held((*client)->world().horizon);
  held.moveTo({0, 0});
  ASSERT_TRUE((*client)->exchangeEdits(held));
  camera::Camera camera;
  camera.pose.y = base->height({0, 0}) + 60;
  (*client)->send(camera);
  relay.breakAll();
  ASSERT_TRUE(testing_support::await([&] {
    (*client)->receive(10ms);
    return (*client)->connection().reconnections() == 1;
  }));
  ASSERT_EQ((*client)->world().edit, 0u);
  ASSERT_TRUE(editor.edit(craterAt(10, -80)));
  ASSERT_TRUE(testing_support::await([&] {
    const auto update = (*client)->receive(10ms);
    return update && update->iteration.edit == 1;
  }));
  ASSERT_TRUE(testing_support::await([&] {
    const auto exchanged = (*client)->exchangeEdits(held);
    return !exchanged || (held.known() == 1 && held.complete());
  }));
  EXPECT_EQ(held.known(), 1u);
}

// Whoever draws asks for the posts alone, and has the server's ground.
TEST_F(EditsTest, PostsThatAreFetchedGiveTheServersGround) {
  Member editor(port(), "ann");
  const auto client = link::Client::open({"127.0.0.1", std::to_string(port()), "default"}, wire::Hello{});
  ASSERT_TRUE(client) << client.error().message;
  core::HeldEdits held((*client)->world().horizon);
  held.moveTo({0, 0});
  camera::Camera camera;
  camera.pose.y = base->height({0, 0}) + 60;
  std::uint64_t sequence = 0;
  const auto follow = [&](std::uint64_t edit) {
    const auto deadline = Time::now() + kTimeout;
    camera.pose.yaw += 0.01;
    for (sequence = (*client)->send(camera); Time::now() < deadline;) {
      const auto update = (*client)->receive(10ms);
      const auto exchanged = (*client)->exchangeEdits(held);
      ASSERT_TRUE(exchanged) << exchanged.error().message;
      if (held.complete() && directory->find("default")->ground().edit == edit && held.known() == edit) return;
    }
    FAIL() << "the edits did not come";
  };
  follow(0);
  EXPECT_EQ(held.version(), 0u);
  std::mt19937_64 random(9);
  std::uint64_t edit = 0;
  for (const char* const operation :
       {R"({"op":"crater","x":10,"z":-80,"radius":20,"depth":6,"material":"earth"})",
        R"({"op":"road","line":[[-150,0],[0,60],[900,40]],"width":8,"material":"asphalt"})",
        R"({"op":"level","x":-90,"z":-60,"radius":30,"height":300})", R"({"op":"smooth","x":0,"z":50,"radius":30})",
        R"({"op":"undo","edit":1})", R"({"op":"undo","edit":3})"}) {
    const auto made = editor.edit(operation);
    ASSERT_TRUE(made) << made.error().message;
    ASSERT_EQ(made->number, ++edit);
    follow(edit);
    const auto theirs = directory->find("default")->terrain();
    const edits::EditedTerrain mine(base, held.layer());
    for (int k = 0; k < 5000; ++k) {
      const lattice::Point p{static_cast<Step>(random() % m(1200)) - m(250), static_cast<Step>(random() % m(400)) - m(200)};
      float a = 0, b = 0;
      mine.heights({&p.x, 1}, {&p.z, 1}, {&a, 1});
      theirs->heights({&p.x, 1}, {&p.z, 1}, {&b, 1});
      ASSERT_EQ(a, b) << operation;
      ASSERT_EQ(held.layer()->materialAt(p), dynamic_cast<const edits::EditedTerrain&>(*theirs).layer()->materialAt(p));
    }
  }
}

TEST_F(EditsTest, AreInAnswersThatAreComputedHere) {
  Member a(port(), "ann");
  ASSERT_TRUE(a.edit(craterAt(10, -80)));
  Member b(port(), "bob"), blind(port(), "blind", false);
  const query::Ground ground(b.connection(), kTimeout), asks(blind.connection(), kTimeout);
  ASSERT_EQ(ground.source(), query::Ground::Source::kLocal);
  ASSERT_EQ(asks.source(), query::Ground::Source::kServer);  // it would not hear of edits
  const double own = base->height({m(10), m(-80)});
  EXPECT_NEAR(ground.height(10, -80).value(), own - 8.0 / 3, 0.02);
  ASSERT_TRUE(a.edit(R"({"op":"undo","edit":1})"));
  const auto deadline = Time::now() + kTimeout;
  while (std::abs(ground.height(10, -80).value() - own) > 0.01 && Time::now() < deadline) std::this_thread::sleep_for(1ms);
  EXPECT_EQ(ground.height(10, -80).value(), asks.height(10, -80).value());
}

TEST_F(EditsTest, AGroundTellsWhereItWasEdited) {
  Member a(port(), "ann"), b(port(), "bob");
  query::Ground ground(b.connection(), kTimeout);
  EXPECT_EQ(ground.hash(), terrain::contentHash(*base));
  EXPECT_TRUE(ground.since(0).changes.empty());
  ASSERT_TRUE(a.edit(craterAt(10, -80)));
  ground.know(1);
  ASSERT_TRUE(ground.hear());
  const query::News news = ground.since(0);
  EXPECT_EQ(news.heard, 1u);
  EXPECT_EQ(news.awaited, 1u);
  ASSERT_EQ(news.changes.size(), 1u);
  EXPECT_EQ(news.changes[0].edit, 1u);
  EXPECT_TRUE(news.changes[0].area.holds({m(10), m(-80)}));
  EXPECT_FALSE(news.changes[0].area.holds({m(10), m(-100)}));
  EXPECT_TRUE(ground.since(1).changes.empty());
  const std::uint64_t hash = ground.hash();
  EXPECT_NE(hash, terrain::contentHash(*base));
  const Step x = m(10), z = m(-80);
  float height = 0;
  std::uint64_t edit = 0;
  ASSERT_TRUE(ground.heights({&x, 1}, {&z, 1}, {&height, 1}, &edit));
  EXPECT_EQ(edit, 1u);
  Member c(port(), "cid"), d(port(), "dan");
  const query::Ground late(c.connection(), kTimeout);
  ASSERT_TRUE(late.hear());
  EXPECT_EQ(late.hash(), hash);
  ASSERT_TRUE(a.edit(R"({"op":"undo","edit":1})"));
  query::Ground last(d.connection(), kTimeout);
  last.know(2);
  ASSERT_TRUE(last.hear());
  EXPECT_NE(last.hash(), hash);
  EXPECT_EQ(last.since(1).changes.size(), 1u) << "an undo changes ground, too";
}

TEST_F(EditsTest, TravelByHttp) {
  const std::string made = ask("POST", "edits", craterAt(3, 4), "Idempotency-Key: a\r\n");
  has(made, " 201 ");
  has(made, "{\"number\": 1}");
  has(ask("POST", "edits", craterAt(3, 4), "Idempotency-Key: a\r\n"), "{\"number\": 1}");
  has(ask("POST", "edits", R"({"op":"crater"})"), " 422 ");
  has(ask("POST", "edits", "{"), "JSON object");
  has(ask("DELETE", "edits/1"), "{\"number\": 2}");
  has(ask("DELETE", "edits/1"), "undone already");
  has(ask("DELETE", "edits/0"), " 422 ");
  has(ask("DELETE", "edits/x"), " 400 ");
  has(ask("PUT", "edits"), " 405 ");
  const std::string list = ask("GET", "edits");
  has(list, "\"last\": 2");
  has(list, craterAt(3, 4));
  has(list, R"({"edit":1,"op":"undo"})");
  EXPECT_EQ(ask("GET", "edits?since=1").find("crater"), std::string::npos);
  has(ask("GET", "edits?since=-1"), " 400 ");
  has(ask("GET", "edits?limit=5000"), " 400 ");
}

TEST_F(EditsTest, AnswersByHttpSayWhichTheyKnow) {
  const std::string ofPlace = "heights?at=3,4", tile = "heights/12/2048/2048.png?at=0,0";
  for (const std::string& path : {ofPlace, tile}) {
    has(ask("GET", path), "Ridgecast-Edit: 0\r\n");
    has(ask("GET", path, "", "Ridgecast-Edit: 1\r\n"), "Edit 1 has not been made in session 'default'; its last edit is 0.");
    has(ask("GET", path, "", "Ridgecast-Edit: last\r\n"), " 400 ");
  }
  has(ask("POST", "edits", craterAt(3, 4)), "{\"number\": 1}");
  for (const std::string& path : {ofPlace, tile}) {
    has(ask("GET", path, "", "Ridgecast-Edit: 1\r\n"), "Ridgecast-Edit: 1\r\n");
    has(ask("GET", path, "", "Ridgecast-Edit: 2\r\n"), " 409 ");
  }
}

// How long from an edit to each of sixteen checked meshes.
void reachMembers(std::uint16_t port, const terrain::Terrain& base) {
  constexpr int kMembers = testing_support::kSanitized ? 3 : 16, kEdits = testing_support::kSanitized ? 3 : 12;
  const double y = base.height({0, 0}) + 60;
  std::vector<std::unique_ptr<Member>> members;
  for (int k = 0; k < kMembers; ++k) members.push_back(std::make_unique<Member>(port, "m" + std::to_string(k)));
  std::vector<double> waits;
  std::mutex mutex;
  std::atomic<std::int64_t> asked{0};
  std::atomic<int> behind{0}, total{0};
  std::vector<std::jthread> threads;
  for (int k = 0; k < kMembers; ++k)
    threads.emplace_back([&, k](const std::stop_token& stop) {
      Member& member = *members[static_cast<std::size_t>(k)];
      std::uint64_t seen = 0;
      for (int step = 0; !stop.stop_requested(); ++step) {
        member.stand(5 * std::cos(k) + 0.1 * step, 5 * std::sin(k), y);
        const auto next = Time::now() + 100ms;
        while (Time::now() < next && !stop.stop_requested()) {
          if (!member.follow(5ms)) continue;
          ++total;
          if (member.edit() <= seen) continue;
          seen = member.edit();
          const std::lock_guard lock(mutex);
          waits.push_back(
              std::chrono::duration<double, std::milli>(Time::now().time_since_epoch() - std::chrono::nanoseconds(asked)).count());
          --behind;
        }
      }
    });
  const auto rate = [&](Time::time_point since, int before) {
    return (total - before) / std::chrono::duration<double>(Time::now() - since).count() / kMembers;
  };
  EXPECT_TRUE(testing_support::await([&] { return total >= 5 * kMembers; }));  // the meshes are there
  auto since = Time::now();
  int before = total;
  if (testing_support::measures()) std::this_thread::sleep_for(3s);
  const double alone = rate(since, before);
  since = Time::now();
  before = total;
  for (int k = 0; k < kEdits; ++k) {
    behind = kMembers;
    asked = Time::now().time_since_epoch().count();
    const auto made = members[0]->connection().edit({0, "", craterAt(3 * k - 40, -60 - k)}).get();
    ASSERT_TRUE(made) << made.error().message;
    for (const auto deadline = Time::now() + kTimeout; behind > 0 && Time::now() < deadline;) std::this_thread::sleep_for(1ms);
    ASSERT_EQ(behind, 0);
    std::this_thread::sleep_for(50ms);
  }
  const double edited = rate(since, before);
  threads.clear();
  std::sort(waits.begin(), waits.end());
  std::printf(
      "from edit to checked mesh, %d members: median %.1f ms, p99 %.1f ms, worst %.1f ms; iterations a second of each %.1f, %.1f without "
      "edits\n",
      kMembers, waits[waits.size() / 2], waits[waits.size() * 99 / 100], waits.back(), edited, alone);
}

// A hundred milliseconds away; measured beside the server, too.
TEST_F(EditsTest, ReachSixteenMembers) {
  if (testing_support::measures()) reachMembers(port(), *base);
  testing_support::Relay relay(port(), {.delay = 50ms});
  reachMembers(relay.port(), *base);
}

}  // namespace
}  // namespace ridgecast
