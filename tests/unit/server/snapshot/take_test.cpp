#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "server/snapshot/snapshot.h"
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
    directory = std::make_shared<session::Directory>(resources, terrain::create("alpine", 3).value());
    session = directory->find("default");
  }
  Question question(const std::string& query) const {
    auto q = parse(query, snapshots.limits());
    EXPECT_TRUE(q) << (q ? "" : q.error().message);
    return *q;
  }
  Result<Snapshot> take(const std::string& query, bool metadataOnly = false, std::stop_token stop = {}) {
    return snapshots.take(*session, question(query), metadataOnly, stop);
  }

  scheduling::Executor executor{1};
  Snapshots snapshots{{}, 2};
  std::shared_ptr<session::Directory> directory;
  std::shared_ptr<session::Session> session;
};

constexpr char kPose[] = "x=1000000000000&z=-5&altitude=80&yaw=45&pitch=-5&width=320&height=180&threshold=2";

TEST_F(TakeTest, APoseIsAWholeSoundMeshWithItsMetadata) {
  const auto made = take(kPose);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_EQ(made->name, "ridgecast-alpine-pose");
  const auto file = testing_support::readGlb(made->glb);
  const auto report = testing_support::checkMesh(file.meshes());
  EXPECT_TRUE(report.clean()) << report.text();
  const auto& extras = file.json["asset"]["extras"];
  EXPECT_EQ(extras, nlohmann::json::parse(take(kPose, true)->metadata));
  EXPECT_EQ(extras["of"], "pose");
  EXPECT_EQ(extras["pose"]["yaw"], 45.0);
  EXPECT_EQ(extras["pose"]["altitude"], 80.0);
  EXPECT_EQ(extras["error"]["kept"], 2.0);
  EXPECT_EQ(extras["seed"], 3);
  EXPECT_EQ(extras["triangles"], file.triangles());
  EXPECT_EQ(extras["parameters"]["snowLine"], 1760.0);
  EXPECT_EQ(file.json["cameras"].size(), 1u);
  EXPECT_EQ(take(kPose)->glb, made->glb);
}

TEST_F(TakeTest, AnOwnTerrainsParametersStayPrivate) {
  auto resources = std::make_shared<session::Resources>();
  resources->executor = &executor;
  resources->limits.sendsTerrain = false;
  directory = std::make_shared<session::Directory>(resources, terrain::create("alpine", 3).value());
  session = directory->find("default");
  const auto made = take("x0=0&z0=0&x1=8&z1=8&error=5", true);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_FALSE(nlohmann::json::parse(made->metadata).contains("parameters")) << made->metadata;
}

TEST_F(TakeTest, CompressedFilesHoldTheSameMeshInAQuarterOfTheBytes) {
  const std::string box = "x0=-100&z0=0&x1=200&z1=250&error=0.5";
  const auto plain = take(box), draco = take(box + "&compression=draco");
  ASSERT_TRUE(plain && draco);
  const auto a = testing_support::readGlb(plain->glb), b = testing_support::readGlb(draco->glb);
  EXPECT_EQ(a.meshes(), b.meshes());
  EXPECT_LE(draco->glb.size(), plain->glb.size() / 4);
  EXPECT_TRUE(testing_support::checkMesh(a.meshes()).clean());
}

// Where leaves meet a vertex looks the same in all of them, and normals are those of the ground.
TEST_F(TakeTest, NormalsAndColoursHaveNoSeams) {
  const auto made = take("x0=-100&z0=0&x1=200&z1=250&error=0.5");
  ASSERT_TRUE(made);
  const auto file = testing_support::readGlb(made->glb);
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
  EXPECT_FALSE(testing_support::readGlb(take("x0=0&z0=0&x1=50&z1=50&error=1&normals=0&colours=0")->glb).json.dump().find("NORMAL") !=
               std::string::npos);
}

TEST_F(TakeTest, WhatCannotBeSaysWhy) {
  EXPECT_EQ(take("camera=9").error().kind, Problem::Kind::kNotThere);
  EXPECT_THAT(take("camera=9").error().message, HasSubstr("no camera 9"));
  Snapshots small({.triangles = 20'000}, 1);
  const auto refused = small.take(*session, question("x=0&z=0&altitude=80&yaw=45&pitch=-5&threshold=0.5"), false, {});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, Problem::Kind::kTooMuch);
  EXPECT_THAT(refused.error().message, testing::AllOf(HasSubstr("20000 triangles"), HasSubstr("a threshold of")));
  Snapshots hasty({.seconds = 0.05}, 1);
  EXPECT_EQ(hasty.take(*session, question("x=0&z=0&altitude=80&yaw=45&pitch=-5&threshold=0.1"), false, {}).error().kind,
            Problem::Kind::kTooSlow);
  std::stop_source source;
  std::thread later([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    source.request_stop();
  });
  EXPECT_EQ(take("x0=0&z0=0&x1=9000&z1=9000&error=1", false, source.get_token()).error().kind, Problem::Kind::kStopped);
  later.join();
}

TEST_F(TakeTest, ETagsTellQuestionsAndWorldsApart) {
  const std::string tag = Snapshots::etag(*session, question(kPose), false);
  EXPECT_EQ(tag.size(), 32u);
  EXPECT_EQ(tag, Snapshots::etag(*session, question(kPose), false));
  EXPECT_NE(tag, Snapshots::etag(*session, question(kPose), true));
  EXPECT_NE(tag, Snapshots::etag(*session, question(std::string(kPose) + "&compression=draco"), false));
  auto resources = std::make_shared<session::Resources>();
  resources->executor = &executor;
  session::Directory other(resources, terrain::create("alpine", 4).value());
  EXPECT_NE(tag, Snapshots::etag(*other.find("default"), question(kPose), false));
  EXPECT_EQ(Snapshots::etag(*session, question("camera=1"), false), "");
}

}  // namespace
}  // namespace ridgecast::snapshot
