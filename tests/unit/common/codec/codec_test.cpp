// Law: decode(encode(leaf)) is bit for bit the leaf, whatever its shape.
#include "common/codec/codec.h"

#include <gtest/gtest.h>

#include "tests/support/leaf_meshes.h"

namespace ridgecast {
namespace {

using support::between;
using support::Random;

void expectRoundTrip(const mesh::LeafMesh& leaf) {
  ASSERT_TRUE(mesh::isCanonical(leaf));
  const std::vector<std::uint8_t> payload = codec::encodeLeaf(leaf);
  EXPECT_EQ(payload.empty(), leaf.triangles.empty());
  EXPECT_LE(payload.size(), codec::largestPayload(static_cast<std::uint32_t>(leaf.triangles.size())));
  const auto decoded = codec::decodeLeaf(payload, leaf.address, static_cast<std::uint32_t>(leaf.vertices.size()),
                                         static_cast<std::uint32_t>(leaf.triangles.size()));
  ASSERT_TRUE(decoded) << decoded.error().message;
  EXPECT_TRUE(*decoded == leaf) << leaf.triangles.size() << " triangles";
  EXPECT_EQ(payload, codec::encodeLeaf(*decoded));
}

TEST(Codec, EmptyLeafIsAnEmptyPayload) { expectRoundTrip({.address = {3, -2, 7}, .vertices = {}, .triangles = {}}); }

TEST(Codec, OneTriangle) {
  expectRoundTrip({.address = {0, 0, 0}, .vertices = {{0, 0, 5}, {0, 9, -5}, {7, 0, 0}}, .triangles = {{0, 1, 2}}});
}

TEST(Codec, WorkedExampleOfTheProtocol) {
  const mesh::LeafMesh leaf{.address = {0, 0, 0}, .vertices = {{0, 0, 0}, {0, 9, 0}, {7, 0, 0}}, .triangles = {{0, 1, 2}}};
  EXPECT_EQ(codec::encodeLeaf(leaf), (std::vector<std::uint8_t>{0x10, 0, 0, 0, 0, 0, /**/ 0, 0, 0, 0, 0x12, 0, 7, 0x11, 0, /**/ 0, 0, 1}));
}

TEST(Codec, RandomTriangulations) {
  Random random(1);
  for (int points : {3, 4, 5, 7, 9, 12, 20, 40, 45, 60, 100, 300, 1000})
    for (int k = 0; k < 30; ++k) expectRoundTrip(support::randomTin(random, points));
}

TEST(Codec, TornTriangulationsWithPinchesIslandsAndHoles) {
  Random random(2);
  for (double share : {0.05, 0.3, 0.5, 0.8, 0.95})
    for (int n : {2, 4, 8, 20}) {
      for (int k = 0; k < 10; ++k) expectRoundTrip(support::torn(random, support::terrainLike(random, n, k % 8), share));
      for (int k = 0; k < 10; ++k) expectRoundTrip(support::torn(random, support::randomTin(random, 4 * n * n), share));
    }
}

TEST(Codec, ManyTrianglesThatMeetInOneVertexOnly) {
  for (int wings : {2, 3, 8, 40, 200}) {
    mesh::LeafMesh leaf{.address = {0, 0, 0}, .vertices = {{0, 0, 0}}, .triangles = {}};
    for (int k = 0; k < wings; ++k) {
      const double from = 2 * M_PI * k / wings, to = from + M_PI / wings;
      for (double angle : {from, to})
        leaf.vertices.push_back({static_cast<std::int32_t>(std::lround(1e6 * std::cos(angle))),
                                 static_cast<std::int32_t>(std::lround(-1e6 * std::sin(angle))), k});
      const auto last = static_cast<std::uint32_t>(leaf.vertices.size() - 1);
      leaf.triangles.push_back({0, last - 1, last});
    }
    mesh::canonicalize(leaf);
    expectRoundTrip(leaf);
  }
}

TEST(Codec, ExtremeCoordinates) {
  const std::int32_t far = codec::kMaxOffset, high = lattice::kMaxHeight;
  expectRoundTrip({.address = {10, -5, 5}, .vertices = {{-far, -far, -high}, {-far, far, high}, {far, -far, 0}}, .triangles = {{0, 1, 2}}});
  expectRoundTrip(
      {.address = {10, -5, 5}, .vertices = {{-far, -far, -high}, {-far, far - 1, high}, {far, -far + 1, 1}}, .triangles = {{0, 1, 2}}});
  // Wide and full: more than the values that Draco is given, in more triangles than the plain form is meant for.
  Random random(3);
  std::vector<mesh::LocalVertex> points;
  for (int k = 0; k < 400; ++k)
    points.push_back({static_cast<std::int32_t>(between(random, -far, far)), static_cast<std::int32_t>(between(random, -far, far)),
                      static_cast<std::int32_t>(between(random, -high, high))});
  expectRoundTrip(support::sweep({10, 0, 0}, points));
}

TEST(Codec, CommonPowersOfTwoCostNothing) {
  Random random(4);
  mesh::LeafMesh fine = support::terrainLike(random, 12, 0), coarse = fine;
  for (mesh::LocalVertex& v : coarse.vertices) v = {v.x * 64, v.z * 64, v.y * 32};
  EXPECT_NEAR(static_cast<double>(codec::encodeLeaf(coarse).size()), static_cast<double>(codec::encodeLeaf(fine).size()), 8);
  expectRoundTrip(coarse);
}

TEST(Codec, TakesFewBytes) {
  Random random(5);
  const auto bytesPerTriangle = [&](int n, int level, int leaves) {
    std::size_t bytes = 0, triangles = 0;
    for (int k = 0; k < leaves; ++k) {
      const mesh::LeafMesh leaf = support::terrainLike(random, n, level);
      bytes += codec::encodeLeaf(leaf).size();
      triangles += leaf.triangles.size();
    }
    return static_cast<double>(bytes) / static_cast<double>(triangles);
  };
  EXPECT_LT(bytesPerTriangle(2, 0, 100), 12);  // the first grid of a leaf, in the plain form
  EXPECT_LT(bytesPerTriangle(12, 3, 40), 2.7);
  EXPECT_LT(bytesPerTriangle(32, 0, 10), 2.3);
}

TEST(Codec, EncodesTheSameBytesEveryTime) {
  Random random(6);
  for (int k = 0; k < 20; ++k) {
    const mesh::LeafMesh leaf = support::randomTin(random, 50 * (k + 1));
    EXPECT_EQ(codec::encodeLeaf(leaf), codec::encodeLeaf(mesh::LeafMesh(leaf)));
  }
}

}  // namespace
}  // namespace ridgecast
