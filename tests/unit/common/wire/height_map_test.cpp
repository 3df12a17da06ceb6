// The messages of height maps and private terrains: there and back, and refused where they cannot be.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/wire/wire.h"
#include "tests/support/bytes.h"

namespace ridgecast::wire {
namespace {

using testing_support::bytesOf;

using testing::HasSubstr;

World worldWith(const terrain::RasterShape& shape) {
  World world;
  world.session = "default";
  world.horizon = 32000;
  world.window = 4;
  world.heightMap = shape;
  return world;
}
const terrain::RasterShape kShape{.x = {-5, terrain::pitchOf(7680)},
                                  .z = {lattice::kMaxPosition, 26'843'546},
                                  .width = 10,
                                  .height = 20,
                                  .lowest = -300,
                                  .highest = 4,
                                  .content = 77,
                                  .draped = true};

TEST(HeightMapWire, comesBackAsItWas) {
  World world = worldWith(kShape);
  world.shadedVertices = true;
  const auto decoded = decodeServer(bytesOf(encode(ServerMessage(world))));
  ASSERT_TRUE(decoded) << decoded.error().message;
  EXPECT_EQ(std::get<World>(*decoded).heightMap, kShape);
  EXPECT_TRUE(std::get<World>(*decoded).shadedVertices);
  const auto wanted = decodeClient(bytesOf(encode(ClientMessage(WantTiles{{{3, -4}, {0, 0}}}))));
  ASSERT_TRUE(wanted);
  EXPECT_EQ(std::get<WantTiles>(*wanted).tiles, (std::vector<terrain::TileAddress>{{3, -4}, {0, 0}}));
  const auto tiles = decodeServer(bytesOf(encode(ServerMessage(HeightTiles{{{{-1, 9}, {1, 2, 3}, {4, 5}}}}))));
  ASSERT_TRUE(tiles);
  EXPECT_EQ(std::get<HeightTiles>(*tiles).tiles.at(0).address, (terrain::TileAddress{-1, 9}));
  EXPECT_EQ(std::get<HeightTiles>(*tiles).tiles.at(0).samples, (std::vector<std::uint8_t>{1, 2, 3}));
  EXPECT_EQ(std::get<HeightTiles>(*tiles).tiles.at(0).colours, (std::vector<std::uint8_t>{4, 5}));
  Iteration iteration;
  iteration.number = 1;
  iteration.whole.push_back({{0, 1, 2}, 3, 1, {9}, 0, {1, 2, 3, 4, 5}});
  iteration.shades = {6, 7, 8, 9, 10};
  const auto back = decodeServer(bytesOf(encode(ServerMessage(iteration))));
  ASSERT_TRUE(back);
  EXPECT_EQ(std::get<Iteration>(*back).whole[0].shades, iteration.whole[0].shades);
  EXPECT_EQ(std::get<Iteration>(*back).shades, iteration.shades);
}

TEST(HeightMapWire, whatCannotBeIsRefused) {
  for (const auto& change : std::vector<std::function<void(terrain::RasterShape&)>>{
           [](auto& s) { s.x.pitch = terrain::kMinPitch - 1; }, [](auto& s) { s.z.pitch = terrain::kMaxPitch + 1; },
           [](auto& s) { s.x.origin = lattice::kMaxPosition + 1; }, [](auto& s) { s.width = 1; }, [](auto& s) { s.lowest = 5; },
           [](auto& s) { s.highest = terrain::kMaxSample + 1; }}) {
    terrain::RasterShape shape = kShape;
    change(shape);
    const auto decoded = decodeServer(bytesOf(encode(ServerMessage(worldWith(shape)))));
    ASSERT_FALSE(decoded);
    EXPECT_THAT(decoded.error().message, HasSubstr("HeightMap."));
  }
  EXPECT_FALSE(decodeClient(bytesOf(encode(ClientMessage(WantTiles{std::vector<terrain::TileAddress>(kMaxTiles + 1)})))));
  EXPECT_FALSE(decodeClient(bytesOf(encode(ClientMessage(WantTiles{{{INT64_MIN, 0}}})))));
  HeightTiles tiles;
  tiles.tiles.push_back({{0, 0}, std::vector<std::uint8_t>(terrain::kMaxTileBytes + 1)});
  EXPECT_FALSE(decodeServer(bytesOf(encode(ServerMessage(tiles)))));
  tiles.tiles[0] = {{0, 0}, {}, std::vector<std::uint8_t>(terrain::kTileColourBytes + 1)};
  EXPECT_FALSE(decodeServer(bytesOf(encode(ServerMessage(tiles)))));
  tiles.tiles.assign(kMaxTiles + 1, {});
  EXPECT_FALSE(decodeServer(bytesOf(encode(ServerMessage(tiles)))));
}

}  // namespace
}  // namespace ridgecast::wire
