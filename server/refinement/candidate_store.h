#pragma once
// A candidate for each triangle of a mesh, what the last look at each page of them found (bounds.h), and each triangle's term of its
// region's hash. Never changes the triangulation. A region's state belongs to the mesh, which gives it to calls that use the region's next
// check. Calls for different regions may run at the same time.

#include <cassert>
#include <span>
#include <vector>

#include "common/triangulation/triangulation.h"
#include "server/refinement/metric.h"
#include "server/refinement/records.h"
#include "server/refinement/view.h"

namespace ridgecast::refinement {

class CandidateStore {
 public:
  explicit CandidateStore(const triangulation::Triangulation& mesh);

  Candidate at(triangulation::TriangleId t) const {
    const Candidates& four = candidates_[t / Candidates::kSlots];
    const std::uint32_t k = t % Candidates::kSlots;
    return {{four.x[k], four.z[k]}, four.y[k], four.error[k]};
  }
  PageCandidates blocks(std::uint32_t page) const {
    PageCandidates blocks;
    for (std::uint32_t k = 0; k < blocks.size(); ++k) {
      const std::uint32_t block = pages_.blockOf(page, k);
      blocks[k] =
          block == triangulation::kNoSlot ? nullptr : &candidates_[block * triangulation::TrianglePages::kBlock / Candidates::kSlots];
    }
    return blocks;
  }
  const PageScreen& screen(std::uint32_t page) const { return screens_[page]; }
  const NextCheck& nextCheck(std::uint32_t page) const { return checks_[page]; }
  std::uint64_t hash(triangulation::RegionId region);  // sums again what changed
  std::size_t memoryBytes() const;

  // All of the page's candidates are new: forgets what its former region left there. `travel`: of the camera; negative: not known.
  void begin(std::uint32_t page, double travel);
  // The candidate and the hash's term of a new triangle. wake() or fold() must follow.
  void put(triangulation::TriangleId t, const Candidate& c, std::uint64_t term) {
    assert(pages_.alive(t));
    Candidates& four = candidates_[t / Candidates::kSlots];
    const std::uint32_t k = t % Candidates::kSlots, index = pages_.indexOf(t);
    four.x[k] = c.point.x;
    four.z[k] = c.point.z;
    four.y[k] = c.y;
    four.error[k] = c.error;
    PageScreen& page = screens_[pages_.pageOf(t)];
    const Mask bit = Mask{1} << index;
    page.dormant &= ~bit;
    page.blank &= ~bit;
    page.hash += term - (hashes_[t] & -(page.hashed >> index & 1));  // what the slot held before leaves; a branch would be unpredictable
    page.hashed |= bit;
    hashes_[t] = term;
  }
  // Its page's bounds learn of a candidate,
  void fold(triangulation::TriangleId t, const Candidate& c, RegionState& state, const View& view);
  // or the page is checked next time, whatever is known of it.
  void wake(triangulation::TriangleId t, RegionState& state) {
    const std::uint32_t page = pages_.pageOf(t);
    screens_[page].travel = -1;
    checks_[page].travel = state.nextCheck.travel = kAlways;
  }
  void move(std::span<const triangulation::Move> moves, RegionState& state);  // to one region, page by page
  void translate(std::int32_t dx, std::int32_t dz);                           // with the mesh's anchor

  // Which of the region's pages to check now. The region's next check becomes the earliest of the others'.
  void collectDue(triangulation::RegionId region, RegionState& state, const View& view, double skipped, PageList& due);
  // Those of these pages' candidates that are worth a vertex, sorted; those that only would be become dormant.
  void findWanted(const PageList& due, RegionState& state, const View& view, double threshold, std::vector<Pending>& out);
  // The same of all of a region's, by the thesis's metric.
  void findByThesis(triangulation::RegionId region, const View& view, double threshold, std::vector<Pending>& out) const;

  void prefetch(triangulation::TriangleId t) const { __builtin_prefetch(&candidates_[t / Candidates::kSlots], 1); }
  void prefetchAll(triangulation::TriangleId t) const {  // what put() writes
    prefetch(t);
    __builtin_prefetch(&hashes_[t], 1);
    __builtin_prefetch(&screens_[pages_.pageOf(t)], 1);
  }
  void prefetchPage(std::uint32_t page) const;  // its candidates

 private:
  using Mask = triangulation::TrianglePages::Mask;

  float& errorOf(triangulation::TriangleId t) { return candidates_[t / Candidates::kSlots].error[t % Candidates::kSlots]; }
  void checkPage(std::uint32_t page, const View& view, double threshold, std::vector<triangulation::TriangleId>& wanted);
  void wakeDormant(std::uint32_t page);
  void blankDead(std::uint32_t page, Mask alive);
  void judgeWanted(const std::vector<triangulation::TriangleId>& wanted, const View& view, std::vector<Pending>& out);

  const triangulation::Triangulation& mesh_;
  const triangulation::TrianglePages& pages_;
  triangulation::Records<Candidates> candidates_;  // by four triangles
  triangulation::Records<NextCheck> checks_;       // by page
  triangulation::Records<PageScreen> screens_;     // by page
  triangulation::Records<std::uint64_t> hashes_;   // by triangle
};

}  // namespace ridgecast::refinement
