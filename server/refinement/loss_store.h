#pragma once
// For each vertex of a mesh: the error that its removal would make, as last seen, its height to the step, its level; and what the last look
// at each page of them found (bounds.h). Only vertices that pass by the error last seen are looked at again; those that fail then keep the
// new one. Never changes the triangulation. Threads, and a region's state: as CandidateStore.

#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "common/triangulation/triangulation.h"
#include "server/refinement/records.h"
#include "server/refinement/view.h"

namespace ridgecast::refinement {

class LossStore {
 public:
  static constexpr float kFixed = std::numeric_limits<float>::infinity();  // the loss of a fixed vertex

  explicit LossStore(const triangulation::Triangulation& mesh);

  const VertexExtra& at(triangulation::VertexId v) const { return extras_[v]; }
  bool isFixed(triangulation::VertexId v) const { return std::isinf(extras_[v].loss); }
  std::size_t memoryBytes() const;

  void put(triangulation::VertexId v, std::int32_t fineY, int level, float loss);  // just inserted; fold() must follow, unless it is fixed
  void setFixed(triangulation::VertexId v, bool fixed, RegionState& state);
  // Both return the vertex's height, snapped. The terrain's is another one, and what the vertex was worth says nothing any more:
  std::int32_t raise(triangulation::VertexId v, std::int32_t fineY, RegionState& state);
  std::int32_t snapTo(triangulation::VertexId v, int level);
  // Keeps a vertex's loss, and its page's bounds learn of it.
  void fold(triangulation::VertexId v, float loss, RegionState& state, const View& view);
  // The page is checked next time, whatever is known of it.
  void wake(triangulation::VertexId v, RegionState& state) {
    PageLosses& page = losses_[pages_.pageOf(v)];
    page.travel = -1;
    page.nextCheck = state.nextLossCheck = kAlways;
  }
  void move(std::span<const triangulation::Move> moves, RegionState& state);  // to one region, page by page

  // Which of the region's pages to check now. The region's next check becomes the earliest of the others'.
  void collectDue(triangulation::RegionId region, RegionState& state, const View& view, double removalLimit, PageList& due);
  // Appends the vertices of these pages whose loss is below work.removalLimit.
  void findRemovable(const PageList& due, RegionState& state, const View& view, Work& work);

  void prefetchPage(std::uint32_t page) const;  // its vertices

 private:
  void checkPage(std::uint32_t page, const View& view, double slope, std::vector<triangulation::VertexId>& out);

  const triangulation::Triangulation& mesh_;
  const triangulation::VertexPages& pages_;
  triangulation::Records<PageLosses> losses_;   // by page
  triangulation::Records<VertexExtra> extras_;  // by vertex
};

}  // namespace ridgecast::refinement
