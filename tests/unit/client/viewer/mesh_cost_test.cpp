#include "client/viewer/mesh_cost.h"

#include <gtest/gtest.h>

#include <chrono>

namespace ridgecast::viewer {
namespace {

using namespace std::chrono_literals;

constexpr auto kBudget = 40ms;

// A driver that takes simulated times for the picture and for its correction; a pane that is always asked to draw while the camera moves.
struct Moving {
  double mesh = 0, correction = 0;  // milliseconds, of a whole picture
  MeshCost cost;
  render::View view{};

  Moving(double meshTakes, double correctionTakes) : mesh(meshTakes), correction(correctionTakes) {
    view.camera.projection = {.width = 640, .height = 480};
  }
  struct Frame {
    std::uint32_t coarseness;
    bool corrected;
  };
  Frame draw() {
    const std::uint32_t coarseness = cost.coarseness(view, kBudget);
    const render::View samples = coarser(view, coarseness);
    const bool corrects = cost.correctsInTime(samples, kBudget);
    drew(samples, corrects);
    return {coarseness, corrects};
  }
  // A camera at rest has its picture in full and corrected, however long that takes.
  void rest() { drew(view, true); }

 private:
  void drew(const render::View& samples, bool corrects) {
    const double share = samplesOf(samples) / samplesOf(view);
    cost.drew(samples, share * (mesh + (corrects ? correction : 0)), corrects ? share * correction : 0);
  }
};

TEST(MeshCost, APictureInTimeIsCorrectedAndFine) {
  Moving window(20, 15);
  window.rest();
  for (int k = 0; k < 10; ++k) {
    const auto frame = window.draw();
    EXPECT_TRUE(frame.corrected) << k;
    EXPECT_EQ(frame.coarseness, 1u);
  }
}

TEST(MeshCost, WhenFramesAreLateThePlainMeshIsDrawnInstead) {
  Moving window(20, 25);
  window.rest();
  for (int k = 0; k < 10; ++k) {
    const auto frame = window.draw();
    EXPECT_FALSE(frame.corrected) << k << ": 45 of " << kBudget.count() << " ms";
    EXPECT_EQ(frame.coarseness, 1u) << "the mesh itself is in time: it is not made coarser for its correction";
  }
}

TEST(MeshCost, OneLateFrameIsEnough) {
  Moving window(20, 15);
  window.rest();
  ASSERT_TRUE(window.draw().corrected);
  window.correction = 60;
  ASSERT_TRUE(window.draw().corrected) << "nobody knew";
  EXPECT_FALSE(window.draw().corrected);
}

TEST(MeshCost, TheCorrectionComesBackWhenItHasRoomAndDoesNotAlternate) {
  Moving window(20, 25);
  window.rest();
  ASSERT_FALSE(window.draw().corrected);
  window.mesh = 14;  // 39 of 40 ms: within the budget, but not by much
  for (int k = 0; k < 10; ++k) EXPECT_FALSE(window.draw().corrected) << k;
  window.mesh = 2;  // 27 ms
  window.draw();    // is measured
  for (int k = 0; k < 10; ++k) EXPECT_TRUE(window.draw().corrected) << k;
  window.mesh = 14;
  for (int k = 0; k < 10; ++k) EXPECT_TRUE(window.draw().corrected) << "what is shown stays while it is in time: " << k;
}

TEST(MeshCost, AMeshThatIsLateIsDrawnCoarser) {
  Moving window(300, 400);
  window.rest();
  const auto frame = window.draw();
  EXPECT_EQ(frame.coarseness, 4u) << "300 ms / 16 are within 40 ms, 300 / 4 are not";
  EXPECT_FALSE(frame.corrected) << "43.75 ms";
  Moving slow(1e6, 1e6);
  slow.rest();
  EXPECT_EQ(slow.draw().coarseness, kCoarsest);
}

}  // namespace
}  // namespace ridgecast::viewer
