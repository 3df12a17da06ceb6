// Splitting regions: everything in them is filed anew, by as many threads as there are. Its own file because nothing else here runs on
// several threads at once inside one call.
#include <algorithm>
#include <compare>
#include <memory>
#include <set>

#include "common/outcome/contract.h"
#include "common/triangulation/triangulation.h"

namespace ridgecast::triangulation {

namespace {

constexpr std::size_t kPagesAtATime = 8;

// A region that something of a source goes to.
struct Heir {
  std::uint32_t source;
  RegionId region;
  auto operator<=>(const Heir&) const = default;
};

struct Task {
  Heir heir;
  std::vector<Move> triangles, vertices;
};

// The pages of one kind of record in the regions that are split, and where each record goes.
template <class Storage>
struct Plan {
  struct Page {
    std::uint32_t page, source;  // source: index of the region that it belongs to
  };
  std::vector<Page> pages;
  std::vector<std::size_t> first;        // by source, its first page in `pages`; one more at the end
  std::unique_ptr<RegionId[]> homes;     // by page in `pages` and slot; of slots that are not alive: nothing
  std::vector<std::vector<Heir>> found;  // by chunk of pages, each heir in it once

  Plan(const Storage& storage, std::span<const RegionId> regions) {
    for (std::uint32_t k = 0; k < regions.size(); ++k) {
      first.push_back(pages.size());
      for (std::uint32_t page : storage.pagesOf(regions[k])) pages.push_back({page, k});
    }
    first.push_back(pages.size());
    homes = std::make_unique_for_overwrite<RegionId[]>(pages.size() * Storage::kSlots);
    found.resize((pages.size() + kPagesAtATime - 1) / kPagesAtATime);
  }
  // homeOf(id, guess) for every record in a chunk.
  template <class HomeOf>
  void decide(const Storage& storage, std::size_t chunk, const HomeOf& homeOf) {
    RegionId home = kOutside;  // of the last one, a good guess for the next
    std::vector<Heir>& seen = found[chunk];
    for (std::size_t n = chunk * kPagesAtATime; n < std::min(pages.size(), (chunk + 1) * kPagesAtATime); ++n)
      for (typename Storage::Mask m = storage.aliveMask(pages[n].page); m != 0; m &= m - 1) {
        const auto slot = static_cast<std::uint32_t>(std::countr_zero(m));
        const RegionId now = homeOf(storage.slotAt(pages[n].page, slot), home);
        homes[n * Storage::kSlots + slot] = now;
        const Heir heir{pages[n].source, now};
        if (std::find(seen.rbegin(), seen.rend(), heir) == seen.rend()) seen.push_back(heir);
        home = now;
      }
  }
  void addHeirs(std::set<Heir>& heirs) const {
    for (const auto& chunk : found) heirs.insert(chunk.begin(), chunk.end());
  }
  // What goes from a source to an heir, in the order in which it lies.
  void collect(const Storage& storage, const Heir& heir, std::vector<Move>& moves) const {
    for (std::size_t n = first[heir.source]; n < first[heir.source + 1]; ++n)
      for (typename Storage::Mask m = storage.aliveMask(pages[n].page); m != 0; m &= m - 1) {
        const auto slot = static_cast<std::uint32_t>(std::countr_zero(m));
        if (homes[n * Storage::kSlots + slot] == heir.region) moves.push_back({storage.slotAt(pages[n].page, slot), kNoSlot});
      }
  }
};

}  // namespace

void Triangulation::joinCopies(std::span<const Move> triangles, const std::vector<std::uint8_t>& splitting) {
  for (std::size_t n = 0; n < triangles.size(); ++n) {
    if (n + 4 < triangles.size()) prefetchNeighbours(triangles[n + 4].to);
    const auto [from, to] = triangles[n];
    Triangle& r = triangleRecords_[to];
    for (unsigned side = 0; side < 3; ++side) {
      const HalfEdge twin = r.twin[side];
      Triangle& beyond = triangleRecords_[twin >> 2];
      if (splitting[triangles_.regionOf(twin >> 2)])
        r.twin[side] = 4 * beyond.v[0] + (twin & 3);
      else
        beyond.twin[twin & 3] = 4 * to + side;
      const VertexId v = r.v[side];  // vertices that move as well find their edge themselves
      if (edgeOf(v) == 4 * from + side && !splitting[vertices_.regionOf(v)]) setEdge(v, 4 * to + side);
    }
  }
}

void Triangulation::joinStars(std::span<const Move> vertices, const std::vector<std::uint8_t>& splitting) {
  for (const Move& vertex : vertices) {
    const VertexId to = vertex.to;
    HalfEdge edge = vertexRecords_[vertex.from].edge;
    if (splitting[triangles_.regionOf(edge >> 2)]) edge = 4 * triangleRecords_[edge >> 2].v[0] + (edge & 3);
    setEdge(to, edge);
    forEachAround(to, [&](HalfEdge h) { triangleRecords_[h >> 2].v[h & 3] = to; });
  }
}

// Four loops, in each of which nothing is written to a place that another thread reads or writes meanwhile: where everything goes; records
// are copied, page by page, and an old triangle's first corner names the new one; half-edges are joined anew, each by the triangle that it
// belongs to, or by its twin's where that one stays; the stars, whole again, learn of their new centres.
bool Triangulation::split(std::span<const RegionId> regions, const Loop& loop, const Moves& moves) {
  Plan triangles(triangles_, regions);
  Plan vertices(vertices_, regions);
  // Every region there is may open a page.
  const auto pagesFor = [&](const auto& plan) { return static_cast<std::uint32_t>(plan.pages.size() + regionLimit()); };
  if (!triangles_.hasFree(pagesFor(triangles)) || !vertices_.hasFree(pagesFor(vertices))) return false;
  std::vector<std::uint8_t> splitting(regionLimit(), 0);
  for (RegionId region : regions) {
    expects(region != kOutside && triangles_.hasRegion(region), "what is split is a region");
    splitting[region] = 1;
  }

  loop(triangles.found.size() + vertices.found.size(), [&](std::size_t k) {
    if (k < triangles.found.size())
      triangles.decide(triangles_, k, [&](TriangleId t, RegionId guess) {
        if (t % TrianglePages::kBlock + 4 < TrianglePages::kBlock) prefetchCorners(t + 4);  // dead or alive
        const Triangle& r = triangleRecords_[t];
        return regionOfCorners(r.v[0], r.v[1], r.v[2], guess);
      });
    else
      vertices.decide(vertices_, k - triangles.found.size(), [&](VertexId v, RegionId guess) {
        const Vertex& p = vertexRecords_[v];
        return regionOfSum(3 * p.x, 3 * p.z, guess);
      });
  });

  std::set<Heir> heirs;
  triangles.addHeirs(heirs);
  vertices.addHeirs(heirs);
  std::vector<Task> tasks;
  for (const Heir& heir : heirs) tasks.push_back({heir, {}, {}});

  loop(tasks.size(), [&](std::size_t k) {
    Task& task = tasks[k];
    triangles.collect(triangles_, task.heir, task.triangles);
    triangles_.receive(task.heir.region, task.triangles, [&](TriangleId from, TriangleId to) {
      triangleRecords_[to] = triangleRecords_[from];
      triangleRecords_[from].v[0] = to;
    });
    vertices.collect(vertices_, task.heir, task.vertices);
    vertices_.receive(task.heir.region, task.vertices, [&](VertexId from, VertexId to) { vertexRecords_[to] = vertexRecords_[from]; });
    if (moves.triangles && !task.triangles.empty()) moves.triangles(task.triangles);
    if (moves.vertices && !task.vertices.empty()) moves.vertices(task.vertices);
  });
  loop(tasks.size(), [&](std::size_t k) { joinCopies(tasks[k].triangles, splitting); });
  loop(tasks.size(), [&](std::size_t k) { joinStars(tasks[k].vertices, splitting); });
  for (RegionId region : regions) {
    triangles_.drain(region);
    vertices_.drain(region);
  }
  return true;
}

}  // namespace ridgecast::triangulation
