// The law of a handover: a mesh made of a checkpoint has the leaves, triangles and heights of the one that it was taken of, to the bit, and
// goes on as soundly. Meshes lie on grids full of cocircular points, where only the tie rule says which triangles there are.
#include "server/handover/checkpoint.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"
#include "common/terrain/terrain.h"
#include "server/pipeline/pipeline.h"
#include "tests/support/flight.h"
#include "tests/support/mesh_check.h"
#include "tests/support/random_edits.h"
#include "tests/support/sanitized.h"
#include "tests/support/verify.h"

namespace ridgecast::handover {
namespace {

using pipeline::Pipeline;

constexpr std::uint64_t kWorld = 77;

struct Server {
  Server(std::shared_ptr<const terrain::Terrain> ground, const settings::Settings& wanted, unsigned threads)
      : terrain(std::move(ground)),
        executor(threads),
        pool(executor.makePool(threads)),
        mesh(std::make_unique<Pipeline>(terrain, pipeline::grant(wanted, {}), pool)) {}
  std::uint64_t hash() const {
    std::uint64_t sum = 0;
    for (const mesh::LeafState& leaf : mesh->leaves()) sum += mesh::hashTerm(leaf.address, leaf.hash);
    return sum;
  }
  std::string checkpoint(std::uint64_t edit = 0) const {
    const auto bytes = encode({kWorld, edit, hash(), *mesh->state()}, *terrain);
    EXPECT_TRUE(bytes);
    return bytes.value_or("");
  }
  // Whether it has the mesh now.
  bool restore(const std::string& bytes, const camera::Camera& camera) {
    const auto checkpoint = decode(bytes, kWorld, *terrain, 2'000'000);
    EXPECT_TRUE(checkpoint);
    if (!checkpoint || !mesh->restore(checkpoint->mesh, camera)) return false;
    EXPECT_EQ(hash(), checkpoint->meshHash);
    return true;
  }
  void expectSound() const {
    EXPECT_EQ(testing_support::verify(mesh->mesh()), "");
    EXPECT_EQ(testing_support::verify(mesh->mesh().mesh().triangulation(), mesh->mesh()), "");
    for (const mesh::LeafState& leaf : mesh->leaves()) ASSERT_EQ(mesh::hashLeaf(mesh->extract(leaf.address)), leaf.hash);
  }

  std::shared_ptr<const terrain::Terrain> terrain;
  scheduling::Executor executor;
  std::shared_ptr<scheduling::Pool> pool;
  std::unique_ptr<Pipeline> mesh;
};

class Flight {
 public:
  Flight(const terrain::Terrain& terrain, std::mt19937_64& random) : terrain_(terrain), random_(random) {}
  camera::Camera next() {
    if (random_() % 25 == 0) x_ = uniform(-1e6, 1e6), z_ = uniform(-1e6, 1e6);
    const double stride = random_() % 4 == 0 ? 400 : 5;
    x_ += uniform(-stride, stride);
    z_ += uniform(-stride, stride);
    if (random_() % 10 == 0) altitude_ = std::pow(10, uniform(0, 4));
    return testing_support::cameraAt(terrain_, x_, z_, altitude_, uniform(-3, 3), uniform(-1.5, 0.3));
  }

