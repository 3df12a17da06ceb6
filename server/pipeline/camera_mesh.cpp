#include "server/pipeline/camera_mesh.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <limits>
#include <set>
#include <utility>

#include "common/mesh/leaf_mesh.h"
#include "server/generation/grid.h"
#include "server/refinement/coarsening.h"

namespace ridgecast::pipeline {

using lattice::LeafAddress;
using lattice::Step;
using refinement::Pending;
using triangulation::Change;
using triangulation::kInfinite;
using triangulation::kOutside;
using triangulation::Point2;
using triangulation::RegionId;
using triangulation::TriangleId;
using triangulation::Vertex;
using triangulation::VertexId;
using triangulation::WriteSet;

namespace {
constexpr int kAnchorBits = lattice::kFinestSideBits + quadtree::kRootLevel;  // anchors are corners of roots
constexpr Step kAnchorReach = Step{1} << 24;                                  // the camera stays this close to its anchor
constexpr float kStays = std::numeric_limits<float>::infinity();              // the loss of a grid point
}  // namespace

CameraMesh::CameraMesh(std::shared_ptr<const terrain::Terrain> terrain, std::uint32_t triangles, refinement::Metric metric)
    : terrain_(std::move(terrain)),
      metric_(metric),
      mesh_(triangles, *this),
      surface_(mesh_.triangleCapacity(), mesh_.vertexCapacity(), metric == refinement::Metric::kThesis) {}

RegionId CameraMesh::regionAt(Point2 p) const { return tree_.tagAt({surface_.anchor.x + p.x, surface_.anchor.z + p.z}); }

Point2 CameraMesh::local(lattice::Point p) const {
  return {static_cast<std::int32_t>(p.x - surface_.anchor.x), static_cast<std::int32_t>(p.z - surface_.anchor.z)};
}

int CameraMesh::levelAt(Point2 p) const {
  const RegionId region = regionAt(p);
  return region == kOutside ? quadtree::kRootLevel : leaves_[region]->address.level;
}

Leaf* CameraMesh::leaf(LeafAddress address) const {
  const RegionId region = tree_.tag(address);
  return region == kOutside ? nullptr : leaves_[region].get();
}

double CameraMesh::groundBelow(const camera::Pose& pose) const { return terrain_->height({pose.x, pose.z}); }

std::size_t CameraMesh::memoryBytes() const {
  return mesh_.residentBytes() + mesh_.trianglePages().pagesInUse() * refinement::Surface::kBytesPerTrianglePage +
         mesh_.vertexPages().pagesInUse() * refinement::Surface::kBytesPerVertexPage + leaves_.size() * sizeof(Leaf);
}

void CameraMesh::anchorAt(const camera::Pose& pose, bool keep) {
  const auto far = [](Step camera, Step anchor) { return std::abs(camera - anchor) > kAnchorReach; };
  if (keep && !far(pose.x, surface_.anchor.x) && !far(pose.z, surface_.anchor.z)) return;
  const lattice::Point anchor{lattice::floorTo(pose.x, kAnchorBits), lattice::floorTo(pose.z, kAnchorBits)};
  if (keep) {
    const auto dx = static_cast<std::int32_t>(surface_.anchor.x - anchor.x), dz = static_cast<std::int32_t>(surface_.anchor.z - anchor.z);
    mesh_.translate(dx, dz);
    for (const Leaf* leaf : ordered_)
      mesh_.trianglePages().forEach(leaf->region, [&](TriangleId t) {
        refinement::CandidatePage& page = surface_.candidates[t / refinement::CandidatePage::kSlots];
        page.x[t % refinement::CandidatePage::kSlots] += dx;
        page.z[t % refinement::CandidatePage::kSlots] += dz;
      });
  }
  surface_.anchor = anchor;
}

Follow CameraMesh::follow(const camera::Pose& pose) {
  Follow result;
  result.changed = pendingGenerate_ = tree_.follow(pose, groundBelow(pose));
  const bool anyKept = std::any_of(ordered_.begin(), ordered_.end(), [&](const Leaf* leaf) {
    LeafAddress now;  // kept, split or merged: the ground is still held
    return tree_.leafAt({leaf->address.x(), leaf->address.z()}, now);
  });
  if (!anyKept) {  // somewhere else altogether
    result.anew = true;
    mesh_.clear();
    for (Leaf* leaf : ordered_) {
      mesh_.removeRegion(leaf->region);
      leaves_[leaf->region].reset();
    }
    ordered_.clear();
    regions_.clear();
    sparse_.clear();
  }
  anchorAt(pose, anyKept);
  result.generated = static_cast<std::uint32_t>(tree_.made().size());
  result.dropped = static_cast<std::uint32_t>(tree_.gone().size());
  return result;
}

void CameraMesh::generate(scheduling::Pool& pool) {
  if (!pendingGenerate_) return;
  pendingGenerate_ = false;
  std::vector<Leaf*> made;
  std::vector<Former> former;
  if (!ordered_.empty()) {
    for (RegionId region : tree_.gone()) former.push_back({std::move(leaves_[region]), nullptr, {}});
    std::sort(former.begin(), former.end(), [](const Former& l, const Former& r) { return l.leaf->address < r.leaf->address; });
  }
  for (LeafAddress address : tree_.made()) {
    const Point2 corner = local({address.x(), address.z()});
    const RegionId region = mesh_.addRegion({corner.x, corner.z, static_cast<std::int32_t>(address.side())});
    tree_.setTag(address, region);
    if (region >= leaves_.size()) leaves_.resize(region + 1);
    if (region >= surface_.regions.size()) surface_.regions.resize(region + 1);
    surface_.regions[region] = {};
    leaves_[region] = std::make_unique<Leaf>();
    leaves_[region]->address = address;
    leaves_[region]->region = region;
    made.push_back(leaves_[region].get());
  }
  replaceOrdered(made, former);
  // From here on the partition answers with the new leaves.
  for (Former& f : former)
    for (Leaf* heir : made) {
      if (heir->address.isAncestorOf(f.leaf->address))
        f.whole = heir;
      else if (f.leaf->address.isAncestorOf(heir->address))
        f.parts.push_back(heir);
      else
        continue;
      heir->ground.add(f.leaf->ground);
    }

  if (!mesh_.empty()) refile(former, pool);
  if (!made.empty()) insertGrids(made, former);
  dropOutside();
  updateWriteSets(made, former, pool);
}

// Both lists are in canonical order, as the leaves are; few of those are looked at.
void CameraMesh::replaceOrdered(const std::vector<Leaf*>& made, const std::vector<Former>& former) {
  std::vector<Leaf*> now;
  now.reserve(ordered_.size() + made.size() - former.size());
  auto at = ordered_.begin();
  const auto keepUntil = [&](LeafAddress address) {
    const auto end = std::lower_bound(at, ordered_.end(), address, [](const Leaf* l, LeafAddress r) { return l->address < r; });
    now.insert(now.end(), at, end);
    at = end;
  };
  auto goes = former.begin();
  const auto goUntil = [&](const LeafAddress* address) {
    for (; goes != former.end() && (!address || goes->leaf->address < *address); ++goes) {
      keepUntil(goes->leaf->address);
      ++at;
    }
  };
  for (Leaf* leaf : made) {
    goUntil(&leaf->address);
    keepUntil(leaf->address);
    now.push_back(leaf);
  }
  goUntil(nullptr);
  now.insert(now.end(), at, ordered_.end());
  ordered_ = std::move(now);
  regions_.clear();
  for (const Leaf* leaf : ordered_) regions_.push_back(leaf->region);
}

// What is filed under leaves that were merged, split or dropped is filed under their heirs, or outside.
void CameraMesh::refile(const std::vector<Former>& former, scheduling::Pool& pool) {
  std::vector<VertexId> moved;
  const triangulation::Moves moves = keepBeside(&moved);
  std::vector<RegionId> splits;
  for (const Former& f : former) {
    if (f.whole)
      mesh_.adopt(f.leaf->region, f.whole->region);
    else if (!f.parts.empty())
      splits.push_back(f.leaf->region);
    else
      mesh_.refile(f.leaf->region, moves);
  }
  const auto loop = [&](std::size_t count, const std::function<void(std::size_t)>& body) { pool.forEach(count, 1, body); };
  if (!mesh_.split(splits, loop, keepBeside(nullptr)))
    for (RegionId region : splits) mesh_.refile(region, moves);
  for (const Former& f : former) mesh_.removeRegion(f.leaf->region);
  for (const Former& f : former)
    for (const Leaf* part : f.parts) mesh_.vertexPages().forEach(part->region, [&](VertexId v) { moved.push_back(v); });
  mesh_.refile(kOutside, moves);
  snapVertices(moved);
}

// What is kept beside the mesh follows its records.
triangulation::Moves CameraMesh::keepBeside(std::vector<VertexId>* moved) {
  return {[this](std::span<const triangulation::Move> moves) { surface_.moveTriangles(moves, mesh_.regionOf(moves[0].to)); },
          [this, moved](std::span<const triangulation::Move> moves) {
            surface_.moveVertices(moves, mesh_.regionOfVertex(moves[0].to));
            if (moved)
              for (const auto& move : moves) moved->push_back(move.to);
          }};
}

void CameraMesh::compact() {
  const triangulation::Moves moves = keepBeside(nullptr);
  for (RegionId region : sparse_)
    if (mesh_.trianglePages().hasRegion(region)) mesh_.compact(region, moves);
  sparse_.clear();
  mesh_.compact(kOutside, moves);
}

void CameraMesh::snapVertices(const std::vector<VertexId>& vertices) {
  for (VertexId v : vertices) {
    if (!mesh_.vertexPages().alive(v)) continue;
    const int level = levelAt(mesh_.vertex(v).point());
    refinement::VertexExtra& extra = surface_.vertices[v];
    if (static_cast<int>(extra.level) <= level + 1) continue;
    extra.level = static_cast<std::uint32_t>(level) & 31;
    const std::int32_t y = lattice::snapHeight(extra.fineY, level);
    if (y == mesh_.vertex(v).y) continue;
    mesh_.setHeight(v, y);
    extra.mixed = mixedOf(v);
    mesh_.forEachAround(v, [&](triangulation::HalfEdge h) {
      mesh_.trianglePages().setFresh(h >> 2);
      mesh_.markChanged(mesh_.regionOf(h >> 2));
    });
  }
}

// Grids nest, so leaves that were merged left all points of the new leaf's grid, and one that was split left some.
void CameraMesh::insertGrids(const std::vector<Leaf*>& made, const std::vector<Former>& former) {
  struct Missing {
    Leaf* leaf;
    std::vector<lattice::Point> points;
  };
  std::vector<Missing> missing;
  std::vector<lattice::Point> sorted;
  for (Leaf* leaf : made) {
    Missing& m = missing.emplace_back(Missing{leaf, {}});
    const Leaf* split = nullptr;  // what it was a part of
    bool merged = false;
    for (const Former& f : former) {
      merged = merged || f.whole == leaf;
      if (std::find(f.parts.begin(), f.parts.end(), leaf) != f.parts.end()) split = f.leaf.get();
    }
    if (merged) continue;
    for (lattice::Point p : generation::gridPoints(leaf->address))
      if (!split || ((p.x | p.z) & (split->address.side() / 2 - 1)) != 0) m.points.push_back(p);
    sorted.insert(sorted.end(), m.points.begin(), m.points.end());
  }
  if (sorted.empty()) return;
  std::sort(sorted.begin(), sorted.end());
  sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
  std::vector<Step> x(sorted.size()), z(sorted.size());
  std::vector<std::int32_t> y(sorted.size());
  for (std::size_t k = 0; k < sorted.size(); ++k) {
    x[k] = sorted[k].x;
    z[k] = sorted[k].z;
  }
  terrain_->heightSteps(x, z, y);
  heights_ += y.size();
  const auto place = [&](lattice::Point p) {
    return static_cast<std::size_t>(std::lower_bound(sorted.begin(), sorted.end(), p) - sorted.begin());
  };
  const auto fine = [&](lattice::Point p) { return y[place(p)]; };
  const auto vertexAt = [&](lattice::Point p) {
    const Point2 q = local(p);
    return Vertex{q.x, q.z, lattice::snapHeight(fine(p), levelAt(q)), triangulation::kNoEdge};
  };
  std::vector<VertexId> inserted;
  const auto keep = [&](VertexId v, std::int32_t height) {
    note(v, height, levelAt(mesh_.vertex(v).point()), kStays);
    inserted.push_back(v);
  };

  WriteSet all;
  all.allowAll();
  if (mesh_.empty()) {
    const auto grid = generation::gridPoints(made.front()->address);
    const lattice::Point seeds[3] = {grid[0], grid[2], grid[6]};
    mesh_.start(vertexAt(seeds[0]), vertexAt(seeds[1]), vertexAt(seeds[2]));
    // start() files the seeds itself; find them again to note their heights.
    const TriangleId first = mesh_.twin(mesh_.anyTriangle() * 4) >> 2;
    for (VertexId v : mesh_.triangle(first).v) {
      const Point2 p = mesh_.vertex(v).point();
      keep(v, fine({surface_.anchor.x + p.x, surface_.anchor.z + p.z}));
    }
  }
  TriangleId hint = mesh_.anyTriangle();
  std::vector<std::uint8_t> done(sorted.size(), 0);  // neighbours share points
  for (const auto& [leaf, points] : missing) {
    if (points.empty()) continue;
    // Start the walk in the leaf itself where it inherited triangles.
    for (std::uint32_t page : mesh_.trianglePages().pagesOf(leaf->region))
      if (const triangulation::TrianglePages::Mask alive = mesh_.trianglePages().aliveMask(page)) {
        hint = page * triangulation::TrianglePages::kSlots + static_cast<TriangleId>(std::countr_zero(alive));
        break;
      }
    for (lattice::Point p : points) {
      const std::size_t n = place(p);
      const std::int32_t height = y[n];
      leaf->ground.add({height, height});
      if (std::exchange(done[n], std::uint8_t{1})) continue;
      const TriangleId t = mesh_.locate(local(p), hint, all);
      VertexId v = kInfinite;
      const Change change = mesh_.insert(vertexAt(p), t, all, &v);
      if (change == Change::kFull) throw std::bad_alloc();
      if (change == Change::kDone) {
        keep(v, height);
        hint = mesh_.edgeOf(v) >> 2;
      } else {  // refinement was here before
        for (VertexId corner : mesh_.triangle(t).v)
          if (corner != kInfinite && mesh_.vertex(corner).point() == local(p)) setStays(corner, true);
        hint = t;
      }
    }
  }
  if (surface_.keepsCurvature) addCurvature(inserted);
}

// Outside all leaves only the grids' points remain.
void CameraMesh::dropOutside() {
  WriteSet all;
  all.allowAll();
  std::vector<VertexId> stray;
  mesh_.vertexPages().forEach(kOutside, [&](VertexId v) {
    if (v == kInfinite) return;
    const Point2 p = mesh_.vertex(v).point();
    if (!generation::isGridPoint(tree_, {surface_.anchor.x + p.x, surface_.anchor.z + p.z})) stray.push_back(v);
  });
  for (VertexId v : stray) {
    const Change change = mesh_.remove(v, all);
    assert(change == Change::kDone);
    (void)change;
  }
}

void CameraMesh::updateWriteSets(const std::vector<Leaf*>& made, const std::vector<Former>& former, scheduling::Pool& pool) {
  struct Stale {
    Leaf* leaf;
    bool coarser;  // its own or a neighbour's grid lost points
  };
  enum : std::uint8_t { kStale = 1, kCoarser = 2 };
  std::vector<std::uint8_t> marks(leaves_.size(), 0);
  std::vector<RegionId> around;
  for (const Leaf* leaf : made) {
    marks[leaf->region] |= kStale;
    tree_.touchingTags(leaf->address, around);
    for (RegionId region : around) marks[region] |= kStale;
  }
  for (const Former& f : former) {
    tree_.touchingTags(f.leaf->address, around);
    for (RegionId region : around) marks[region] |= f.parts.empty() ? kStale | kCoarser : kStale;
  }
  std::vector<Stale> stale;
  for (RegionId region = 0; region < marks.size(); ++region)
    if (marks[region] != 0) stale.push_back({leaves_[region].get(), (marks[region] & kCoarser) != 0});
  pool.forEach(stale.size(), 4, [&](std::size_t k) {
    Leaf* const leaf = stale[k].leaf;
    tree_.touchingTags(leaf->address, leaf->writeSet);
    leaf->writeSet.push_back(leaf->region);
    if (!stale[k].coarser) return;
    mesh_.vertexPages().forEach(leaf->region, [&](VertexId v) {
      const Point2 p = mesh_.vertex(v).point();
      const lattice::Point at{surface_.anchor.x + p.x, surface_.anchor.z + p.z};
      if (generation::mayBeGridPoint(at)) setStays(v, generation::isGridPoint(tree_, at));
    });
  });
}

void CameraMesh::setStays(VertexId v, bool stays) {
  if (stays == std::isinf(surface_.vertices[v].loss)) return;
  surface_.vertices[v].loss = stays ? kStays : 0;
  surface_.wakeVertex(v, mesh_.regionOfVertex(v));
}

void CameraMesh::addCurvature(const std::vector<VertexId>& vertices) {
  std::vector<Step> x, z;
  for (VertexId v : vertices) {
    x.push_back(surface_.anchor.x + mesh_.vertex(v).x);
    z.push_back(surface_.anchor.z + mesh_.vertex(v).z);
  }
  std::vector<float> out(vertices.size());
  terrain::curvatures(*terrain_, x, z, Step{1} << lattice::kStepBits, out);
  heights_ += 9 * vertices.size();
  for (std::size_t k = 0; k < vertices.size(); ++k) surface_.curvature[vertices[k]] = out[k];
}

std::string CameraMesh::verifyGrids() const {
  std::set<lattice::Point> vertices;
  std::string wrong;
  const auto look = [&](RegionId region) {
    mesh_.vertexPages().forEach(region, [&](VertexId v) {
      if (v == kInfinite) return;
      const Point2 p = mesh_.vertex(v).point();
      const lattice::Point at{surface_.anchor.x + p.x, surface_.anchor.z + p.z};
      const bool stays = std::isinf(surface_.vertices[v].loss);
      if (stays) vertices.insert(at);
      if (stays != generation::isGridPoint(tree_, at) && wrong.empty())
        wrong = "the vertex at " + std::to_string(at.x) + " " + std::to_string(at.z) +
                (stays ? " stays, and belongs to no grid" : " may go, and belongs to a grid");
    });
  };
  look(kOutside);
  for (const Leaf* leaf : ordered_) look(leaf->region);
  for (const Leaf* leaf : ordered_)
    for (lattice::Point p : generation::gridPoints(leaf->address))
      if (vertices.count(p) == 0 && wrong.empty())
        wrong = "the grid point at " + std::to_string(p.x) + " " + std::to_string(p.z) + " is not in the mesh";
  return wrong;
}

std::uint64_t CameraMesh::mixedOf(VertexId v) const {
  const Vertex& p = mesh_.vertex(v);
  return mesh::hashVertex({surface_.anchor.x + p.x, surface_.anchor.z + p.z, p.y});
}

void CameraMesh::note(VertexId v, std::int32_t fineY, int level, float loss) {
  if (const std::uint32_t page = v / triangulation::VertexPages::kSlots; std::popcount(mesh_.vertexPages().aliveMask(page)) == 1)
    surface_.beginLosses(page);
  refinement::VertexExtra& extra = surface_.vertices[v];
  extra.mixed = mixedOf(v);
  extra.loss = loss;
  extra.fineY = fineY;
  extra.level = static_cast<std::uint32_t>(level) & 31;
}

bool CameraMesh::insertOne(Leaf& leaf, const Pending& p, const refinement::View& view, WriteSet& set) {
  const auto& pages = mesh_.trianglePages();
  const refinement::Surface::Candidate c = surface_.candidate(p.triangle);
  // Its triangle is gone, and perhaps another in its place: judged again next time.
  if (!pages.alive(p.triangle) || pages.fresh(p.triangle) || !(c.point == p.point)) return true;
  const int level = levelAt(p.point);
  VertexId v;
  const Change change = mesh_.insert({p.point.x, p.point.z, lattice::snapHeight(c.y, level), triangulation::kNoEdge}, p.triangle, set, &v);
  if (change == Change::kDeferred) return false;
  if (change != Change::kDone) {
    surface_.wakeCandidate(p.triangle, leaf.region);
    return true;
  }
  note(v, c.y, level, c.error);
  refinement::foldLoss(mesh_.vertex(v), v, c.error, mesh_.regionOfVertex(v), view, surface_);
  if (surface_.keepsCurvature) addCurvature({v});
  ++leaf.inserted;
  if (recording_) leaf.insertedPoints.push_back(p.point);
  return true;
}

void CameraMesh::changeLeaf(Leaf& leaf, const refinement::View& view) {
  thread_local WriteSet set;
  set.allow(leaf.writeSet);
  leaf.deferred.clear();
  for (VertexId v : leaf.removable) {
    const Vertex& p = mesh_.vertex(v);
    const float loss = refinement::lossOf(mesh_, surface_, v, view.area, set);
    if (!std::isfinite(loss)) {
      surface_.wakeVertex(v, leaf.region);
      continue;
    }
    refinement::foldLoss(p, v, loss, leaf.region, view, surface_);
    const Point2 point = p.point();
    if (refinement::measure({p.x, p.z, p.y}, loss, view) >= leaf.removalLimit) continue;
    if (mesh_.apply(v, set) != Change::kDone) continue;
    ++leaf.removed;
    if (recording_) leaf.removedPoints.push_back(point);
  }
  for (std::size_t k = 0; k < leaf.pending.size(); ++k) {
    if (k + 6 < leaf.pending.size()) mesh_.prefetch(leaf.pending[k + 6].triangle);
    if (k + 3 < leaf.pending.size()) {
      mesh_.prefetchCorners(leaf.pending[k + 3].triangle);
      mesh_.prefetchNeighbours(leaf.pending[k + 3].triangle);
    }
    if (k + 1 < leaf.pending.size())
      for (triangulation::HalfEdge h : mesh_.triangle(leaf.pending[k + 1].triangle).twin) mesh_.prefetchCorners(h >> 2);
    if (!insertOne(leaf, leaf.pending[k], view, set)) leaf.deferred.push_back(leaf.pending[k]);
  }
}

std::uint32_t CameraMesh::change(const refinement::View& view, scheduling::Pool& pool) {
  // Greedy colours in canonical order: leaves of one colour share no region that either may write.
  struct Task {
    std::uint32_t colour;
    Leaf* leaf;
  };
  std::vector<Task> tasks;
  thread_local std::vector<std::uint64_t> used;
  used.assign(leaves_.size() + 1, 0);
  for (Leaf* leaf : ordered_) {
    leaf->inserted = leaf->removed = 0;
    if (recording_) {
      leaf->insertedPoints.clear();
      leaf->removedPoints.clear();
    }
    if (leaf->pending.empty() && leaf->removable.empty()) continue;
    std::uint64_t taken = 0;
    for (RegionId r : leaf->writeSet) taken |= used[r];
    const std::uint32_t colour = std::min(63, std::countr_one(taken));
    for (RegionId r : leaf->writeSet) used[r] |= std::uint64_t{1} << colour;
    tasks.push_back({colour, leaf});
  }
  std::stable_sort(tasks.begin(), tasks.end(), [](const Task& a, const Task& b) { return a.colour < b.colour; });
  // A task waits for the last task before it that may write any region it may write.
  scheduling::Order order(tasks.size());
  thread_local std::vector<std::uint32_t> last;
  last.assign(leaves_.size() + 1, 0);
  for (std::uint32_t k = 0; k < tasks.size(); ++k) {
    auto& before = order[k];
    for (RegionId r : tasks[k].leaf->writeSet) {
      if (last[r] != 0) before.push_back(last[r] - 1);
      last[r] = k + 1;
    }
    std::sort(before.begin(), before.end());
    before.erase(std::unique(before.begin(), before.end()), before.end());
  }
  pool.forEachOrdered(order, [&](std::size_t k) {
    changeLeaf(*tasks[k].leaf, view);
    evaluateLeaf(*tasks[k].leaf, &view);  // while it is in the cache
  });

  WriteSet all;
  all.allowAll();
  std::uint32_t deferred = 0;
  for (const Task& task : tasks)
    for (const Pending& p : task.leaf->deferred) {
      ++deferred;
      insertOne(*task.leaf, p, view, all);
    }
  return deferred;
}

void CameraMesh::evaluate(scheduling::Pool& pool, const refinement::View* view) {
  thread_local std::vector<Leaf*> changed;
  changed.clear();
  for (std::size_t k = 0; k < regions_.size(); ++k)
    if (mesh_.trianglePages().changed(regions_[k])) changed.push_back(ordered_[k]);
  const auto& list = changed;
  pool.forEach(list.size(), 4, [&, leaves = list.data()](std::size_t k) { evaluateLeaf(*leaves[k], view); });
}

void CameraMesh::chooseAgain(const refinement::View& view, scheduling::Pool& pool) {
  pool.forEach(ordered_.size(), 4, [&](std::size_t k) {
    Leaf& leaf = *ordered_[k];
    const lattice::Vertex low{leaf.address.x() - surface_.anchor.x, leaf.address.z() - surface_.anchor.z};
    // Triangles straddle borders by less than half a side.
    const auto corner = [&](lattice::Step i, lattice::Step j) {
      return view.relative(static_cast<std::int32_t>(low.x + i * leaf.address.side() / 2), static_cast<std::int32_t>(low.z + j * leaf.address.side() / 2), 0);
    };
    if (view.sector.misses(std::array{corner(-1, -1), corner(-1, 3), corner(3, -1), corner(3, 3)})) return;
    auto& pages = mesh_.trianglePages();
    pages.forEach(leaf.region, [&](TriangleId t) { pages.setFresh(t); });
    evaluateLeaf(leaf, &view);
  });
}

void CameraMesh::evaluateLeaf(Leaf& leaf, const refinement::View* view) {
  heights_.fetch_add(refinement::evaluateFresh(mesh_, surface_, *terrain_, leaf.region, leaf.address.level, metric_, view, leaf.ground),
                     std::memory_order_relaxed);
}

}  // namespace ridgecast::pipeline
