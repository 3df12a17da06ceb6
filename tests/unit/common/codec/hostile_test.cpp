// Bytes that nobody encoded: always an error or a canonical leaf, never a crash and never much memory.
#include <sys/resource.h>

#include <gtest/gtest.h>

#include "common/codec/codec.h"
#include "tests/support/leaf_meshes.h"
#include "tests/support/sanitized.h"

namespace ridgecast {
namespace {

using support::between;
using support::Random;
using Bytes = std::vector<std::uint8_t>;

struct Sample {
  mesh::LeafMesh leaf;
  Bytes payload;
};

Sample sampleOf(mesh::LeafMesh leaf) {
  Bytes payload = codec::encodeLeaf(leaf);
  return {std::move(leaf), std::move(payload)};
}

std::vector<Sample> samples() {
  Random random(11);
  std::vector<Sample> all;
  all.push_back(sampleOf(support::terrainLike(random, 1, 0)));
  all.push_back(sampleOf(support::terrainLike(random, 2, 2)));
  all.push_back(sampleOf(support::terrainLike(random, 9, 0)));
  all.push_back(sampleOf(support::torn(random, support::terrainLike(random, 9, 1), 0.4)));
  all.push_back(sampleOf(support::randomTin(random, 120)));
  return all;
}

Outcome<mesh::LeafMesh> decode(std::span<const std::uint8_t> bytes, const Sample& sample) {
  return codec::decodeLeaf(bytes, sample.leaf.address, static_cast<std::uint32_t>(sample.leaf.vertices.size()),
                           static_cast<std::uint32_t>(sample.leaf.triangles.size()));
}

void expectSane(const Outcome<mesh::LeafMesh>& decoded, const Sample& sample) {
  if (!decoded) {
    EXPECT_FALSE(decoded.error().message.empty());
    return;
  }
  EXPECT_TRUE(mesh::isCanonical(*decoded));
  EXPECT_EQ(decoded->vertices.size(), sample.leaf.vertices.size());
  EXPECT_EQ(decoded->triangles.size(), sample.leaf.triangles.size());
  for (const mesh::Triangle& t : decoded->triangles)
    EXPECT_GT(support::doubledArea(decoded->vertices[t[0]], decoded->vertices[t[1]], decoded->vertices[t[2]]), 0);
  for (const mesh::LocalVertex& v : decoded->vertices)
    EXPECT_LE(std::max({std::abs(v.x), std::abs(v.z), std::abs(v.y)}), codec::kMaxOffset);
}

TEST(HostilePayload, EveryTruncatedPrefixIsRefused) {
  for (const Sample& sample : samples())
    for (std::size_t length = 0; length < sample.payload.size(); ++length) {
      const Bytes prefix(sample.payload.begin(), sample.payload.begin() + static_cast<std::ptrdiff_t>(length));  // a fresh allocation
      EXPECT_FALSE(decode(prefix, sample)) << length << " of " << sample.payload.size();
    }
}

TEST(HostilePayload, BytesBehindTheEndAreRefused) {
  for (const Sample& sample : samples()) {
    Bytes longer = sample.payload;
    longer.push_back(0);
    EXPECT_FALSE(decode(longer, sample));
  }
}

TEST(HostilePayload, FlippedBitsNeverYieldANonCanonicalLeaf) {
  for (const Sample& sample : samples())
    for (std::size_t bit = 0; bit < 8 * sample.payload.size(); ++bit) {
      Bytes changed = sample.payload;
      changed[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
      expectSane(decode(changed, sample), sample);
    }
}

TEST(HostilePayload, SeveralChangedBytesNeverYieldANonCanonicalLeaf) {
  Random random(12);
  for (const Sample& sample : samples())
    for (int round = 0; round < 3000; ++round) {
      Bytes changed = sample.payload;
      for (std::int64_t k = between(random, 1, 6); k > 0; --k)
        changed[static_cast<std::size_t>(between(random, 0, static_cast<std::int64_t>(changed.size()) - 1))] =
            static_cast<std::uint8_t>(between(random, 0, 255));
      expectSane(decode(changed, sample), sample);
    }
}

TEST(HostilePayload, RandomBytes) {
  Random random(13);
  for (int round = 0; round < 3000; ++round) {
    Bytes bytes(static_cast<std::size_t>(between(random, 0, 300)));
    for (std::uint8_t& b : bytes) b = static_cast<std::uint8_t>(between(random, 0, 255));
    if (!bytes.empty()) bytes[0] = round % 2 == 0 ? 0x10 : 0x11;
    if (bytes.size() > 2) bytes[2] &= 0x7f;
    EXPECT_FALSE(codec::decodeLeaf(bytes, {0, 0, 0}, static_cast<std::uint32_t>(between(random, 3, 30)),
                                   static_cast<std::uint32_t>(between(random, 10, 30))));
  }
}

TEST(HostilePayload, CountsThatContradictThePayloadAreRefused) {
  for (const Sample& sample : samples()) {
    const auto v = static_cast<std::uint32_t>(sample.leaf.vertices.size()), t = static_cast<std::uint32_t>(sample.leaf.triangles.size());
    for (auto [vertices, triangles] : std::vector<std::pair<std::uint32_t, std::uint32_t>>{
             {v + 1, t}, {v - 1, t}, {v, t + 1}, {v, t - 1}, {0, 0}, {0, t}, {v, 0}, {~0u, ~0u}, {v, ~0u}, {~0u, t}, {3u << 20, 1u << 20}})
      EXPECT_FALSE(codec::decodeLeaf(sample.payload, sample.leaf.address, vertices, triangles)) << vertices << ' ' << triangles;
  }
}

TEST(HostilePayload, LimitsAreKept) {
  const Sample sample = samples()[2];
  const auto v = static_cast<std::uint32_t>(sample.leaf.vertices.size()), t = static_cast<std::uint32_t>(sample.leaf.triangles.size());
  EXPECT_TRUE(codec::decodeLeaf(sample.payload, sample.leaf.address, v, t, {.maxTriangles = t, .maxPayloadBytes = sample.payload.size()}));
  EXPECT_FALSE(codec::decodeLeaf(sample.payload, sample.leaf.address, v, t, {.maxTriangles = t - 1}));
  EXPECT_FALSE(codec::decodeLeaf(sample.payload, sample.leaf.address, v, t, {.maxPayloadBytes = sample.payload.size() - 1}));
}

// Writes the plain form by hand, so that it can be wrong in ways that the encoder cannot be.
struct Plain {
  Bytes bytes{0x10, 0, 0};
  Plain& put(std::initializer_list<int> values) {
    for (int v : values) bytes.push_back(static_cast<std::uint8_t>(v));
    return *this;
  }
  Outcome<mesh::LeafMesh> decode(std::uint32_t vertices, std::uint32_t triangles) const {
    return codec::decodeLeaf(bytes, {0, 0, 0}, vertices, triangles);
  }
};

TEST(HostilePayload, PlainFormsThatLie) {
  // vertices (0,0,0) (0,9,0) (7,0,0): zigzag deltas
  EXPECT_TRUE(Plain().put({0, 0, 0, /**/ 0, 0, 0, 0, 18, 0, 7, 17, 0, /**/ 0, 0, 1}).decode(3, 1));
  const auto wrong = [](std::initializer_list<int> bytes, std::uint32_t v, std::uint32_t t, const char* what) {
    const auto decoded = Plain().put(bytes).decode(v, t);
    ASSERT_FALSE(decoded);
    EXPECT_NE(decoded.error().message.find(what), std::string::npos) << decoded.error().message;
  };
  wrong({0, 0, 0, 0, 0, 0, 0, 18, 0, 7, 17, 0, 0, 1, 0}, 3, 1, "counter-clockwise");
  wrong({0, 0, 0, 0, 0, 0, 0, 18, 0, 0, 18, 0, 0, 0, 1}, 3, 1, "counter-clockwise");  // on one line
  wrong({0, 0, 0, 0, 0, 0, 0, 18, 0, 7, 17, 0, 0, 0, 2}, 3, 1, "not there");
  wrong({0, 0, 0, 0, 0, 0, 0, 18, 0, 7, 19, 0, 0, 0, 1}, 3, 1, "out of range");   // z below the least
  wrong({0, 0, 0, 0, 0, 0, 0, 18, 0, 7, 17, 0, 0, 0, 1, 0, 0, 1}, 3, 2, "same");  // the same triangle twice
  wrong({0, 0, 0, 0, 0, 0, 0, 18, 0, 7, 17, 0, 0, 0, 2, 0, 0, 2}, 4, 2, "too short");
  // Four vertices, two of them at one place with different heights, each used.
  wrong({0, 0, 0, 0, 0, 0, 0, 18, 0, 7, 17, 0, 0, 0, 2, 0, 0, 1, 0, 0, 2}, 4, 2, "share a place");
  wrong({0xff, 0xff, 0xff, 0xff, 0x0f, 0, 0, 0, 0, 0, 0, 18, 0, 7, 17, 0, 0, 0, 1}, 3, 1, "least coordinates");
}

TEST(HostilePayload, CostsLittleMemory) {
  // Every byte of a Draco stream raised to values that announce as much as they can, with as many triangles as are accepted announced:
  // what is refused must be refused before it is paid for.
  const Sample sample = samples()[2];
  rusage before{}, after{};
  getrusage(RUSAGE_SELF, &before);
  for (std::size_t at = 0; at + 4 < sample.payload.size(); ++at)
    for (std::uint8_t value : {0x7f, 0xff}) {
      Bytes changed = sample.payload;
      for (std::size_t k = 0; k < 4; ++k) changed[at + k] = value;
      changed[at + 4] &= 0x7f;
      (void)decode(changed, sample);
      (void)codec::decodeLeaf(changed, sample.leaf.address, 3u << 20, 1u << 20);
    }
  getrusage(RUSAGE_SELF, &after);
  EXPECT_TRUE(testing_support::kSanitized || after.ru_maxrss - before.ru_maxrss < 64 * 1024) << after.ru_maxrss << " KiB";
}

}  // namespace
}  // namespace ridgecast
