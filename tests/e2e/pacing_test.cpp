// Free pacing with the real server: the newest pose wins, nobody is sent more than the window, a slow client gets fewer iterations, and a
// camera at rest gets silence.

#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <set>
#include <vector>

#include "tests/support/flier.h"
#include "tests/support/server_process.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using namespace testing_support;

wire::Settings coarse() {
  wire::Settings s;
  s.threshold = 4;
  return s;
}

// Takes iterations until one says that nothing is left to refine at pose `sequence`; false when that does not come.
bool rest(Flier& flier, std::uint64_t sequence) {
  const auto until = std::chrono::steady_clock::now() + kTimeout;
  while (std::chrono::steady_clock::now() < until)
    if (const auto i = flier.take(200ms); i && i->settled && i->poseSequence == sequence) return true;
  return false;
}

TEST(FreePacing, TheNewestPoseWinsAndACameraAtRestGetsSilence) {
  ServerProcess server(RIDGECAST_SERVER);
  Flier flier(server.url(), coarse(), wire::Pacing::kFree);
  const PathCamera path(RIDGECAST_PATHS "/alpine.json", flier.world());
  // Poses faster than they can be answered: most are passed over, and what is answered only gets newer.
  std::vector<camera::Camera> cameras;
  for (int k = 0; k < 5000; ++k) cameras.push_back(path.at(k * 0.002));
  std::uint64_t last = 0, lastPose = 0;
  std::set<std::uint64_t> answered;
  bool rests = false;  // the last pose may have been answered for good before it is waited for
  for (std::size_t k = 0; k < cameras.size(); ++k) {
    last = flier.send(cameras[k]);
    rests = false;
    if (k % 50 != 49) continue;
    while (const auto i = flier.take(0ms)) {
      rests = i->settled && i->poseSequence == last;
      answered.insert(i->poseSequence);
      EXPECT_GE(i->poseSequence, lastPose);
      lastPose = i->poseSequence;
    }
  }
  EXPECT_LT(answered.size(), 2500u);
  EXPECT_TRUE(rests || rest(flier, last));
  EXPECT_FALSE(flier.take(1s)) << "an iteration although nothing changed";
  EXPECT_FALSE(flier.connection().error());
  const MeshReport report = flier.check();
  EXPECT_TRUE(report.clean()) << report.text();
  // A new pose wakes it.
  EXPECT_TRUE(rest(flier, flier.send(path.at(12))));
  EXPECT_TRUE(server.healthy());
}

TEST(FreePacing, ASlowClientGetsFewerIterationsAndNeverMoreThanTheWindow) {
  constexpr std::uint64_t kWindow = 3;
  ServerProcess server(RIDGECAST_SERVER, {"--window", "3"});
  Flier quick(server.url(), coarse(), wire::Pacing::kFree), slow(server.url(), coarse(), wire::Pacing::kFree);
  ASSERT_EQ(slow.world().window, kWindow);
  const PathCamera path(RIDGECAST_PATHS "/alpine.json", quick.world());
  // Both ask for the same; the slow one takes an iteration for each tenth of the quick one.
  std::uint64_t last = 0;
  for (int k = 1; k <= 60; ++k) {
    quick.send(path.at(0.1 * k));
    last = slow.send(path.at(0.1 * k));
    ASSERT_TRUE(quick.take(kTimeout));
    if (k % 10 > 0) continue;
    ASSERT_TRUE(slow.take(kTimeout));
  }
  // The connection ends a stream that exceeds the window: it has not. What waited is at most the window; then comes the newest pose.
  EXPECT_FALSE(slow.connection().error()) << slow.connection().error()->message;
  bool newest = false;
  for (std::uint64_t k = 0; k <= kWindow && !newest; ++k) {
    const auto i = slow.take(kTimeout);
    ASSERT_TRUE(i);
    newest = i->poseSequence == last;
  }
  EXPECT_TRUE(newest);
  EXPECT_TRUE(rest(slow, slow.send(path.at(5))));
  EXPECT_TRUE(server.healthy());
}

TEST(FreePacing, NothingIsSentBeyondTheWindowWithoutAnAcknowledgement) {
  ServerProcess server(RIDGECAST_SERVER, {"--window", "2"});
  wire::Hello hello;
  hello.settings = coarse();
  const auto url = core::parseUrl(server.url());
  auto connected = link::Connection::open(*url, hello, {.reconnects = false, .timeout = kTimeout});
  ASSERT_TRUE(connected) << connected.error().message;
  link::Connection& c = **connected;
  const PathCamera path(RIDGECAST_PATHS "/alpine.json", c.world());
  std::vector<wire::Iteration> got;
  for (int k = 1; k <= 20; ++k) {
    c.send({static_cast<std::uint64_t>(k), path.at(k)});
    if (auto r = c.receive(got.size() < 2 ? std::chrono::milliseconds(kTimeout) : 100ms)) got.push_back(std::move(r->iteration));
  }
  ASSERT_EQ(got.size(), 2u);
  // One word about both opens the window again, and what comes is for the newest pose.
  core::Scene held;
  for (const wire::Iteration& i : got) ASSERT_TRUE(held.apply(i));
  EXPECT_EQ(held.hash(), got[1].meshHash);
  c.acknowledge({2, held.hash()});
  const auto third = c.receive(kTimeout);
  ASSERT_TRUE(third);
  EXPECT_EQ(third->iteration.number, 3u);
  EXPECT_EQ(third->iteration.poseSequence, 20u);
  EXPECT_TRUE(server.healthy());
}

// Forty cameras at once share the machine: all of them get on, none is forgotten.
TEST(Cameras, ManyShareFairly) {
  ServerProcess server(RIDGECAST_SERVER);
  wire::Settings settings;
  settings.threshold = 50;
  std::vector<std::unique_ptr<Flier>> fliers;
  for (int k = 0; k < 40; ++k) fliers.push_back(std::make_unique<Flier>(server.url(), settings));
  const PathCamera path(RIDGECAST_PATHS "/alpine.json", fliers[0]->world());
  for (int n = 0; n < 5; ++n) {
    for (auto& f : fliers) f->send(path.at(n * 0.2));
    for (auto& f : fliers) ASSERT_TRUE(f->take(kTimeout));
  }
  for (auto& f : fliers) EXPECT_EQ(f->scene().hash(), fliers[0]->scene().hash());
  EXPECT_TRUE(server.healthy());
}

}  // namespace
}  // namespace ridgecast
