// Reads exported files back with nothing but a JSON parser and the container's layout.
#include "client/evaluation/recorder.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <string>

namespace ridgecast::evaluation {
namespace {

using Json = nlohmann::json;
using core::Leaves;

struct Glb {
  Json json;
  std::string bin;
};

Glb read(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), {});
  const auto u32 = [&](std::size_t at) {
    std::uint32_t v = 0;
    std::memcpy(&v, bytes.data() + at, 4);
    return v;
  };
  EXPECT_EQ(bytes.substr(0, 4), "glTF");
  EXPECT_EQ(u32(4), 2u);
  EXPECT_EQ(u32(8), bytes.size());
  const std::uint32_t jsonLength = u32(12);
  EXPECT_EQ(bytes.substr(16, 4), "JSON");
  Glb out{Json::parse(bytes.substr(20, jsonLength)), {}};
  if (20 + jsonLength < bytes.size()) {
    EXPECT_EQ(bytes.substr(24 + jsonLength, 3), "BIN");
    out.bin = bytes.substr(28 + jsonLength, u32(20 + jsonLength));
  }
  return out;
}

template <class T>
std::vector<T> values(const Glb& glb, int accessor, std::size_t width) {
  const Json& a = glb.json["accessors"][static_cast<std::size_t>(accessor)];
  const Json& v = glb.json["bufferViews"][a["bufferView"].get<std::size_t>()];
  std::vector<T> out(a["count"].get<std::size_t>() * width);
  const std::size_t offset = v.value("byteOffset", 0u) + a.value("byteOffset", 0u);
  EXPECT_EQ(offset % sizeof(T), 0u);
  EXPECT_LE(offset + out.size() * sizeof(T), glb.bin.size());
  std::memcpy(out.data(), glb.bin.data() + offset, out.size() * sizeof(T));
  return out;
}

class Export : public testing::Test {
 protected:
  void TearDown() override { std::filesystem::remove(file_); }
  const std::filesystem::path file_ = std::filesystem::temp_directory_path() / ("ridgecast-export-" + std::to_string(getpid()) + ".glb");
};

void hold(Leaves& leaves, mesh::LeafMesh leaf) {
  core::HeldLeaf held;
  const lattice::LeafAddress address = leaf.address;
  held.mesh = std::make_shared<mesh::LeafMesh>(std::move(leaf));
  leaves[address] = std::move(held);
}

mesh::LeafMesh randomLeaf(lattice::LeafAddress address, std::size_t triangles, unsigned seed) {
  std::mt19937 random(seed);
  mesh::LeafMesh leaf{address, {}, {}};
  const auto side = static_cast<std::int32_t>(address.side());
  for (std::size_t k = 0; k < triangles + 2; ++k)
    leaf.vertices.push_back({static_cast<std::int32_t>(random() % (side + 200)) - 100,
                             static_cast<std::int32_t>(random() % (side + 200)) - 100,
                             static_cast<std::int32_t>(random() % 2000000) - 500000});
  for (std::uint32_t k = 0; k < triangles; ++k) leaf.triangles.push_back({k, k + 1, k + 2});
  return leaf;
}

