#include "common/gltf/glb.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "tests/support/glb_file.h"
#include "tests/support/leaf_meshes.h"

namespace ridgecast::gltf {
namespace {

using testing_support::GlbFile;
using testing_support::readGlb;

// Sound triangulations of random points of a leaf, some of them beyond its sides, on the lattice of its level.
mesh::LeafMesh randomLeaf(lattice::LeafAddress address, int points, unsigned seed) {
  support::Random random(seed);
  const int bits = lattice::horizontalBits(address.level), vertical = lattice::verticalBits(address.level);
  std::vector<mesh::LocalVertex> vertices;
  const auto side = address.side() >> bits;
  for (int k = 0; k < points; ++k)
    vertices.push_back({static_cast<std::int32_t>(support::between(random, -side / 8, side + side / 8) << bits),
                        static_cast<std::int32_t>(support::between(random, -side / 8, side + side / 8) << bits),
                        static_cast<std::int32_t>(support::between(random, -1'000'000, 2'000'000) >> vertical << vertical)});
  mesh::LeafMesh leaf = support::sweep(address, vertices);
  mesh::canonicalize(leaf);
  return leaf;
}

struct World {
  std::vector<mesh::LeafMesh> meshes;
  Document document;
};

World make(lattice::Point at) {
  World w;
  unsigned seed = 1;
  for (const int level : {0, 1, 4, 8, 9}) {
    lattice::LeafAddress address = lattice::leafAt(at, level);
    for (const int points : {3, 4, 9, 300}) {
      w.meshes.push_back(randomLeaf(address, points, ++seed));
      ++address.i;
    }
    w.meshes.push_back({address, {}, {}});
  }
  std::mt19937 random(5);
  std::uniform_real_distribution<float> unit(-1, 1);
  w.document.materialNames = {"", "rock", "mud", "moor"};
  for (const mesh::LeafMesh& mesh : w.meshes) {
    Leaf leaf{.mesh = &mesh};
    for (std::size_t k = 0; k < mesh.vertices.size(); ++k) {
      const float x = unit(random), z = unit(random), y = 0.2f + std::abs(unit(random)), n = std::sqrt(x * x + y * y + z * z);
      leaf.normals.push_back({x / n, y / n, z / n});
      leaf.colours.push_back(
          {static_cast<std::uint16_t>(random()), static_cast<std::uint16_t>(random()), static_cast<std::uint16_t>(random())});
      leaf.materials.push_back(static_cast<std::uint8_t>(random() % 4));
    }
    w.document.leaves.push_back(std::move(leaf));
  }
  w.document.origin = at;
  w.document.extras = R"({"terrain": "x", "seed": 4294967295, "deep": {"list": [1, 2.5, "three", true]}})";
  return w;
}

TEST(Glb, HoldsTheSameLatticePointsPlainAndCompressed) {
  for (const std::int64_t metres : {std::int64_t{0}, std::int64_t{-123'456'789}, std::int64_t{1'000'000'000'000}}) {
    const World w = make({metres * 256 + 77, -metres * 256 + 1});
    for (const Compression compression : {Compression::kNone, Compression::kDraco}) {
      const auto bytes = writeGlb(w.document, compression);
      ASSERT_TRUE(bytes) << bytes.error().message;
      EXPECT_EQ(*bytes, *writeGlb(w.document, compression));  // the same question, the same bytes
      EXPECT_EQ(*bytes, *writeGlb(w.document, compression, {}, [](std::size_t count, const auto& body) {
        for (std::size_t k = count; k-- > 0;) body(k);
      }));
      const std::string text(bytes->substr(20, bytes->find("BIN") - 20));
      EXPECT_EQ(text.find(".0,"), std::string::npos);  // whole numbers are written as such, addresses far away, too
      EXPECT_EQ(text.find("e+"), std::string::npos);
      const GlbFile file = readGlb(*bytes);
      ASSERT_EQ(file.leaves.size(), w.meshes.size());
      for (std::size_t k = 0; k < w.meshes.size(); ++k) {
        EXPECT_EQ(file.leaves[k].mesh, w.meshes[k]);
        EXPECT_EQ(file.leaves[k].compressed, compression == Compression::kDraco && !w.meshes[k].triangles.empty());
      }
      EXPECT_EQ(file.json.contains("extensionsRequired"), compression == Compression::kDraco);
      EXPECT_EQ(file.json["asset"]["extras"]["seed"], 4294967295u);
      EXPECT_EQ(file.json["asset"]["extras"]["deep"]["list"][2], "three");
    }
  }
}

TEST(Glb, NormalsColoursAndMaterialsSurvive) {
  const World w = make({0, 0});
  for (const Compression compression : {Compression::kNone, Compression::kDraco}) {
    const GlbFile file = readGlb(*writeGlb(w.document, compression));
    const bool plain = compression == Compression::kNone;
    for (std::size_t k = 0; k < w.meshes.size(); ++k)
      for (std::size_t v = 0; v < w.meshes[k].vertices.size(); ++v) {
        const auto& p = w.meshes[k].vertices[v];
        const auto normal = file.leaves[k].normals.at({p.x, p.z}), colour = file.leaves[k].colours.at({p.x, p.z});
        EXPECT_EQ(file.leaves[k].materials.at({p.x, p.z}), w.document.materialNames[w.document.leaves[k].materials[v]]);
        double dot = 0;
        for (std::size_t c = 0; c < 3; ++c) {
          dot += double(normal[c]) * w.document.leaves[k].normals[v][c];
          EXPECT_NEAR(colour[c], w.document.leaves[k].colours[v][c] / 65535.0, plain ? 1e-5 : 0.51 / ((1 << kColourBits) - 1));
        }
        EXPECT_GT(dot, std::cos((plain ? 0.05 : 1.0) * std::numbers::pi / 180));
      }
  }
}

// The camera node's axes, by the definition of a quaternion, are the pose's.
TEST(Glb, TheCameraLooksWhereThePoseLooks) {
  World w = make({0, 0});
  for (const double yaw : {0.0, 0.7, -2.5, 3.1})
    for (const double pitch : {0.0, -0.4, 1.2}) {
      camera::Camera camera;
      camera.pose.x = 256 * 5000;
      camera.pose.y = 1234.5;
      camera.pose.z = -256;
      camera.pose.yaw = yaw;
      camera.pose.pitch = pitch;
      w.document.origin = {camera.pose.x, camera.pose.z};
      w.document.camera = camera;
      const GlbFile file = readGlb(*writeGlb(w.document, Compression::kNone));
      ASSERT_EQ(file.json["scenes"].size(), 2u);
      const auto& node = file.json["nodes"][file.json["scenes"][1]["nodes"][0].get<std::size_t>()];
      EXPECT_EQ(node["translation"][0], 5000.0 - 4096);
      EXPECT_EQ(node["translation"][1], 1234.5);
      EXPECT_EQ(node["translation"][2], 4096.0 - 1);
      const auto q = node["rotation"].get<std::array<double, 4>>();
      EXPECT_NEAR(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3], 1, 1e-12);
      const auto rotated = [&](double x, double y, double z) {  // v + 2 u x (u x v + w v)
        const double tx = q[1] * z - q[2] * y + q[3] * x, ty = q[2] * x - q[0] * z + q[3] * y, tz = q[0] * y - q[1] * x + q[3] * z;
        return camera::Vec3{x + 2 * (q[1] * tz - q[2] * ty), y + 2 * (q[2] * tx - q[0] * tz), z + 2 * (q[0] * ty - q[1] * tx)};
      };
      const camera::Vec3 look = rotated(0, 0, -1), right = rotated(1, 0, 0), forward = camera::forward(camera.pose),
                         aside = camera::right(camera.pose);
      EXPECT_NEAR(look.x, forward.x, 1e-12);
      EXPECT_NEAR(look.y, forward.y, 1e-12);
      EXPECT_NEAR(look.z, forward.z, 1e-12);
      EXPECT_NEAR(right.x, aside.x, 1e-12);
      EXPECT_NEAR(right.y, aside.y, 1e-12);
      EXPECT_NEAR(right.z, aside.z, 1e-12);
      EXPECT_EQ(file.json["cameras"][0]["perspective"]["yfov"], camera.projection.verticalFov);
    }
}

TEST(Glb, StopsWhenAsked) {
  const World w = make({0, 0});
  std::stop_source source;
  source.request_stop();
  EXPECT_FALSE(writeGlb(w.document, Compression::kDraco, source.get_token()));
}

}  // namespace
}  // namespace ridgecast::gltf
