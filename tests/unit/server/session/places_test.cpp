// Places of cameras, what ends with one, and the directory of sessions.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

#include "session_fixture.h"
#include "tests/support/waiting.h"

namespace ridgecast::session {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using wire::ErrorCode;

TEST_F(SessionTest, ClosingFreesTheMeshAndThePlace) {
  script->next = [](int n, const camera::Camera&) {
    std::this_thread::sleep_for(5ms);
    return Script::State{{{kA, n}}, false};
  };
  start();
  camera->receive(hello());
  camera->receive(pose(1));
  ASSERT_TRUE(client->iteration());
  EXPECT_EQ(directory->cameras(), 1u);
  camera->close();
  camera->close();
  camera.reset();
  EXPECT_TRUE(testing_support::await([&] { return script->alive == 0 && directory->cameras() == 0; }));
  EXPECT_EQ(script->alive, 0);
  EXPECT_EQ(directory->cameras(), 0u);
  const std::size_t sent = client->sent();
  std::this_thread::sleep_for(20ms);
  EXPECT_EQ(client->sent(), sent);
}

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
    EXPECT_EQ(second->onServer->grant(500'000), 10'000u) << "half of all is kept for others";
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

TEST(Budgets, BytesOfEditsHaveABudget) {
  Budgets budgets;
  const edits::Operation small{edits::Raise{{0, 0}, edits::kMinRadius, 0, 256}, 0};
  const conversation::Budget::Clock::time_point begin{1h}, end = begin + 10s;
  constexpr std::size_t kBytes = 128u << 10;
  std::uint64_t made = 0;
  for (auto now = begin; now < end; now += 1ms) made += budgets.spendEdit(small, kBytes, now) ? 1 : 0;
  constexpr std::uint64_t kASecond = kEditedBytesPerSecond / kBytes;
  EXPECT_GE(made, 10 * kASecond);
  EXPECT_LE(made, 10 * kASecond + kASecond + kASecond / 4 + 1) << "a quarter of a second that was saved up, and one that is owed";
  EXPECT_FALSE(budgets.spendEdit(small, 1, end));
  EXPECT_FALSE(budgets.areFull(end + 1s));
}

// Connections come and go, as with HTTP: each asks for its client's budgets, spends, and lets them go.
TEST(Budgets, OfAClientAreForgottenWhenTheyAreFullAndNotBefore) {
  const auto places = std::make_shared<Places>(1, 0);
  const edits::Operation small{edits::Raise{{0, 0}, edits::kMinRadius, 0, 256}, 0};
  const conversation::Budget::Clock::time_point begin{1h}, end = begin + 10s;
  std::uint64_t made = 0;
  for (auto now = begin; now < end; now += 1ms) made += places->budgetsOf("a", now)->spendEdit(small, 100, now) ? 1 : 0;
  constexpr std::uint64_t kASecond = kEditedPostsPerSecond / kMinEditedPosts;
  EXPECT_GE(made, 10 * kASecond);
  EXPECT_LE(made, 10 * kASecond + kASecond / 2 + 1) << "a quarter of a second that was saved up, and one that is owed";

  std::weak_ptr<Budgets> own = places->budgetsOf("a", end);
  const auto paid = own.lock()->edits.free();
  places->budgetsOf("b", paid);
  EXPECT_FALSE(own.expired()) << "its credit is not saved up";
  places->budgetsOf("b", paid + 250ms);
  EXPECT_TRUE(own.expired());

  own = places->budgetsOf("a", end);
  own.lock()->queries.spend(end, kHeightsPerSecond);
  places->budgetsOf("b", end + 999ms);
  EXPECT_FALSE(own.expired());
  places->budgetsOf("b", end + 1s);
  EXPECT_TRUE(own.expired());
}

TEST_F(SessionTest, DirectoryKnowsSessionsByName) {
  start();
  EXPECT_TRUE(directory->find("default"));
  EXPECT_FALSE(directory->find("nowhere"));
  EXPECT_FALSE(directory->find(""));
  EXPECT_TRUE(directory->add("alps-2", flatTerrain()));
  EXPECT_FALSE(directory->add("alps-2", flatTerrain()));
  EXPECT_FALSE(directory->add("no spaces", flatTerrain()));
  EXPECT_FALSE(directory->add("default", flatTerrain()));
}

TEST_F(SessionTest, ASuccessorTakesNameSpecAndMakersShare) {
  Limits limits;
  limits.maxSessionsPerClient = 1;
  start(limits);
  const auto old = directory->add("alps", flatTerrain(5), {{"tallest", 3}}, "client").value();
  const auto member = old->enter();
  const Session* prepared = nullptr;
  EXPECT_TRUE(directory->replace(old, flatTerrain(6), [&](const Session& successor) {
    prepared = &successor;
    EXPECT_EQ(directory->find("alps"), old);
  }));
  const auto now = directory->find("alps");
  EXPECT_EQ(now.get(), prepared);
  EXPECT_NE(now, old);
  EXPECT_EQ(now->spec(), old->spec());
  EXPECT_NE(now->contentHash(), old->contentHash());
  EXPECT_TRUE(old->isRetired());
  EXPECT_FALSE(now->isRetired());
  EXPECT_TRUE(directory->full("client"));
  EXPECT_EQ(directory->cameras(), 2u);                    // with the fixture's
  EXPECT_FALSE(directory->replace(old, flatTerrain(7)));  // is not there any more
  EXPECT_EQ(directory->find("alps"), now);
}

}  // namespace
}  // namespace ridgecast::session
