// Samples of a height map on their way to a client.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <condition_variable>
#include <mutex>

#include "server/directory/directory.h"
#include "server/session/session.h"
#include "tests/support/waiting.h"
#include "tests/unit/server/member/scripted.h"

namespace ridgecast::session {
namespace {

using testing::HasSubstr;

// Heights that are samples: each tile level, at a height that tells it.
class Terraces final : public terrain::Terrain, public terrain::Raster {
 public:
  std::string_view name() const override { return "terraces"; }
  std::string_view source() const override { return "// terraces"; }
  std::uint32_t seed() const override { return 1; }
  const terrain::Raster* raster() const override { return this; }
  void heights(std::span<const lattice::Step>, std::span<const lattice::Step>, std::span<float> out) const override {
    std::ranges::fill(out, 0.0f);
  }
  const terrain::RasterShape& shape() const override { return shape_; }
  void tile(terrain::TileAddress a, terrain::Tile& out) const override { out.fill(static_cast<std::int32_t>(100 * a.i + a.j)); }

 private:
  terrain::RasterShape shape_{.width = 2, .height = 2};
};

class Listener final : public conversation::Sender {
 public:
  void send(wire::ServerMessage message, std::shared_ptr<const void>) override {
    const std::lock_guard lock(mutex_);
    if (auto* world = std::get_if<wire::World>(&message)) world_ = *world;
    if (auto* tiles = std::get_if<wire::HeightTiles>(&message))
      for (wire::HeightTile& tile : tiles->tiles) tiles_.push_back(std::move(tile));
    changed_.notify_all();
  }
  void sendShared(std::shared_ptr<const std::string>, std::shared_ptr<const void>) override {}
  std::size_t queuedBytes() const override { return queued; }
  void fail(wire::ErrorMessage message) override {
    const std::lock_guard lock(mutex_);
    error_ = message.message;
    changed_.notify_all();
  }
  bool wait(const std::function<bool()>& until) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, testing_support::kTimeout, until);
  }
  std::atomic<std::size_t> queued{0};
  std::mutex mutex_;
  std::condition_variable changed_;
  wire::World world_;
  std::vector<wire::HeightTile> tiles_;
  std::string error_;
};

class Tiles : public testing::Test {
 protected:
  void start(std::shared_ptr<const terrain::Terrain> terrain, bool sendsTerrain = true) {
    TearDown();
    listener = std::make_shared<Listener>();
    auto resources = std::make_shared<Resources>();
    resources->executor = (executor = std::make_unique<scheduling::Executor>(2)).get();
    auto script = std::make_shared<Script>();
    script->next = [](int, const camera::Camera&) { return Script::State{{{{1, 0, 0}, 1}}, true}; };
    resources->makeMesh = scriptedMeshes(script);
    resources->limits.sendsTerrain = sendsTerrain;
    directory = std::make_unique<Directory>(resources, std::move(terrain));
    auto session = directory->find(kDefaultName);
    camera = std::make_shared<CameraSession>(session, std::move(*session->enter()), 1, listener);
    camera->receive(wire::Hello{});
  }
  void TearDown() override {
    if (camera) camera->close();
    camera.reset();
    executor.reset();
  }
  std::string refusal(std::vector<terrain::TileAddress> wanted) {
    camera->receive(wire::WantTiles{std::move(wanted)});
    listener->wait([&] { return !listener->error_.empty(); });
    return listener->error_;
  }
  std::unique_ptr<scheduling::Executor> executor;
  std::unique_ptr<Directory> directory;
  std::shared_ptr<Listener> listener;
  std::shared_ptr<CameraSession> camera;
};

TEST_F(Tiles, comeInTheOrderInWhichTheyWereWanted) {
  start(std::make_shared<Terraces>());
  std::vector<terrain::TileAddress> wanted;
  for (std::int64_t k = 0; k < 60; ++k) wanted.push_back({k, -k});
  camera->receive(wire::WantTiles{wanted});
  ASSERT_TRUE(listener->wait([&] { return listener->tiles_.size() == wanted.size(); }));
  EXPECT_EQ(listener->world_.heightMap, Terraces().shape());
  for (std::size_t k = 0; k < wanted.size(); ++k) {
    EXPECT_EQ(listener->tiles_[k].address, wanted[k]);
    EXPECT_EQ(terrain::decodeTile(listener->tiles_[k].samples).value()[7], static_cast<std::int32_t>(99 * k));
  }
}

TEST_F(Tiles, waitForRoomAndAreBounded) {
  start(std::make_shared<Terraces>());
  ASSERT_TRUE(listener->wait([&] { return listener->world_.heightMap.has_value(); }));
  listener->queued = 100u << 20;
  for (int k = 0; k < 4; ++k) camera->receive(wire::WantTiles{std::vector<terrain::TileAddress>(64)});
  EXPECT_THAT(refusal({{0, 0}}), HasSubstr("More than 256 tiles wait"));
  EXPECT_TRUE(listener->tiles_.empty());
}

TEST_F(Tiles, areOnlyWhereThereAreSamplesToShow) {
  start(flatTerrain());
  EXPECT_THAT(refusal({{0, 0}}), HasSubstr("no height map"));
  start(std::make_shared<Terraces>(), false);
  EXPECT_THAT(refusal({{0, 0}}), HasSubstr("no height map"));
  EXPECT_FALSE(listener->world_.heightMap) << "private";
  start(std::make_shared<Terraces>());
  EXPECT_THAT(refusal({{std::int64_t{1} << 50, 0}}), HasSubstr("beyond the lattice"));
}

}  // namespace
}  // namespace ridgecast::session
