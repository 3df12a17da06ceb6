#include "server/questions/grounds.h"

#include <gtest/gtest.h>

#include <cmath>
#include <condition_variable>
#include <future>
#include <random>

#include "common/codec/codec.h"
#include "common/wire/wire.h"
#include "tests/support/waiting.h"

namespace ridgecast::session {
namespace {

using questions::Grounds;

using namespace std::chrono_literals;
using lattice::Step;

class GroundListener final : public conversation::Sender {
 public:
  void send(wire::ServerMessage message, std::shared_ptr<const void>) override {
    const std::lock_guard lock(mutex_);
    grounds_.push_back(std::get<wire::Ground>(std::move(message)));
    changed_.notify_all();
  }
  void sendShared(std::shared_ptr<const std::string>, std::shared_ptr<const void>) override {}
  std::size_t queuedBytes() const override { return 0; }
  void fail(wire::ErrorMessage message) override {
    const std::lock_guard lock(mutex_);
    error_ = message.message;
    changed_.notify_all();
  }
  std::size_t answers() const {
    const std::lock_guard lock(mutex_);
    return grounds_.size() + !error_.empty();
  }
  std::optional<wire::Ground> next() {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, 4 * testing_support::kTimeout, [&] { return taken_ < grounds_.size() || !error_.empty(); });
    EXPECT_EQ(error_, "");
    if (taken_ == grounds_.size()) return std::nullopt;
    return grounds_[taken_++];
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<wire::Ground> grounds_;
  std::size_t taken_ = 0;
  std::string error_;
};

class GroundsTest : public testing::Test {
 protected:
  std::shared_ptr<Grounds> over(const std::string& terrain, std::uint32_t budget = 200'000) {
    terrain_ = terrain::create(terrain, 5).value();
    return std::make_shared<Grounds>([this] { return editing::Ground{terrain_, 0}; }, budget, queue, listener, testing_support::kTimeout);
  }
  scheduling::Executor executor{2};
  std::shared_ptr<SlotQueue> queue = QueryQueues(executor).grounds;
  std::shared_ptr<GroundListener> listener = std::make_shared<GroundListener>();
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
      EXPECT_EQ(ground->refusal, "");
      EXPECT_EQ(ground->id, 7u);
      EXPECT_LE(ground->error, error) << name;
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

TEST_F(GroundsTest, ALargeGroundLeavesOthersTheirTurns) {
  scheduling::Executor one(1);
  terrain_ = terrain::create("alpine", 5).value();
  const auto grounds = std::make_shared<Grounds>(
      [this] {
        return editing::Ground{terrain_, 0};
      },
      500'000, QueryQueues(one).grounds, listener);
  ASSERT_TRUE(grounds->ask({1, {0, 0}, 4096, 0.02}));
  const auto honest = one.makePool();
  for (int k = 0; k < 50; ++k) {
    std::promise<void> done;
    ASSERT_TRUE(honest->post([&] { done.set_value(); }));
    done.get_future().wait();
    ASSERT_EQ(listener->answers(), 0u) << "the ground was finished before turn " << k << " of somebody else";
  }
  grounds->close();
}

TEST_F(GroundsTest, WhatComesKeepsTheErrorAskedFor) {
  for (const char* name : {"alpine", "canyon", "archipelago"}) {
    const auto grounds = over(name);
    for (const double error : {0.03, 0.05, 0.2, 2.0})
      for (Step k = 0; k < 4; ++k) {
        ASSERT_TRUE(grounds->ask({7, {k * 777'777, -k * 555'555}, 20, error}));
        const auto ground = listener->next();
        ASSERT_TRUE(ground);
        EXPECT_LE(ground->error, error) << name << " " << k;
      }
    grounds->close();
  }
}

// The number before " m fits".
double fittingError(const std::string& sentence) {
  const auto end = sentence.find(" m fits");
  if (end == std::string::npos) return 0;
  return std::stod(sentence.substr(sentence.rfind(' ', end - 1) + 1));
}

TEST_F(GroundsTest, WhatDoesNotFitSaysWhichErrorFitsAndItDoes) {
  const auto answerTo = [&](const char* name, double radius, double error) {
    const auto grounds = over(name, 10'000);
    EXPECT_TRUE(grounds->ask({1, {0, 0}, radius, error}));
    const auto ground = listener->next();
    EXPECT_TRUE(ground && ground->id == 1 && ground->leaves.empty() == !ground->refusal.empty());
    return ground ? *ground : wire::Ground{};
  };
  int refused = 0;
  for (const char* name : {"alpine", "canyon", "archipelago"})
    for (const auto& [radius, error] : {std::pair(300.0, 0.02), std::pair(1000.0, 0.1), std::pair(2000.0, 0.5)}) {
      const std::string sentence = answerTo(name, radius, error).refusal;
      if (sentence.empty()) continue;
      ++refused;
      EXPECT_EQ(answerTo(name, radius, error).refusal, sentence) << "the answer depends on nothing but the question";
      const double fits = fittingError(sentence);
      ASSERT_GT(fits, error) << sentence;
      const wire::Ground ground = answerTo(name, radius, fits);
      EXPECT_EQ(ground.refusal, "") << name << ", after: " << sentence;
      EXPECT_LE(ground.error, fits);
    }
  EXPECT_GE(refused, 6);
}

// Fences 20 m high and 2 m thick, 30 m apart.
class Fences final : public terrain::Terrain {
 public:
  std::string_view name() const override { return "fences"; }
  std::string_view source() const override { return {}; }
  std::uint32_t seed() const override { return 1; }
  void heights(std::span<const Step> x, std::span<const Step> z, std::span<float> out) const override {
    for (std::size_t k = 0; k < x.size(); ++k) out[k] = (x[k] % 7680 + 7680) % 7680 < 512 ? 20.0f : static_cast<float>(z[k] % 4096) / 4096;
  }
};

TEST_F(GroundsTest, CliffsSayWhichErrorFitsAndItDoes) {
  terrain_ = std::make_shared<Fences>();
  const auto grounds = std::make_shared<Grounds>(
      [this] {
        return editing::Ground{terrain_, 0};
      },
      200'000, queue, listener, testing_support::kTimeout);
  double error = 0.5;
  ASSERT_TRUE(grounds->ask({1, {0, 0}, 25, error}));
  auto ground = listener->next();
  ASSERT_TRUE(ground);
  if (!ground->refusal.empty()) {
    error = fittingError(ground->refusal);
    ASSERT_GT(error, 0.5) << ground->refusal;
    ASSERT_TRUE(grounds->ask({2, {0, 0}, 25, error}));
    ground = listener->next();
    ASSERT_TRUE(ground);
  }
  EXPECT_EQ(ground->refusal, "");
  EXPECT_LE(ground->error, error);
}

TEST_F(GroundsTest, AQuestionHasOneDeadline) {
  terrain_ = terrain::create("alpine", 5).value();
  const auto grounds = std::make_shared<Grounds>([this] { return editing::Ground{terrain_, 0}; }, 500'000, queue, listener, 0s);
  ASSERT_TRUE(grounds->ask({3, {0, 0}, 4096, 0.02}));
  const auto ground = listener->next();
  ASSERT_TRUE(ground);
  EXPECT_EQ(ground->id, 3u);
  EXPECT_NE(ground->refusal.find("not ready within 0 s"), std::string::npos) << ground->refusal;
}

TEST_F(GroundsTest, FewerAreInWorkThanThereAreThreads) {
  for (const unsigned threads : {1u, 4u}) {
    scheduling::Executor some(threads);
    const auto shared = QueryQueues(some).grounds;
    EXPECT_EQ(shared->slots(), std::max(1u, threads - 1));
    terrain_ = terrain::create("alpine", 5).value();
    std::vector<std::shared_ptr<Grounds>> cameras;
    for (std::uint64_t k = 0; k < 8; ++k) {
      cameras.push_back(std::make_shared<Grounds>(
          [this] {
            return editing::Ground{terrain_, 0};
          },
          200'000, shared, listener, testing_support::kTimeout));
      ASSERT_TRUE(cameras.back()->ask({k, {0, 0}, 100, 0.5}));
    }
    cameras[6]->close();  // gone while it waits: takes nobody's place
    cameras.erase(cameras.begin() + 6);
    for (std::size_t k = 0; k < cameras.size(); ++k) {
      EXPECT_LE(shared->working(), shared->slots());
      ASSERT_TRUE(listener->next());
    }
    EXPECT_TRUE(testing_support::await([&] { return shared->working() == 0; }));
  }
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