void checkFile(const Glb& glb, const Leaves& leaves, lattice::Step cellX, lattice::Step cellZ) {
  const Json& nodes = glb.json["nodes"];
  ASSERT_EQ(nodes.size(), leaves.size());
  EXPECT_EQ(glb.json["scenes"][0]["nodes"].size(), leaves.size());
  EXPECT_FALSE(glb.json.contains("extensionsRequired"));
  std::size_t empty = 0;
  for (const Json& node : nodes) {
    const Json& extras = node["extras"];
    const lattice::LeafAddress address{extras["level"].get<int>(), static_cast<std::int64_t>(extras["i"].get<double>()),
                                       static_cast<std::int64_t>(extras["j"].get<double>())};
    const auto held = leaves.find(address);
    ASSERT_NE(held, leaves.end());
    EXPECT_EQ(extras["side"].get<double>() * 256, static_cast<double>(address.side()));
    const Json at = node.value("translation", Json::array({0, 0, 0}));
    EXPECT_EQ(at[0].get<double>() * 256, static_cast<double>(address.x() - cellX));
    EXPECT_EQ(at[1].get<double>(), 0);
    EXPECT_EQ(at[2].get<double>() * 256, static_cast<double>(address.z() - cellZ));
    const mesh::LeafMesh& leaf = *held->second.mesh;
    if (leaf.triangles.empty()) {
      EXPECT_FALSE(node.contains("mesh"));
      ++empty;
      continue;
    }
    const Json& primitive = glb.json["meshes"][node["mesh"].get<std::size_t>()]["primitives"][0];
    const int position = primitive["attributes"]["POSITION"].get<int>(), index = primitive["indices"].get<int>();
    const auto positions = values<float>(glb, position, 3);
    ASSERT_EQ(positions.size(), leaf.vertices.size() * 3);
    float low[3] = {1e9f, 1e9f, 1e9f}, high[3] = {-1e9f, -1e9f, -1e9f};
    for (std::size_t k = 0; k < leaf.vertices.size(); ++k) {
      const double steps[3] = {static_cast<double>(leaf.vertices[k].x), static_cast<double>(leaf.vertices[k].y),
                               static_cast<double>(leaf.vertices[k].z)};
      for (std::size_t c = 0; c < 3; ++c) {
        ASSERT_EQ(positions[3 * k + c] * 256.0, steps[c]);
        low[c] = std::min(low[c], positions[3 * k + c]);
        high[c] = std::max(high[c], positions[3 * k + c]);
      }
    }
    const Json& accessor = glb.json["accessors"][static_cast<std::size_t>(position)];
    for (std::size_t c = 0; c < 3; ++c) {
      EXPECT_EQ(accessor["min"][c].get<double>(), low[c]);
      EXPECT_EQ(accessor["max"][c].get<double>(), high[c]);
    }
    const int type = glb.json["accessors"][static_cast<std::size_t>(index)]["componentType"].get<int>();
    std::vector<std::uint32_t> indices;
    if (type == 5123)
      for (const std::uint16_t i : values<std::uint16_t>(glb, index, 1)) indices.push_back(i);
    else
      indices = values<std::uint32_t>(glb, index, 1);
    ASSERT_EQ(indices.size(), leaf.triangles.size() * 3);
    for (std::size_t k = 0; k < indices.size(); ++k) ASSERT_EQ(indices[k], leaf.triangles[k / 3][k % 3]);
  }
  EXPECT_GT(empty, 0u);
}

TEST_F(Export, HoldsEveryLeafExactlyHereAndFarAway) {
  for (const lattice::Step metres : {std::int64_t{0}, std::int64_t{-100'000'000}, std::int64_t{1'000'000'000'000}}) {
    camera::Pose pose;
    pose.x = metres * 256 + 12345;
    pose.z = -metres * 256 + 77;
    Leaves leaves;
    const lattice::Point at{pose.x, pose.z};
    for (const int level : {0, 3, 10}) {
      lattice::LeafAddress address = lattice::leafAt(at, level);
      hold(leaves, randomLeaf(address, 50, static_cast<unsigned>(level)));
      ++address.i;
      hold(leaves, {address, {}, {}});
    }
    hold(leaves, randomLeaf(lattice::leafAt(at, 5), 70000, 9));  // more vertices than 16 bits count
    ASSERT_TRUE(writeGlb(leaves, pose, "alpine", 4294967295u, file_));
    const Glb glb = read(file_);
    constexpr lattice::Step kCell = 1 << 20;
    const lattice::Step cellX = (pose.x - (((pose.x % kCell) + kCell) % kCell)), cellZ = (pose.z - (((pose.z % kCell) + kCell) % kCell));
    checkFile(glb, leaves, cellX, cellZ);
    const Json& extras = glb.json["asset"]["extras"];
    EXPECT_EQ(extras["cellX"].get<double>() * kCell, static_cast<double>(cellX));
    EXPECT_EQ(extras["cellZ"].get<double>() * kCell, static_cast<double>(cellZ));
    EXPECT_EQ(extras["terrain"], "alpine");
    EXPECT_EQ(extras["seed"].get<double>(), 4294967295.0);
  }
}

TEST_F(Export, AMeshWithoutTrianglesIsStillAFile) {
  Leaves leaves;
  hold(leaves, {{2, 5, -7}, {}, {}});
  ASSERT_TRUE(writeGlb(leaves, {}, "alpine", 1, file_));
  checkFile(read(file_), leaves, 0, 0);
}

TEST_F(Export, WhatAFloatCannotHoldIsRefused) {
  Leaves leaves;
  hold(leaves, {{10, 0, 0}, {{0, 0, (1 << 24) + 1}, {0, 100, 0}, {100, 0, 0}}, {{0, 1, 2}}});
  const auto written = writeGlb(leaves, {}, "alpine", 1, file_);
  ASSERT_FALSE(written);
  EXPECT_NE(written.error().message.find("65,536 m"), std::string::npos);
}

TEST_F(Export, UnwritableFilesAreNamed) {
  const auto written = writeGlb({}, {}, "alpine", 1, "/no/such/folder/a.glb");
  ASSERT_FALSE(written);
  EXPECT_NE(written.error().message.find("/no/such/folder/a.glb"), std::string::npos);
}

}  // namespace
}  // namespace ridgecast::evaluation
