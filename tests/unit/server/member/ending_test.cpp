// What a camera takes up and gives back, and what ends with one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

#include "tests/support/waiting.h"
#include "tests/unit/server/member/session_fixture.h"

namespace ridgecast::session {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using wire::ErrorCode;

TEST_F(SessionTest, AFailureInsideIsTold) {
  script->next = [](int n, const camera::Camera&) -> Script::State {
    if (n > 1) throw std::runtime_error("out of luck");
    return {{{kA, 1}}, false};
  };
  start();
  camera->receive(hello());
  camera->receive(pose(1));
  const auto error = client->error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kInternal);
  EXPECT_THAT(error->message, HasSubstr("out of luck"));
}

TEST_F(SessionTest, MemoryThatRunsOutEndsOneCameraAlone) {
  script->next = [](int n, const camera::Camera& c) -> Script::State {
    if (n > 1 && c.pose.y > 0) throw std::bad_alloc();
    return {{{kA, n}}, c.pose.y <= 0};
  };
  start();
  const auto other = std::make_shared<Client>();
  auto low = pose(1);
  low.camera.pose.y = -1;
  const auto lowCamera =
      std::make_shared<CameraSession>(directory->find(kDefaultName), std::move(*directory->find(kDefaultName)->enter()), 99, other);
  lowCamera->receive(hello());
  ASSERT_TRUE(other->world());
  lowCamera->receive(low);
  ASSERT_TRUE(other->iteration());
  auto high = pose(1);
  high.camera.pose.y = 100;
  camera->receive(hello());
  camera->receive(high);
  const auto error = client->error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kLimit);
  EXPECT_EQ(error->message, "The server ran out of memory at this camera's work; connect again with a smaller triangle budget.");
  EXPECT_TRUE(testing_support::await([&] { return script->alive == 1; })) << "its mesh is freed";
  low.sequence = 2;
  lowCamera->receive(low);
  EXPECT_TRUE(other->iteration());
  lowCamera->close();
}

TEST_F(SessionTest, CamerasAreGrantedWhatIsLeftOfAllTriangles) {
  Limits limits;
  limits.maxCameras = 4;
  limits.maxTotalTriangles = 1'000'000;
  start(limits);
  std::vector<std::shared_ptr<CameraSession>> others;
  const auto granted = [&](const std::shared_ptr<CameraSession>& one, const std::shared_ptr<Client>& itsClient, std::uint32_t budget) {
    wire::Hello h = hello();
    h.settings.triangleBudget = budget;
    one->receive(h);
    const auto world = itsClient->world();
    return world ? world->settings.triangleBudget : 0u;
  };
  const auto another = [&](std::uint32_t budget) {
    auto session = directory->find(kDefaultName);
    const auto itsClient = std::make_shared<Client>();
    others.push_back(std::make_shared<CameraSession>(session, session->enter().value(), directory->nextCameraId(), itsClient));
    return granted(others.back(), itsClient, budget);
  };
  EXPECT_EQ(granted(camera, client, 600'000), 600'000u);
  EXPECT_EQ(another(600'000), 380'000u) << "10,000 are kept for each camera that may come";
  EXPECT_EQ(another(600'000), 10'000u);
  EXPECT_EQ(another(0), 10'000u);
  EXPECT_FALSE(directory->find(kDefaultName)->enter());
  for (int k = 0; k < 3; ++k) camera->receive(wire::ChangeSettings{{.triangleBudget = k % 2 ? 10'000u : 900'000u}});  // in flight
  others[1]->close();
  others.erase(others.begin() + 1);
  EXPECT_TRUE(testing_support::await([&] { return directory->cameras() == 3; }));
  EXPECT_EQ(another(600'000), 10'000u) << "what a camera was granted stays its own";
  for (const auto& one : others) one->close();
}

TEST_F(SessionTest, WhereNoTrianglesAreLeftTheNextCameraIsRefused) {
  Limits limits;
  limits.maxTotalTriangles = 35'000;
  start(limits);
  const auto session = directory->find(kDefaultName);
  {
    const auto second = session->enter();
    EXPECT_EQ(second->quota->grant(500'000), 10'000u) << "half of all is kept for others";
    const auto third = session->enter();
    ASSERT_TRUE(third);
    const auto fourth = session->enter();
    ASSERT_FALSE(fourth);
    EXPECT_EQ(fourth.error().message, "This server is full: its cameras have all 35000 triangles that it has memory for; try again later.");
  }
  EXPECT_TRUE(session->enter());
}

TEST_F(SessionTest, PlacesAreBoundedAndGivenBack) {
  Limits limits;
  limits.maxCameras = 3;
  limits.maxMembers = 2;
  start(limits);  // takes one
  auto other = directory->add("other", flatTerrain()).value();
  auto session = directory->find("default");
  {
    auto second = session->enter();
    ASSERT_TRUE(second);
    auto third = session->enter();
    ASSERT_FALSE(third);
    EXPECT_THAT(third.error().message, HasSubstr("'default' is full"));
    EXPECT_EQ(session->members(), 2u);
    auto elsewhere = other->enter();
    ASSERT_TRUE(elsewhere);
    auto fourth = other->enter();
    ASSERT_FALSE(fourth);
    EXPECT_THAT(fourth.error().message, HasSubstr("server is full"));
  }
  EXPECT_TRUE(session->enter());
  EXPECT_EQ(directory->cameras(), 1u);
}

}  // namespace
}  // namespace ridgecast::session
