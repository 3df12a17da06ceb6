#pragma once
// What a pipeline keeps from one iteration to the next, and the steps of one (stages.cpp).

#include <algorithm>

#include "server/generation/camera_mesh.h"
#include "server/pipeline/pipeline.h"
#include "server/refinement/horizon.h"

namespace ridgecast::pipeline {

using generation::Leaf;

// A close look tries points this many pixels apart for each pixel of the threshold, within bounds.
inline constexpr double kClosely = 12, kMinClosely = 4, kMaxClosely = 100;
// A close look takes at least this many triangles an iteration, if left: whole leaves, about a millisecond for each thousand.
inline constexpr std::size_t kLookedAtOnce = 8'192;
// A budget that binds raises the threshold by at most this factor: one below the grids alone, which always stay, cannot be kept.
inline constexpr double kMaxRaised = 100;
// At most this many insertions an iteration, the most wanted first, so that the newest camera never waits long.
inline constexpr std::size_t kMaxInsertions = 24'000;

// The camera's motion so far. (The quadtree measures its own: from the ground below, which also rises and falls.)
struct Motion {
  camera::Camera camera;        // of the last iteration that did anything
  double travel = 0, turn = 0;  // steps, radians
  bool moving = false;          // since the iteration before
  // `fromNothing`: the mesh starts from nothing, so travel restarts: short moves then still count, however many long ones came before.
  void follow(const camera::Camera& now, bool fromNothing);
};

// The least error to search for. While insertions are limited it is above the threshold, where the limit cuts off: whatever an iteration
// finds beyond its room is postponed, then found and judged again. It changes seldom, because pages' next checks hold for one bound.
class SearchBound {
 public:
  double value() const { return value_; }
  bool isRaised() const { return value_ > threshold_; }
  // For the next iteration.
  void begin(double threshold, bool limited) {
    threshold_ = threshold;
    value_ = limited ? std::max(value_, threshold) : threshold;
  }
  // All that was found had room: lowers the bound by a step that, judging by earlier ones, finds at most four times the room.
  void lower();
  // `putOff`: errors of what had no room, in any order. If there are too many, raises the bound to leave twice the room, at most to `most`.
  void raise(std::vector<double>& putOff, std::size_t room, double most);

 private:
  double threshold_ = 0, value_ = 0, step_ = 1.25;
  bool lowered_ = false;  // by the last iteration
};

struct Pipeline::State {
  State(std::shared_ptr<const terrain::Terrain> terrain, const settings::Settings& granted, std::shared_ptr<scheduling::Pool> workers);

  bool isLimited() const { return !isThesis() && insertionLimit < kMaxInsertions; }
  bool isThesis() const { return settings.metric == settings::Metric::kThesis; }
  double spacing() const { return std::clamp(kClosely * effective, kMinClosely, kMaxClosely); }
  refinement::View view() const;

  // Recounts the triangles if the leaves changed since the last publish(), and raises or lowers the threshold as the budget demands.
  void fitBudget(bool otherLeaves);
  // Finds what the ground hides; `ground`: its height below the camera. Does nothing for the thesis's metric.
  void castHorizon(refinement::View& view, double ground);
  bool maySee(const refinement::View& view, std::size_t leaf) const;
  // Which leaves may be seen, which candidates they want, which vertices may go.
  void findWork(const refinement::View& view);
  // Keeps the most wanted insertions that the budget and one iteration have room for; ties by position.
  void limitInsertions(const refinement::View& view);
  // Keeps `room` of the `wanted`; returns the errors of the others, as seen.
  std::vector<double> keepMostWanted(std::size_t room, std::size_t wanted, const refinement::View& view);
  // Removes, inserts, and evaluates what is fresh in the leaves that changed, in parallel where write sets are disjoint, with the result of
  // doing it one leaf after the other. Counts what it inserted, removed, and deferred to the serial step at the end.
  void change(const refinement::View& view, settings::IterationStats& figures);
  // Chooses candidates for every fresh triangle. `view`: of the last findWork(), if there was one since triangles were generated.
  void evaluate(const refinement::View* view);
  // Looks closely at some more of the leaves that may be seen.
  void lookClosely(const refinement::View& view);
  // New versions and hashes for leaves whose triangles changed.
  void publish(bool otherLeaves);
  // `rests`: this iteration changed nothing. From then on looks closely for more to do; then the mesh is settled.
  void settle(bool rests, refinement::View& view);
  // The camera moved, or something else has changed: starts the close look over.
  void restart() {
    settled = closely = false;
    looked = 0;
  }
  // Fills in what there is.
  settings::IterationStats describe(settings::IterationStats figures) const;

  settings::Settings settings;
  std::uint32_t madeFor;  // triangles that the mesh has room for
  std::shared_ptr<const terrain::Terrain> terrain;
  std::shared_ptr<scheduling::Pool> pool;
  refinement::Horizon horizon;
  generation::CameraMesh mesh;
  std::size_t insertionLimit = kMaxInsertions;
  double effective;  // threshold; above the granted one while the budget binds
  SearchBound searchBound;
  double fill = 0;         // of the budget
  double left = 0;         // the greatest error, as seen, of what the budget, or a limit to insertions, kept out
  std::uint32_t live = 0;  // triangles owned by leaves
  // At rest, with nothing left to do, the mesh is examined closely once, iteration by iteration, as is whatever changes after that. Only
  // then is it settled.
  bool closely = false;
  std::size_t looked = 0;  // leaves so far
  bool settled = false;
  Motion motion;
  std::vector<std::uint8_t> seen;           // of the mesh's leaves: whether it may be, in the last iteration
  std::vector<Leaf*> busy;                  // for which findWork() found something, in the mesh's order
  std::uint64_t versions = 0, outside = 0;  // the last one assigned; of what is filed outside all leaves
  std::vector<ridgecast::mesh::LeafState> leaves;
};

}  // namespace ridgecast::pipeline
