#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <future>
#include <map>
#include <set>
#include <sstream>
#include <thread>
#include <tuple>

#include "common/terrain/materials.h"
#include "server/directory/directory.h"
#include "server/member/camera_session.h"
#include "server/snapshot/snapshot.h"
#include "tests/support/edit.h"
#include "tests/support/glb_file.h"
#include "tests/support/mesh_check.h"

namespace ridgecast::snapshot {
namespace {

using testing::HasSubstr;

class TakeTest : public testing::Test {
 protected:
  TakeTest() {
    auto resources = std::make_shared<session::Resources>();
    resources->executor = &executor;
    resources->makeMesh = session::pipelineMeshes();
    directory = std::make_shared<directory::Directory>(resources, terrain::create("alpine", 3).value());
    session = directory->find("default");
  }
  Question question(const std::string& query) const {
    auto q = parse(query, snapshots.limits());
    EXPECT_TRUE(q) << (q ? "" : q.error().message);
    return *q;
  }
  Result<Snapshot> take(const std::string& query, bool metadataOnly = false, std::stop_token stop = {}) {
    return snapshots.take(*session, session->ground(), question(query), metadataOnly, stop);
  }

  scheduling::Executor executor{1};
  Snapshots snapshots{{}, 2};
  std::shared_ptr<directory::Directory> directory;
  std::shared_ptr<session::Session> session;
};

constexpr char kFarPose[] = "x=1000000000000&z=-5&altitude=80&yaw=45&pitch=-5&width=320&height=180&threshold=2";

TEST_F(TakeTest, APoseIsAWholeSoundMeshWithItsMetadata) {
  const auto made = take(kFarPose);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_EQ(made->name, "ridgecast-alpine-pose.glb");
  const auto file = testing_support::readGlb(made->file);
  const auto report = testing_support::checkMesh(file.meshes());
  EXPECT_TRUE(report.clean()) << report.text();
  const auto& extras = file.json["asset"]["extras"];
  EXPECT_EQ(extras, nlohmann::json::parse(take(kFarPose, true)->metadata));
  EXPECT_EQ(extras["of"], "pose");
  EXPECT_EQ(extras["pose"]["yaw"], 45.0);
  EXPECT_EQ(extras["pose"]["altitude"], 80.0);
  EXPECT_EQ(extras["error"]["kept"], 2.0);
  EXPECT_EQ(extras["seed"], 3);
  EXPECT_EQ(extras["triangles"], file.triangles());
  EXPECT_EQ(extras["parameters"]["snowLine"], 1760.0);
  EXPECT_EQ(file.json["cameras"].size(), 1u);
  EXPECT_EQ(take(kFarPose)->file, made->file);
}

TEST_F(TakeTest, AnOwnTerrainsParametersStayPrivate) {
  auto resources = std::make_shared<session::Resources>();
  resources->executor = &executor;
  resources->limits.sendsTerrain = false;
  directory = std::make_shared<directory::Directory>(resources, terrain::create("alpine", 3).value());
  session = directory->find("default");
  const auto made = take("x0=0&z0=0&x1=8&z1=8&error=5", true);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_FALSE(nlohmann::json::parse(made->metadata).contains("parameters")) << made->metadata;
}

TEST_F(TakeTest, CompressedFilesHoldTheSameMeshInAQuarterOfTheBytes) {
  const std::string box = "x0=-100&z0=0&x1=200&z1=250&error=0.5";
  const auto plain = take(box), draco = take(box + "&compression=draco");
  ASSERT_TRUE(plain && draco);
  const auto a = testing_support::readGlb(plain->file), b = testing_support::readGlb(draco->file);
  EXPECT_EQ(a.meshes(), b.meshes());
  EXPECT_LE(draco->file.size(), plain->file.size() / 4);
  EXPECT_TRUE(testing_support::checkMesh(a.meshes()).clean());
}

// They are a mesh without holes, square by square of the quadtree; a node takes more bytes than a small leaf's triangles.
TEST_F(TakeTest, SmallLeavesOfAPoseAreJoined) {
  const auto plain = take("x=0&z=0&altitude=120&yaw=0&pitch=-10"), draco = take("x=0&z=0&altitude=120&yaw=0&pitch=-10&compression=draco");
  ASSERT_TRUE(plain && draco);
  const auto file = testing_support::readGlb(plain->file);
  EXPECT_EQ(file.meshes(), testing_support::readGlb(draco->file).meshes());
  EXPECT_TRUE(testing_support::checkMesh(file.meshes()).clean());
  EXPECT_LT(file.leaves.size(), 250u) << "of some 1,500";
  for (const auto& leaf : file.leaves)
    for (const auto& other : file.leaves)
      EXPECT_EQ(leaf.mesh.address.isAncestorOf(other.mesh.address), &leaf == &other) << "squares overlap";
  EXPECT_LE(draco->file.size(), plain->file.size() / 4);
}

// Where leaves meet a vertex looks the same in all of them, and normals are those of the ground.
// A third of them differed: each box took the width of its own triangles alone.
TEST_F(TakeTest, BoxesThatShareASideHaveTheSameNormalsAndColoursThere) {
  std::map<lattice::Point, std::pair<std::array<float, 3>, std::array<float, 3>>> seen;
  std::size_t shared = 0, corners = 0;
  for (const auto& [x, z] : {std::pair{0, 0}, {160, 0}, {0, 128}, {160, 128}}) {
    std::ostringstream box;
    box << "x0=" << x << "&z0=" << z << "&x1=" << x + 160 << "&z1=" << z + 128 << "&error=0.5";
    const auto made = take(box.str());
    ASSERT_TRUE(made) << made.error().message;
    auto others = seen;
    for (const auto& leaf : testing_support::readGlb(made->file).leaves)
      for (const auto& [at, normal] : leaf.normals) {
        const lattice::Point place{leaf.mesh.address.x() + at.x, leaf.mesh.address.z() + at.z};
        const std::pair looks(normal, leaf.colours.at(at));
        others.emplace(place, looks);
        const auto known = seen.find(place);
        if (known == seen.end()) continue;
        ASSERT_EQ(known->second, looks) << place.x / 256.0 << ", " << place.z / 256.0;
        ++shared;
        corners += place == lattice::Point{160 * 256, 128 * 256};
      }
    seen = std::move(others);
  }
  EXPECT_GT(shared, 40u);
  EXPECT_GE(corners, 3u);
}

TEST_F(TakeTest, NormalsAndColoursHaveNoSeams) {
  const auto made = take("x0=-100&z0=0&x1=200&z1=250&error=0.5");
  ASSERT_TRUE(made);
  const auto file = testing_support::readGlb(made->file);
  std::map<lattice::Point, std::pair<std::array<float, 3>, std::array<float, 3>>> seen;
  std::size_t shared = 0;
  for (const auto& leaf : file.leaves) {
    ASSERT_EQ(leaf.normals.size(), leaf.mesh.vertices.size());
    for (const auto& [at, normal] : leaf.normals) {
      EXPECT_NEAR(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2], 1, 1e-5);
      EXPECT_GT(normal[1], 0);
      const auto colour = leaf.colours.contains(at) ? leaf.colours.at(at) : std::array<float, 3>{};
      const auto [it, isNew] =
          seen.emplace(lattice::Point{leaf.mesh.address.x() + at.x, leaf.mesh.address.z() + at.z}, std::pair(normal, colour));
      if (isNew) continue;
      ++shared;
      EXPECT_EQ(it->second.first, normal);
      EXPECT_EQ(it->second.second, colour);
    }
  }
  EXPECT_GT(shared, 20u);
  EXPECT_FALSE(testing_support::readGlb(take("x0=0&z0=0&x1=50&z1=50&error=1&normals=0&colours=0")->file).json.dump().find("NORMAL") !=
               std::string::npos);
}

TEST_F(TakeTest, MaterialsAreTheGroundsAtEachVertex) {
  const terrain::Terrain& terrain = *session->ground().terrain;
  std::set<std::string> found;
  for (const char* form : {"&compression=none", "&compression=draco&normals=0&colours=0"})
    for (const auto& leaf :
         testing_support::readGlb(take("x0=-2000&z0=-2000&x1=2000&z1=2000&error=10&materials=1" + std::string(form))->file).leaves) {
      ASSERT_EQ(leaf.materials.size(), leaf.mesh.vertices.size());
      for (const auto& [at, name] : leaf.materials) {
        const lattice::Step x = leaf.mesh.address.x() + at.x, z = leaf.mesh.address.z() + at.z;
        std::uint8_t material = 0;
        terrain.materials({&x, 1}, {&z, 1}, {&material, 1});
        ASSERT_EQ(name, terrain::materialName(material, terrain.ownMaterials()));
        found.insert(name);
      }
    }
  EXPECT_TRUE(found.contains("grass") && found.contains("wood")) << "of its own: " << testing::PrintToString(found);
  EXPECT_EQ(testing_support::readGlb(take("x0=0&z0=0&x1=50&z1=50&error=1")->file).json.dump().find("EXT_"), std::string::npos);
}

// A vertex of the file and what the metadata say to add give the same place whatever the origin.
TEST_F(TakeTest, CoordinatesBeginWhereTheQuestionSays) {
  const std::string box = "x0=-100&z0=4000&x1=200&z1=4250&error=2";
  const auto cell = testing_support::readGlb(take(box)->file);  // checks every leaf's place by the origin
  EXPECT_EQ(cell.json["asset"]["extras"]["cellX"], -1);
  for (const auto& [origin, x, z] : {std::tuple("centre", 50.0, 4125.0), {"world", 0.0, 0.0}}) {
    const auto made = take(box + "&origin=" + origin);
    ASSERT_TRUE(made);
    const auto file = testing_support::readGlb(made->file);
    EXPECT_EQ(file.meshes(), cell.meshes());
    const auto& extras = file.json["asset"]["extras"];
    EXPECT_EQ(extras, nlohmann::json::parse(made->metadata));
    EXPECT_EQ(extras["origin"], (nlohmann::json{{"x", x}, {"z", z}}));
    EXPECT_FALSE(extras.contains("cellX"));
    EXPECT_FALSE(extras.contains("georeference"));
  }
  const auto pose = testing_support::readGlb(take(std::string(kFarPose) + "&origin=centre")->file);
  EXPECT_EQ(pose.json["asset"]["extras"]["origin"]["x"], 1e12);
}

TEST_F(TakeTest, ATextureHoldsTheColoursInPlaceOfVertices) {
  const auto made = take("x0=0&z0=0&x1=200&z1=100&error=1&texture=64");
  ASSERT_TRUE(made);
  const auto file = testing_support::readGlb(made->file);
  EXPECT_EQ(file.meshes(), testing_support::readGlb(take("x0=0&z0=0&x1=200&z1=100&error=1")->file).meshes());
  EXPECT_TRUE(file.leaves[0].colours.empty());
  const auto& json = file.json;
  const auto& view = json["bufferViews"][json["images"][0]["bufferView"].get<std::size_t>()];
  const std::size_t at = made->file.find("\x89PNG");
  ASSERT_NE(at, std::string::npos);
  EXPECT_EQ(made->file.substr(at + 16, 8), std::string("\0\0\0\x40\0\0\0\x20", 8)) << "64 x 32 pixels";
  EXPECT_EQ(made->file.substr(at + view["byteLength"].get<std::size_t>() - 8, 4), "IEND");
  EXPECT_EQ(json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"], 0);
  EXPECT_EQ(json["accessors"][json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"].get<std::size_t>()]["type"], "VEC2");
}

// PLY and OBJ hold the triangles of the .glb, each vertex once.
TEST_F(TakeTest, OtherFilesHoldTheSameTriangles) {
  const std::string box = "x0=-100&z0=0&x1=200&z1=250&error=0.5&origin=centre";
  const auto glb = testing_support::readGlb(take(box)->file);
  std::set<lattice::Point> places;
  for (const auto& leaf : glb.leaves)
    for (const auto& v : leaf.mesh.vertices) places.insert({leaf.mesh.address.x() + v.x, leaf.mesh.address.z() + v.z});
  auto asked = question(box);
  asked.format = Format::kObj;
  const auto obj = snapshots.take(*session, session->ground(), asked, false, {});
  ASSERT_TRUE(obj);
  EXPECT_EQ(obj->name, "ridgecast-alpine-box.obj");
  std::istringstream lines(obj->file);
  std::set<lattice::Point> written;
  std::size_t vertices = 0, faces = 0, normals = 0;
  for (std::string line, word; std::getline(lines, line);) {
    std::istringstream words(line);
    double x = 0, y = 0, z = 0;
    words >> word;
    if (word == "v" && words >> x >> y >> z) {
      ++vertices;
      written.insert({std::llround((x + 50) * 256), std::llround((z + 125) * 256)});
    }
    faces += word == "f";
    normals += word == "vn";
  }
  EXPECT_EQ(vertices, places.size());
  EXPECT_EQ(written, places);
  EXPECT_EQ(normals, vertices);
  EXPECT_EQ(faces, glb.triangles());
  asked.format = Format::kPly;
  const auto ply = snapshots.take(*session, session->ground(), asked, false, {});
  ASSERT_TRUE(ply);
  const auto end = ply->file.find("end_header\n") + 11;
  EXPECT_THAT(ply->file.substr(0, end), testing::AllOf(HasSubstr("element vertex " + std::to_string(vertices) + "\n"),
                                                       HasSubstr("property float x\n"), HasSubstr("\"origin\":{\"x\":50.0")));
  EXPECT_EQ(ply->file.size() - end, vertices * (24 + 3) + faces * 13);
  // Turned so that z is up, north is y.
  asked.isZUp = true;
  const auto turned = snapshots.take(*session, session->ground(), asked, false, {});
  ASSERT_TRUE(turned);
  EXPECT_THAT(turned->file, HasSubstr("+Z up, x east, y north"));
  const auto begin = turned->file.find("end_header\n") + 11;
  ASSERT_EQ(turned->file.size() - begin, ply->file.size() - end);
  for (std::size_t v = 0; v < vertices; ++v) {
    std::array<float, 6> a{}, b{};  // place and normal
    std::memcpy(a.data(), &ply->file[end + v * 27], sizeof a);
    std::memcpy(b.data(), &turned->file[begin + v * 27], sizeof b);
    ASSERT_EQ(b, (std::array{a[0], -a[2], a[1], a[3], -a[5], a[4]}));
  }
  EXPECT_EQ(turned->file.substr(begin + vertices * 27), ply->file.substr(end + vertices * 27)) << "the triangles";
}

TEST_F(TakeTest, WhatCannotBeSaysWhy) {
  EXPECT_EQ(take("camera=9").error().kind, Problem::Kind::kNotThere);
  EXPECT_THAT(take("camera=9").error().message, HasSubstr("no camera 9"));
  Snapshots small({.triangles = 20'000}, 1);
  const auto refused = small.take(*session, session->ground(), question("x=0&z=0&altitude=80&yaw=45&pitch=-5&threshold=0.5"), false, {});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, Problem::Kind::kTooMuch);
  EXPECT_THAT(refused.error().message, testing::AllOf(HasSubstr("20000 triangles"), HasSubstr("a threshold of")));
  Snapshots hasty({.seconds = 0.05}, 1);
  EXPECT_EQ(hasty.take(*session, session->ground(), question("x=0&z=0&altitude=80&yaw=45&pitch=-5&threshold=0.1"), false, {}).error().kind,
            Problem::Kind::kTooSlow);
  std::stop_source source;
  std::thread later([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    source.request_stop();
  });
  EXPECT_EQ(take("x0=0&z0=0&x1=9000&z1=9000&error=1", false, source.get_token()).error().kind, Problem::Kind::kStopped);
  later.join();
}

// Hears of the first iteration.
class Listener final : public conversation::Sender {
 public:
  void send(wire::ServerMessage message, std::shared_ptr<const void>) override {
    if (std::holds_alternative<wire::World>(message)) world.set_value();
    if (const auto* iteration = std::get_if<wire::Iteration>(&message); iteration && iteration->number == 1) first.set_value();
  }
  void sendShared(std::shared_ptr<const std::string>, std::shared_ptr<const void>) override {}
  std::size_t queuedBytes() const override { return 0; }
  void fail(wire::ErrorMessage message) override { ADD_FAILURE() << message.message; }
  std::promise<void> world, first;
};

// In lock-step a mesh knows no edit before its next pose.
TEST_F(TakeTest, ALiveCamerasSnapshotIsOfItsMeshsGround) {
  const auto listener = std::make_shared<Listener>();
  const auto camera = std::make_shared<member::CameraSession>(session, std::move(*session->enter()), directory->nextCameraId(), listener);
  wire::Hello hello;
  hello.pacing = wire::Pacing::kLockstep;
  hello.settings.threshold = 8;
  camera->receive(hello);
  listener->world.get_future().wait();
  wire::PoseMessage pose;
  pose.sequence = 1;
  pose.camera.pose.y = session->terrain()->height({0, 0}) + 60;
  pose.camera.pose.pitch = -1;
  camera->receive(pose);
  listener->first.get_future().wait();
  const auto before = take("camera=1");
  testing_support::makeCrater(*session, 0, 0, 20, 6);
  const auto after = take("camera=1");
  camera->close();
  ASSERT_TRUE(before && after);
  EXPECT_EQ(after->metadata, before->metadata);
  EXPECT_TRUE(after->file == before->file) << "colours, normals and pose are of another ground than the mesh";
}

TEST_F(TakeTest, ETagsTellQuestionsAndWorldsApart) {
  const std::string tag = Snapshots::etag(*session, session->ground(), question(kFarPose), false);
  EXPECT_EQ(tag.size(), 32u);
  EXPECT_EQ(tag, Snapshots::etag(*session, session->ground(), question(kFarPose), false));
  EXPECT_NE(tag, Snapshots::etag(*session, session->ground(), question(kFarPose), true));
  EXPECT_NE(tag, Snapshots::etag(*session, session->ground(), question(std::string(kFarPose) + "&compression=draco"), false));
  auto resources = std::make_shared<session::Resources>();
  resources->executor = &executor;
  directory::Directory other(resources, terrain::create("alpine", 4).value());
  const auto others = other.find("default");
  EXPECT_NE(tag, Snapshots::etag(*others, others->ground(), question(kFarPose), false));
  EXPECT_EQ(Snapshots::etag(*session, session->ground(), question("camera=1"), false), "");
}

// A map of bumps, 200 x 100 samples 10 m apart, its middle at easting 500,000 and northing 4,600,000.
class Bumps final : public terrain::Terrain, public terrain::Raster {
 public:
  std::string_view name() const override { return "bumps"; }
  std::string_view source() const override { return source_; }
  std::uint32_t seed() const override { return 1; }
  const terrain::Raster* raster() const override { return this; }
  const terrain::RasterShape& shape() const override { return shape_; }
  terrain::RasterOrigin origin() const override { return {"clamp", "EPSG:32632", 500'000.0, 4'600'000.0, {}, {}}; }
  void tile(terrain::TileAddress at, terrain::Tile& out) const override {
    for (std::size_t k = 0; k < out.size(); ++k)
      out[k] = sample(at.i * terrain::kTileSide + static_cast<std::int64_t>(k) % terrain::kTileSide,
                      at.j * terrain::kTileSide + static_cast<std::int64_t>(k) / terrain::kTileSide);
  }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    std::array<std::int32_t, 16> around{};
    for (std::size_t k = 0; k < out.size(); ++k) {
      const auto bx = shape_.x.at(x[k]), bz = shape_.z.at(z[k]);
      for (std::int64_t j = 0; j < 4; ++j)
        for (std::int64_t i = 0; i < 4; ++i) around[static_cast<std::size_t>(4 * j + i)] = sample(bx.sample - 1 + i, bz.sample - 1 + j);
      out[k] = terrain::cubicHeight(around, bx.steps(), bz.steps(), shape_.x.inverse(), shape_.z.inverse());
    }
  }

 private:
  static std::int32_t sample(std::int64_t x, std::int64_t z) {
    return static_cast<std::int32_t>(std::lround(3000 * std::sin(static_cast<double>(x) * 0.3) * std::cos(static_cast<double>(z) * 0.2)));
  }
  terrain::RasterShape shape_{{-256'000, terrain::pitchOf(2560)}, {-128'000, terrain::pitchOf(2560)}, 200, 100, -3000, 3000, 77};
  std::string source_ = terrain::rasterSource(shape_);
};

TEST_F(TakeTest, AWholeMapInPartsHasNoCracksAndSaysWhereItLies) {
  const auto map = std::make_shared<Bumps>();
  auto resources = std::make_shared<session::Resources>();
  resources->executor = &executor;
  directory = std::make_shared<directory::Directory>(resources, map);
  session = directory->find("default");
  Snapshots inParts({.partBits = 5}, 2);
  const auto question = parse("box=all&error=0.5&origin=world", inParts.limits(), map.get());
  ASSERT_TRUE(question);
  Progress progress;
  const auto made = inParts.take(*session, session->ground(), *question, false, {}, &progress);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_GT(progress.parts, 10u);
  EXPECT_EQ(progress.part, progress.parts);
  const auto file = testing_support::readGlb(made->file);
  const auto report = testing_support::checkMesh(file.meshes());
  EXPECT_EQ(report.heights + report.clockwise + report.overused + report.misfiled + report.cracks, 0u) << report.text();
  const auto& extras = file.json["asset"]["extras"];
  EXPECT_EQ(extras["box"]["x0"], -1000.0);
  EXPECT_EQ(extras["box"]["x1"], 990.0) << "the last sample";
  EXPECT_EQ(extras["error"]["known"], "proven");
  EXPECT_LE(extras["error"]["kept"], 0.5);
  // The middle of the samples lies at x -5, z -5.
  auto georeference = extras["georeference"];
  EXPECT_NEAR(georeference["longitude"], 9.00006, 1e-6) << "5 m east of zone 32's meridian";
  EXPECT_NEAR(georeference["latitude"], 41.5516, 1e-4);
  georeference.erase("longitude");
  georeference.erase("latitude");
  EXPECT_EQ(georeference, (nlohmann::json{{"crs", "EPSG:32632"}, {"easting", 500'005.0}, {"northing", 4'599'995.0}}));
  EXPECT_THAT(parse("box=all&error=1", {}).error().message, HasSubstr("never ends"));
}

}  // namespace
}  // namespace ridgecast::snapshot