 private:
  double uniform(double from, double to) { return std::uniform_real_distribution<double>(from, to)(random_); }
  const terrain::Terrain& terrain_;
  std::mt19937_64& random_;
  double x_ = 0, z_ = 0, altitude_ = 100;
};

settings::Settings randomSettings(std::mt19937_64& random) {
  settings::Settings out;
  out.metric =
      std::array{settings::Metric::kPixels, settings::Metric::kPixels, settings::Metric::kArea, settings::Metric::kThesis}[random() % 4];
  if (out.metric != settings::Metric::kThesis) out.threshold = std::array{0.7, 2.0, 6.0}[random() % 3];
  out.triangleBudget = std::array{20'000u, 60'000u, 200'000u}[random() % 3];
  if (random() % 4 == 0) out.colourError = 0.2;
  return out;
}

TEST(Handover, ARestoredMeshIsTheSameAndGoesOn) {
  std::size_t bytes = 0, vertices = 0;
  for (unsigned seed = 1; seed <= static_cast<unsigned>(testing_support::rounds(12)); ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto terrain = terrain::create(std::array{"alpine", "canyon", "archipelago"}[seed % 3], seed).value();
    const settings::Settings settings = randomSettings(random);
    Server before(terrain, settings, 2);
    Flight flight(*terrain, random);
    camera::Camera camera;
    for (std::size_t n = 3 + random() % 30; n > 0; --n) before.mesh->iterate(camera = random() % 3 == 0 && n < 3 ? camera : flight.next());
    const std::string checkpoint = before.checkpoint();
    bytes += checkpoint.size();
    vertices += before.mesh->state()->vertices.size();

    Server after(terrain, settings, 1);
    ASSERT_TRUE(after.restore(checkpoint, camera));
    EXPECT_EQ(after.mesh->state()->leaves, before.mesh->state()->leaves);
    EXPECT_EQ(after.mesh->state()->vertices, before.mesh->state()->vertices);
    after.expectSound();
    EXPECT_EQ(after.checkpoint(), checkpoint);
    if (seed % 4 == 0) camera = flight.next();  // the client has moved on
    int n = 0;
    for (; n < 400 && !after.mesh->settled(); ++n) after.mesh->iterate(camera);
    EXPECT_TRUE(after.mesh->settled());
    after.expectSound();
    for (int k = 0; k < 8; ++k) after.mesh->iterate(flight.next());
    after.expectSound();
  }
  EXPECT_LT(static_cast<double>(bytes) / static_cast<double>(vertices), 3.0);
  RecordProperty("bytes_a_vertex_x100", static_cast<int>(100 * static_cast<double>(bytes) / static_cast<double>(vertices)));
}

// Edits under way: the next server may know more of them, and says so with its next ground.
TEST(Handover, HeightsAreThoseOfTheEditThatTheClientKnows) {
  const auto base = terrain::create("alpine", 7).value();
  for (int seed = 1; seed <= testing_support::rounds(6); ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(static_cast<unsigned>(seed));
    edits::History history(base);
    const lattice::Point middle{static_cast<lattice::Step>(random() % 100'000), 5'000};
    const auto edit = [&] {
      std::vector<lattice::Area> areas;
      for (int k = 0; k < 5;) {
        const auto prepared = history.prepare(testing_support::randomOperation(random, middle));
        if (!prepared) continue;
        if (const auto posts = history.add(*prepared)) areas.push_back(edits::groundOf(*posts)), ++k;
      }
      return areas;
    };
    edit();
    const auto early = std::make_shared<edits::EditedTerrain>(base, history.layer());
    const std::vector<lattice::Area> changed = edit();
    const auto late = std::make_shared<edits::EditedTerrain>(base, history.layer());
    const camera::Camera camera =
        testing_support::cameraAt(*early, static_cast<double>(middle.x) / 256, static_cast<double>(middle.z) / 256 + 60, 40, 0, -0.5);
    const settings::Settings settings{.threshold = 1, .triangleBudget = 100'000};
    Server before(early, settings, 2);
    for (int k = 0; k < 12; ++k) before.mesh->iterate(camera);

    Server after(late, settings, 2);
    ASSERT_TRUE(after.restore(before.checkpoint(5), camera));
    after.expectSound();
    EXPECT_EQ(after.mesh->state()->vertices, before.mesh->state()->vertices);
    after.mesh->setGround(late, changed);
    after.mesh->iterate(camera);
    after.expectSound();
    const std::vector<refinement::StoredVertex> vertices = after.mesh->state()->vertices;
    EXPECT_TRUE(std::ranges::all_of(vertices, [&](const refinement::StoredVertex& v) { return v.y == late->heightStep(v.at); }));
  }
}

TEST(Handover, SaysWhatIsNotACheckpointOfThisWorld) {
  const auto terrain = terrain::create("canyon", 3).value();
  Server before(terrain, {.threshold = 8, .triangleBudget = 20'000}, 1);
  before.mesh->iterate(testing_support::cameraAt(*terrain, 0, 0, 200, 0, -0.4));
  const std::string whole = before.checkpoint();
  EXPECT_EQ(decode(whole, kWorld + 1, *terrain, 1'000'000).error().message, "A checkpoint of a camera is of another world.");
  EXPECT_EQ(decode(whole, kWorld, *terrain, before.mesh->state()->vertices.size() - 1).error().message,
            "A checkpoint of a camera has more vertices than it may have now.");
  EXPECT_TRUE(decode(whole, kWorld, *terrain, before.mesh->state()->vertices.size()));
  for (std::size_t size = 0; size < whole.size(); size += size < 100 || size + 100 > whole.size() ? 1 : 97) {
    const std::string prefix(whole.data(), size);
    EXPECT_EQ(decode(prefix, kWorld, *terrain, 1'000'000).error().message, "A checkpoint of a camera is damaged.");
  }
}

// The hash at the end, by its definition.
std::string sealed(std::string bytes) {
  bytes.resize(bytes.size() - 8);
  std::uint64_t hash = bytes.size();
  for (std::size_t k = 0; k < bytes.size(); k += 8) {
    std::uint64_t word = 0;
    for (std::size_t n = 0; n < 8 && k + n < bytes.size(); ++n) word |= std::uint64_t{static_cast<std::uint8_t>(bytes[k + n])} << (8 * n);
    hash = lattice::mix(hash + lattice::mix(word));
  }
  for (int n = 0; n < 8; ++n) bytes.push_back(static_cast<char>(hash >> (8 * n)));
  return bytes;
}

// With the right hash: whatever is taken for a mesh is a sound one.
TEST(Handover, HostileBytesMakeNoUnsoundMesh) {
  const auto terrain = terrain::create("alpine", 3).value();
  const camera::Camera camera = testing_support::cameraAt(*terrain, 0, 0, 300, 0, -0.4);
  const settings::Settings settings{.threshold = 20, .triangleBudget = 20'000};
  Server before(terrain, settings, 1);
  before.mesh->iterate(camera);
  const std::string whole = before.checkpoint();
  EXPECT_EQ(sealed(whole), whole);
  std::mt19937_64 random(5);
  int refused = 0, decoded = 0, restored = 0;
  for (int k = 0; k < 600; ++k) {
    std::string bytes = whole;
    if (k % 3 == 0) bytes.resize(60 + random() % (bytes.size() - 60));
    for (std::size_t n = 1 + random() % 3; n > 0 && k % 3 != 0; --n)
      bytes[k % 3 == 1 ? random() % 60 : random() % bytes.size()] ^= static_cast<char>(1u << random() % 8);
    const auto checkpoint = decode(sealed(bytes), kWorld, *terrain, 40'000);
    if (!checkpoint) {
      ++refused;
      continue;
    }
    ++decoded;
    if (decoded > testing_support::rounds(60)) continue;  // slow
    Server after(terrain, settings, 1);
    if (!after.mesh->restore(checkpoint->mesh, camera)) {
      after.mesh->iterate(camera);  // it begins from nothing
      EXPECT_EQ(after.hash(), before.hash());
      continue;
    }
    ++restored;
    after.expectSound();
    after.mesh->iterate(camera);
    after.expectSound();
  }
  std::printf("%d refused, %d decoded, %d of these restored\n", refused, decoded, restored);
  EXPECT_GT(refused, 100);
  EXPECT_GT(decoded, 10);
}

}  // namespace
}  // namespace ridgecast::handover
