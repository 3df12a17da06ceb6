#include "server/session/grounds.h"

#include <gtest/gtest.h>

#include <cmath>
#include <condition_variable>
#include <random>

#include "common/codec/codec.h"
#include "common/wire/wire.h"
#include "tests/support/waiting.h"

namespace ridgecast::session {
namespace {

using namespace std::chrono_literals;
using lattice::Step;

class Listener final : public Sender {
 public:
  void send(wire::ServerMessage message, std::shared_ptr<const void>) override {
    const std::lock_guard lock(mutex_);
    grounds_.push_back(std::get<wire::Ground>(std::move(message)));
    changed_.notify_all();
  }
  std::size_t queuedBytes() const override { return 0; }
  void fail(wire::ErrorMessage message) override {
    const std::lock_guard lock(mutex_);
    error_ = message.message;
    changed_.notify_all();
  }
  std::optional<wire::Ground> next() {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, 4 * testing_support::kTimeout, [&] { return taken_ < grounds_.size() || !error_.empty(); });
    EXPECT_EQ(error_, "");
    if (taken_ == grounds_.size()) return std::nullopt;
    return grounds_[taken_++];
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<wire::Ground> grounds_;
  std::size_t taken_ = 0;
  std::string error_;
};

class GroundsTest : public testing::Test {
 protected:
  // What can be reached is reached, however slow the machine is.
  std::shared_ptr<Grounds> over(const std::string& terrain, std::uint32_t budget = 200'000) {
    terrain_ = terrain::create(terrain, 5).value();
    return std::make_shared<Grounds>(terrain_, budget, executor.makePool(), listener, testing_support::kTimeout);
  }
  scheduling::Executor executor{2};
  std::shared_ptr<Listener> listener = std::make_shared<Listener>();
  std::shared_ptr<const terrain::Terrain> terrain_;
};

TEST_F(GroundsTest, CoversTheCircleWithinTheErrorItStates) {
  std::mt19937_64 random(3);
  for (const char* name : {"alpine", "canyon", "archipelago"}) {
    const auto grounds = over(name);
    for (const auto& [radius, error] : {std::pair(15.0, 0.1), std::pair(60.0, 0.5)}) {
      const lattice::Point at{1'234'567, -7'654'321};
      ASSERT_TRUE(grounds->ask({7, at, radius, error}));
      const auto ground = listener->next();
      ASSERT_TRUE(ground);
      EXPECT_EQ(ground->id, 7u);
      EXPECT_LE(ground->error, 2 * error) << name;
      std::vector<std::pair<mesh::LeafMesh, double>> leaves;
      for (const wire::LeafWhole& leaf : ground->leaves) {
        auto mesh = codec::decodeLeaf(leaf.payload, leaf.address, leaf.vertices, leaf.triangles);
        ASSERT_TRUE(mesh) << mesh.error().message;
        leaves.emplace_back(std::move(*mesh), leaf.error);
      }
      for (int k = 0; k < 500; ++k) {
        const double angle = std::uniform_real_distribution<double>(0, 6.28318)(random);
        const double far = std::sqrt(std::uniform_real_distribution<double>(0, 1)(random)) * radius * 256;
        const lattice::Point place{at.x + static_cast<Step>(far * std::cos(angle)), at.z + static_cast<Step>(far * std::sin(angle))};
        bool covered = false;
        for (const auto& [leaf, bound] : leaves)
          for (const mesh::Triangle& t : leaf.triangles) {
            const auto &a = leaf.vertices[t[0]], &b = leaf.vertices[t[1]], &c = leaf.vertices[t[2]];
            const Step x = place.x - leaf.address.x(), z = place.z - leaf.address.z();
            const auto side = [&](const mesh::LocalVertex& p, const mesh::LocalVertex& q) {
              return (Step{q.z} - p.z) * (x - p.x) - (Step{q.x} - p.x) * (z - p.z);
            };
            const double wa = static_cast<double>(side(b, c)), wb = static_cast<double>(side(c, a)), wc = static_cast<double>(side(a, b));
            if (wa < 0 || wb < 0 || wc < 0) continue;
            covered = true;
            const double height = (wa * a.y + wb * b.y + wc * c.y) / (wa + wb + wc) / 256;
            EXPECT_LE(std::abs(height - terrain_->height(place)), bound + 0.002) << name;
          }
        EXPECT_TRUE(covered) << name << " at " << far / 256 << " m of " << radius;
      }
    }
    grounds->close();
  }
}

TEST_F(GroundsTest, WhatCannotBeReachedSaysWhatWas) {
  const auto grounds = over("alpine", 10'000);
  ASSERT_TRUE(grounds->ask({1, {0, 0}, 300, 0.05}));
  const auto ground = listener->next();
  ASSERT_TRUE(ground);
  EXPECT_GT(ground->error, 0.05);
  EXPECT_FALSE(ground->leaves.empty());
}

TEST_F(GroundsTest, OnlySoManyAtATimeAndNoneAfterTheEnd) {
  const auto grounds = over("alpine");
  std::size_t taken = 0;
  for (std::size_t k = 0; k < 3 * wire::kMaxGrounds; ++k) taken += grounds->ask({k, {0, 0}, 200, 0.2});
  EXPECT_GE(taken, wire::kMaxGrounds);
  EXPECT_LT(taken, 3 * wire::kMaxGrounds);
  grounds->close();
}

}  // namespace
}  // namespace ridgecast::session
