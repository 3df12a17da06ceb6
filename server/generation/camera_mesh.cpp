#include "server/generation/camera_mesh.h"

#include <algorithm>
#include <bit>
#include <set>
#include <utility>

#include "common/outcome/contract.h"
#include "server/generation/grid.h"

namespace ridgecast::generation {

using lattice::LeafAddress;
using lattice::Step;
using triangulation::kInfinite;
using triangulation::kOutside;
using triangulation::RegionId;
using triangulation::TriangleId;
using triangulation::TrianglePages;
using triangulation::VertexId;

static_assert(refinement::AdaptiveMesh::kOutsideLevel == quadtree::kRootLevel);

namespace {
constexpr int kAnchorBits = lattice::kFinestSideBits + quadtree::kRootLevel;  // anchors are corners of roots
constexpr Step kAnchorReach = Step{1} << 24;                                  // the camera stays this close to its anchor
}  // namespace

CameraMesh::CameraMesh(std::shared_ptr<const terrain::Terrain> terrain, std::uint32_t triangles, refinement::Metric metric,
                       double colourError)
    : mesh_(std::move(terrain), triangles, metric, *this, colourError) {}

Leaf* CameraMesh::leaf(LeafAddress address) const {
  const RegionId region = tree_.tag(address);
  return region == kOutside ? nullptr : leaves_[region].get();
}

std::vector<CameraMesh::Changed> CameraMesh::takeChanged() {
  std::vector<Changed> changed;
  forEachChanged([&](std::size_t k) {
    changed.push_back({k, mesh_.triangulation().vertexPages().changed(regions_[k])});
    mesh_.takeChanged(regions_[k]);
    if (mesh_.triangulation().sparse(regions_[k])) sparse_.push_back(regions_[k]);
  });
  return changed;
}

// ---- select ----

Selection CameraMesh::select(const camera::Pose& pose, double ground) {
  selected_ = tree_.follow(pose, ground);
  const bool anyKept = std::ranges::any_of(addresses_, [&](const LeafAddress& before) {
    LeafAddress now;  // kept, split or merged: the ground is still held
    return tree_.leafAt({before.x(), before.z()}, now);
  });
  if (!anyKept) clear();  // somewhere else altogether
  moveAnchor(pose, anyKept);
  return {selected_, !anyKept, static_cast<std::uint32_t>(tree_.made().size()), static_cast<std::uint32_t>(tree_.gone().size())};
}

void CameraMesh::clear() {
  mesh_.clear();
  for (Leaf* leaf : ordered_) {
    mesh_.removeRegion(leaf->region);
    leaves_[leaf->region].reset();
  }
  ordered_.clear();
  addresses_.clear();
  regions_.clear();
  sparse_.clear();
}

void CameraMesh::moveAnchor(const camera::Pose& pose, bool keep) {
  const auto far = [](Step camera, Step anchor) { return std::abs(camera - anchor) > kAnchorReach; };
  if (keep && !far(pose.x, mesh_.anchor().x) && !far(pose.z, mesh_.anchor().z)) return;
  mesh_.setAnchor({lattice::floorTo(pose.x, kAnchorBits), lattice::floorTo(pose.z, kAnchorBits)});
}

void CameraMesh::setGround(std::shared_ptr<const terrain::Terrain> terrain, std::span<const lattice::Area> changed,
                           scheduling::Pool& pool) {
  expects(terrain != nullptr, "a mesh has ground");
  mesh_.setTerrain(std::move(terrain), changed);
  if (mesh_.triangulation().empty()) return;
  std::vector<RegionId> touched{kOutside};
  for (const Leaf* leaf : ordered_) {
    // Its triangles straddle its border by less than half a side.
    const Step x = leaf->address.x(), z = leaf->address.z(), side = leaf->address.side();
    const lattice::Area around{x - side / 2, z - side / 2, x + side + side / 2, z + side + side / 2};
    if (std::ranges::any_of(changed, [&](const lattice::Area& a) { return a.meets(around); })) touched.push_back(leaf->region);
  }
  // Vertices first: triangles reach into other leaves.
  pool.forEach(touched.size(), 1, [&](std::size_t k) { mesh_.raiseVertices(touched[k]); });
  pool.forEach(touched.size(), 1, [&](std::size_t k) { mesh_.refreshTriangles(touched[k]); });
}

// ---- store and restore ----

std::vector<refinement::StoredVertex> CameraMesh::vertices() const {
  std::vector<refinement::StoredVertex> out;
  for (RegionId region : regions_) mesh_.store(region, out);
  const auto outside = static_cast<std::ptrdiff_t>(out.size());
  mesh_.store(kOutside, out);
  const auto squareOf = [](const refinement::StoredVertex& v) { return lattice::leafAt(v.at, refinement::AdaptiveMesh::kOutsideLevel); };
  std::stable_sort(out.begin() + outside, out.end(), [&](const auto& l, const auto& r) { return squareOf(l) < squareOf(r); });
  return out;
}

bool CameraMesh::restore(const std::vector<LeafAddress>& leaves, std::span<const refinement::StoredVertex> vertices,
                         scheduling::Pool& pool) {
  expects(ordered_.empty() && mesh_.triangulation().empty(), "a mesh is restored before it selects leaves");
  if (leaves.empty() || !tree_.restore(leaves)) return false;
  const LeafAddress first = tree_.roots().front(), last = tree_.roots().back();
  mesh_.setAnchor({lattice::floorTo((first.x() + last.x()) / 2, kAnchorBits), lattice::floorTo((first.z() + last.z()) / 2, kAnchorBits)});
  const LeafDiff diff = replaceLeaves();
  // The grids are there, and outside all leaves nothing else.
  std::vector<bool> fixed(vertices.size());
  std::set<lattice::Point> grid;
  for (std::size_t k = 0; k < vertices.size(); ++k) {
    LeafAddress leaf;
    const bool isInside = tree_.leafAt(vertices[k].at, leaf);
    fixed[k] = isGridPoint(tree_, vertices[k].at);
    if (fixed[k]) grid.insert(vertices[k].at);
    if (!fixed[k] && !isInside) return false;
    if (vertices[k].level > (isInside ? leaf.level : quadtree::kRootLevel) + 1) return false;
  }
  for (const LeafAddress& leaf : leaves)
    for (const lattice::Point& p : gridPoints(leaf))
      if (!grid.contains(p)) return false;
  if (!mesh_.restore(vertices, fixed)) return false;
  updateNeighbours(diff, pool);
  return true;
}

// ---- generate ----

void CameraMesh::generate(scheduling::Pool& pool) {
  if (std::exchange(selected_, false)) {
    const LeafDiff diff = replaceLeaves();  // from here on the partition answers with the new leaves
    if (!mesh_.triangulation().empty()) refile(diff.removed, pool);
    insertGrids(missingGrids(diff));
    dropOutside();
    updateNeighbours(diff, pool);
  }
  compact();
}

CameraMesh::LeafDiff CameraMesh::replaceLeaves() {
  LeafDiff diff;
  if (!ordered_.empty()) {
    for (RegionId region : tree_.gone()) {
      expects(leaves_[region] != nullptr, "a leaf that goes was there");
      diff.removed.push_back({std::move(leaves_[region]), nullptr, {}});
    }
    std::sort(diff.removed.begin(), diff.removed.end(),
              [](const RemovedLeaf& l, const RemovedLeaf& r) { return l.leaf->address < r.leaf->address; });
  }
  for (LeafAddress address : tree_.made()) {
    const triangulation::Point2 corner = mesh_.local({address.x(), address.z()});
    const RegionId region = mesh_.addRegion({corner.x, corner.z, static_cast<std::int32_t>(address.side())}, address.level);
    tree_.setTag(address, region);
    if (region >= leaves_.size()) leaves_.resize(region + 1);
    expects(!leaves_[region], "a region has one leaf");
    leaves_[region] = std::make_unique<Leaf>();
    leaves_[region]->address = address;
    leaves_[region]->region = region;
    diff.made.push_back(leaves_[region].get());
  }
  findSuccessors(diff);
  replaceOrdered(diff);
  for (const RemovedLeaf& f : diff.removed) {
    if (f.whole) mesh_.addGround(f.whole->region, mesh_.ground(f.leaf->region));
    for (const Leaf* part : f.parts) mesh_.addGround(part->region, mesh_.ground(f.leaf->region));
  }
  return diff;
}

void CameraMesh::findSuccessors(LeafDiff& diff) {
  for (RemovedLeaf& f : diff.removed)
    for (Leaf* heir : diff.made) {
      if (heir->address.isAncestorOf(f.leaf->address))
        f.whole = heir;
      else if (f.leaf->address.isAncestorOf(heir->address))
        f.parts.push_back(heir);
    }
}

// All lists are in canonical order, and no leaf that stays is looked at.
void CameraMesh::replaceOrdered(const LeafDiff& diff) {
  std::vector<Leaf*> now;
  std::vector<LeafAddress> addresses;
  std::vector<RegionId> regions;
  const std::size_t size = ordered_.size() + diff.made.size() - diff.removed.size();
  now.reserve(size);
  addresses.reserve(size);
  regions.reserve(size);
  std::ptrdiff_t at = 0;
  const auto keep = [&](std::ptrdiff_t end) {
    const auto append = [&](auto& to, const auto& from) { to.insert(to.end(), from.begin() + at, from.begin() + end); };
    append(now, ordered_);
    append(addresses, addresses_);
    append(regions, regions_);
    at = end;
  };
  const auto keepUntil = [&](LeafAddress address) {
    keep(std::lower_bound(addresses_.begin() + at, addresses_.end(), address) - addresses_.begin());
  };
  auto goes = diff.removed.begin();
  const auto goUntil = [&](const LeafAddress* address) {
    for (; goes != diff.removed.end() && (!address || goes->leaf->address < *address); ++goes) {
      keepUntil(goes->leaf->address);
      ++at;
    }
  };
  for (Leaf* leaf : diff.made) {
    goUntil(&leaf->address);
    keepUntil(leaf->address);
    now.push_back(leaf);
    addresses.push_back(leaf->address);
    regions.push_back(leaf->region);
  }
  goUntil(nullptr);
  keep(std::ssize(addresses_));
  expects(now.size() == size, "leaves come and go one by one");
  ordered_ = std::move(now);
  addresses_ = std::move(addresses);
  regions_ = std::move(regions);
}

// What is filed under leaves that were merged, split or dropped is filed under their successors, or outside.
void CameraMesh::refile(const std::vector<RemovedLeaf>& removed, scheduling::Pool& pool) {
  const auto& t = mesh_.triangulation();
  std::vector<VertexId> moved;
  std::vector<RegionId> splits;
  for (const RemovedLeaf& f : removed) {
    if (f.whole)
      mesh_.adopt(f.leaf->region, f.whole->region);
    else if (!f.parts.empty())
      splits.push_back(f.leaf->region);
    else
      mesh_.refile(f.leaf->region, moved);
  }
  const auto loop = [&](std::size_t count, const std::function<void(std::size_t)>& body) { pool.forEach(count, 1, body); };
  if (!mesh_.split(splits, loop))
    for (RegionId region : splits) mesh_.refile(region, moved);
  for (const RemovedLeaf& f : removed) mesh_.removeRegion(f.leaf->region);
  for (const RemovedLeaf& f : removed)
    for (const Leaf* part : f.parts) t.vertexPages().forEach(part->region, [&](VertexId v) { moved.push_back(v); });
  mesh_.refile(kOutside, moved);
  for (VertexId v : moved)
    if (t.vertexPages().alive(v)) mesh_.snap(v);
}

// Grids nest, so leaves that were merged left all points of the new leaf's grid, and one that was split left some.
std::vector<CameraMesh::Grid> CameraMesh::missingGrids(const LeafDiff& diff) {
  std::vector<Grid> grids;
  std::vector<lattice::Point> sorted;
  for (Leaf* leaf : diff.made) {
    const Leaf* split = nullptr;  // what it was a part of
    bool merged = false;
    for (const RemovedLeaf& f : diff.removed) {
      merged = merged || f.whole == leaf;
      if (std::find(f.parts.begin(), f.parts.end(), leaf) != f.parts.end()) split = f.leaf.get();
    }
    if (merged) continue;
    Grid& grid = grids.emplace_back(Grid{leaf, {}});
    for (lattice::Point p : gridPoints(leaf->address))
      if (!split || ((p.x | p.z) & (split->address.side() / 2 - 1)) != 0) {
        grid.points.push_back({p, 0});
        sorted.push_back(p);
      }
  }
  std::sort(sorted.begin(), sorted.end());
  sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
  const std::vector<std::int32_t> heights = mesh_.heightsAt(sorted);
  for (Grid& grid : grids)
    for (refinement::GridPoint& p : grid.points)
      p.y = heights[static_cast<std::size_t>(std::lower_bound(sorted.begin(), sorted.end(), p.at) - sorted.begin())];
  return grids;
}

void CameraMesh::insertGrids(std::vector<Grid> grids) {
  if (grids.empty()) return;
  const auto& t = mesh_.triangulation();
  if (const auto& first = grids.front().points; t.empty()) mesh_.start(first[0], first[2], first[6]);
  TriangleId hint = t.anyTriangle();
  std::set<lattice::Point> done;  // neighbours share points
  for (Grid& grid : grids) {
    if (grid.points.empty()) continue;
    for (const refinement::GridPoint& p : grid.points) mesh_.addGround(grid.leaf->region, {p.y, p.y});
    std::erase_if(grid.points, [&](const refinement::GridPoint& p) { return !done.insert(p.at).second; });
    // Start the walk in the leaf itself where it inherited triangles.
    for (std::uint32_t page : t.trianglePages().pagesOf(grid.leaf->region))
      if (const TrianglePages::Mask alive = t.trianglePages().aliveMask(page)) {
        hint = t.trianglePages().slotAt(page, static_cast<std::uint32_t>(std::countr_zero(alive)));
        break;
      }
    mesh_.insertGrid(grid.points, hint);
  }
}

// Outside all leaves only the grids' points remain.
void CameraMesh::dropOutside() {
  std::vector<VertexId> stray;
  mesh_.triangulation().vertexPages().forEach(kOutside, [&](VertexId v) {
    if (v != kInfinite && !isGridPoint(tree_, mesh_.absolute(mesh_.triangulation().vertex(v).point()))) stray.push_back(v);
  });
  for (VertexId v : stray) mesh_.drop(v);
}

// Write sets of leaves whose neighbours changed, and which vertices still belong to a grid where one lost points.
void CameraMesh::updateNeighbours(const LeafDiff& diff, scheduling::Pool& pool) {
  struct Stale {
    Leaf* leaf;
    bool coarser;  // its own or a neighbour's grid lost points
  };
  enum : std::uint8_t { kStale = 1, kCoarser = 2 };
  std::vector<std::uint8_t> marks(leaves_.size(), 0);
  std::vector<RegionId> around;
  for (const Leaf* leaf : diff.made) {
    marks[leaf->region] |= kStale;
    tree_.touchingTags(leaf->address, around);
    for (RegionId region : around) marks[region] |= kStale;
  }
  for (const RemovedLeaf& f : diff.removed) {
    tree_.touchingTags(f.leaf->address, around);
    for (RegionId region : around) marks[region] |= f.parts.empty() ? kStale | kCoarser : kStale;
  }
  std::vector<Stale> stale;
  for (RegionId region = 0; region < marks.size(); ++region)
    if (marks[region] != 0) {
      expects(leaves_[region] != nullptr, "a leaf's neighbours are leaves");
      stale.push_back({leaves_[region].get(), (marks[region] & kCoarser) != 0});
    }
  pool.forEach(stale.size(), 4, [&](std::size_t k) {
    Leaf* const leaf = stale[k].leaf;
    tree_.touchingTags(leaf->address, leaf->writeSet);
    leaf->writeSet.push_back(leaf->region);
    if (!stale[k].coarser) return;
    mesh_.triangulation().vertexPages().forEach(leaf->region, [&](VertexId v) {
      const lattice::Point at = mesh_.absolute(mesh_.triangulation().vertex(v).point());
      if (mayBeGridPoint(at)) mesh_.setFixed(v, isGridPoint(tree_, at));
    });
  });
}

void CameraMesh::compact() {
  for (RegionId region : sparse_)
    if (mesh_.triangulation().trianglePages().hasRegion(region)) mesh_.compact(region);
  sparse_.clear();
  mesh_.compact(kOutside);
}

}  // namespace ridgecast::generation
