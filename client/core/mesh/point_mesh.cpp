#include "client/core/mesh/point_mesh.h"

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <iterator>
#include <limits>
#include <utility>

#include "common/outcome/contract.h"
#include "common/points/guess.h"

namespace ridgecast::core {

using lattice::LeafAddress;
using triangulation::Change;
using triangulation::kInfinite;
using triangulation::kOutside;
using triangulation::TriangleId;
using triangulation::Triangulation;
using triangulation::Vertex;

namespace {

// Anchors are corners of the coarsest leaves, and move when the middle of the leaves is farther away than this.
constexpr lattice::Step kDrift = lattice::Step{1} << 24;

terrain::Shade shadeOf(const std::uint8_t* b) { return {static_cast<std::int8_t>(b[0]), static_cast<std::int8_t>(b[1]), b[2], b[3], b[4]}; }

}  // namespace

PointMesh::PointMesh(bool shaded, std::uint32_t triangles) : shaded_(shaded), terms_(0) {
  everything_.allowAll();
  make(std::clamp(triangles, kMinTriangles, kMaxTriangles));
}

// ---- storage ----

// An empty mesh, with a region for each leaf.
void PointMesh::make(std::uint32_t triangles) {
  mesh_ = std::make_unique<Triangulation>(triangles, *this);
  capacity_ = triangles;
  shades_.assign(shaded_ ? mesh_->vertexCapacity() : 0, {});
  terms_ = triangulation::Records<std::uint64_t>(mesh_->triangleCapacity());
  hashes_.assign(mesh_->triangleCapacity() / Pages::kBlock, {});
  regions_.clear();
  empty();
}

// The same, in the memory there is.
void PointMesh::empty() {
  mesh_->clear();
  for (const auto& [leaf, region] : regions_) mesh_->removeRegion(region);
  regions_.clear();
  levels_.there = 0;
  for (const LeafAddress& leaf : held_) addRegion(leaf);
}

// Room for so many more points.
void PointMesh::reserve(std::size_t points) {
  // A set of n points has less than 2 n triangles; every leaf beyond those that the triangulation has room for takes a page.
  const std::size_t leaves = held_.size() > 2048 ? held_.size() - 2048 : 0;
  const std::size_t wanted = 2 * (mesh_->liveVertices() + points) + 2 * triangulation::TrianglePages::kSlots * leaves;
  if (wanted <= capacity_) return;
  std::vector<Vertex> vertices;
  std::vector<terrain::Shade> shades;
  forEachVertex([&](VertexId v) {
    vertices.push_back(mesh_->vertex(v));
    if (shaded_) shades.push_back(shades_[v]);
  });
  make(static_cast<std::uint32_t>(std::max<std::size_t>(2 * std::size_t{capacity_}, wanted)));
  open_.clear();
  effort_.most = std::numeric_limits<std::size_t>::max();  // it was paid for
  if (vertices.empty()) return;
  start(vertices);
  TriangleId hint = mesh_->anyTriangle();
  for (std::size_t k = 0; k < vertices.size(); ++k) {
    const VertexId v = insert(vertices[k], hint);
    mesh_->vertexPages().clearFresh(v);
    if (shaded_) shades_[v] = shades[k];
  }
}

triangulation::Moves PointMesh::moves() {
  triangulation::Moves told;
  told.triangles = [this](std::span<const triangulation::Move> all) {
    for (const auto& [from, to] : all) {
      setTerm(to, terms_[from]);
      if (const RegionId region = mesh_->regionOf(to); region != kOutside) addToBounds(region, to);
    }
  };
  if (shaded_)
    told.vertices = [this](std::span<const triangulation::Move> all) {
      for (const auto& [from, to] : all) shades_[to] = shades_[from];
    };
  return told;
}

void PointMesh::clear() {
  held_.clear();
  active_.clear();
  empty();
}

// ---- leaves ----

triangulation::RegionId PointMesh::regionAt(triangulation::Point2 p) const {
  const lattice::Point at = absolute(p);
  const auto find = [&](int level) { return regions_.find(lattice::leafAt(at, level)); };
  if (const auto it = find(levels_.likely); it != regions_.end()) return it->second;
  for (int level = 0; level <= lattice::kMaxLevel; ++level)
    if (levels_.there >> level & 1)
      if (const auto it = find(level); it != regions_.end()) return levels_.likely = level, it->second;
  return kOutside;
}

void PointMesh::addRegion(LeafAddress leaf) {
  levels_.there |= 1u << leaf.level;
  expects(!regions_.contains(leaf), "a leaf has one region");
  const RegionId region = mesh_->addRegion({static_cast<std::int32_t>(leaf.x() - anchor_.x),
                                            static_cast<std::int32_t>(leaf.z() - anchor_.z), static_cast<std::int32_t>(leaf.side())});
  mesh_->markChanged(region);  // it is told of even when it stays empty: Iteration.errors has one for each leaf that comes
  regions_[leaf] = region;
  leaves_.resize(mesh_->regionLimit());
  leaves_[region] = leaf;
  bounds_.resize(mesh_->regionLimit());
  bounds_[region] = {};
}

// Puts the anchor near the middle of the leaves. False: they, or the points held, reach too far.
bool PointMesh::centre() {
  lattice::Point low{held_.front().x(), held_.front().z()}, high = low;
  for (const LeafAddress& leaf : held_) {
    low = {std::min(low.x, leaf.x()), std::min(low.z, leaf.z())};
    high = {std::max(high.x, leaf.x() + leaf.side()), std::max(high.z, leaf.z() + leaf.side())};
  }
  if (std::max(high.x - low.x, high.z - low.z) > kReach) return false;
  const lattice::Point middle{low.x + (high.x - low.x) / 2, low.z + (high.z - low.z) / 2};
  const auto distance = [](lattice::Point l, lattice::Point r) { return std::max(std::abs(l.x - r.x), std::abs(l.z - r.z)); };
  if (distance(middle, anchor_) <= kDrift) return true;
  constexpr int kBits = lattice::kFinestSideBits + lattice::kMaxLevel;
  const lattice::Point to{lattice::floorTo(middle.x, kBits), lattice::floorTo(middle.z, kBits)};
  bool isNear = true;
  forEachVertex([&](VertexId v) { isNear = isNear && distance(absolute(mesh_->vertex(v).point()), to) < kReach; });
  if (!isNear) return false;
  if (!mesh_->empty()) {
    const auto dx = static_cast<std::int32_t>(anchor_.x - to.x), dz = static_cast<std::int32_t>(anchor_.z - to.z);
    mesh_->translate(dx, dz);
    for (Bounds& b : bounds_)
      if (!b.empty()) b = {{b.low.x + dx, b.low.z + dz, b.low.y}, {b.high.x + dx, b.high.z + dz, b.high.y}};
  }
  anchor_ = to;
  return true;
}

// An empty mesh where the leaves are. False: they reach too far.
bool PointMesh::startOver() {
  if (held_.empty()) return clear(), true;
  mesh_->clear();  // so that the anchor is free
  if (!centre()) return false;
  empty();
  return true;
}

bool PointMesh::replaceLeaves(const Step& step) {
  if (step.gone.empty() && step.come.empty()) return true;
  std::vector<LeafAddress> gone(step.gone.begin(), step.gone.end()), come(step.come.begin(), step.come.end()), kept;
  std::sort(gone.begin(), gone.end());
  std::sort(come.begin(), come.end());
  std::set_difference(held_.begin(), held_.end(), gone.begin(), gone.end(), std::back_inserter(kept));
  if (kept.size() + gone.size() != held_.size()) return false;
  held_.clear();
  std::merge(kept.begin(), kept.end(), come.begin(), come.end(), std::back_inserter(held_));
  if (std::adjacent_find(held_.begin(), held_.end()) != held_.end()) return false;
  if (kept.empty()) return startOver();
  if (!centre()) return false;
  std::vector<std::pair<LeafAddress, RegionId>> former;
  for (const LeafAddress& leaf : gone) {
    const auto region = regions_.find(leaf);
    expects(region != regions_.end(), "a leaf that is held has a region");
    former.emplace_back(*region);
    regions_.erase(region);
  }
  std::int64_t open = 0;  // area of what comes where no leaf went, in finest leaves
  const auto area = [](const LeafAddress& leaf) { return std::int64_t{1} << 2 * leaf.level; };
  for (const LeafAddress& leaf : come) {
    addRegion(leaf);
    LeafAddress above = leaf.parent();
    while (above.level <= lattice::kMaxLevel && !std::binary_search(gone.begin(), gone.end(), above)) above = above.parent();
    if (above.level > lattice::kMaxLevel) open += area(leaf);
  }
  const triangulation::Moves told = moves();
  for (const auto& [leaf, region] : former) {
    const auto heir = std::find_if(come.begin(), come.end(), [&, of = leaf](const LeafAddress& c) { return c.isAncestorOf(of); });
    if (heir != come.end()) {
      const RegionId to = regions_.at(*heir);
      for (std::uint32_t page : mesh_->trianglePages().pagesOf(region))  // they lie elsewhere in their heir's frame
        mesh_->trianglePages().forEachBlock(page, [&](std::uint32_t block) { hashes_[block].drawn = 0; });
      mesh_->adopt(region, to);
      bounds_[to].add(bounds_[region].low, bounds_[region].high);
      open -= area(leaf);
    } else {
      mesh_->refile(region, told);
    }
    mesh_->removeRegion(region);
  }
  if (open != 0) mesh_->refile(kOutside, told);
  return true;
}

// ---- points ----

std::uint32_t PointMesh::count(LeafAddress square) {
  const auto region = regions_.find(square);
  return region == regions_.end() ? static_cast<std::uint32_t>(openPoints(square).size()) : mesh_->vertexCount(region->second);
}

const std::vector<triangulation::VertexId>& PointMesh::openPoints(LeafAddress square) {
  if (open_.empty())
    mesh_->vertexPages().forEach(kOutside, [&](VertexId v) {
      if (v != kInfinite) open_[lattice::leafAt(absolute(mesh_->vertex(v).point()), points::kOpenLevel)].push_back(v);
    });
  return open_[square];
}

// The points of a square, in order.
const std::vector<triangulation::VertexId>& PointMesh::list(LeafAddress square) {
  constexpr std::int32_t kOffset = std::int32_t{1} << 30;  // no coordinate is negative with it
  sorted_.clear();
  const auto add = [&](VertexId v) {
    const Vertex& p = mesh_->vertex(v);
    sorted_.emplace_back(static_cast<std::uint64_t>(p.x + kOffset) << 32 | static_cast<std::uint32_t>(p.z + kOffset), v);
  };
  if (const auto region = regions_.find(square); region != regions_.end())
    mesh_->vertexPages().forEach(region->second, add);
  else
    for (VertexId v : openPoints(square)) add(v);
  std::sort(sorted_.begin(), sorted_.end());
  list_.clear();
  for (const auto& [place, v] : sorted_) list_.push_back(v);
  return list_;
}

// Begins the mesh with three of these vertices that are not on a line. False: there are none.
bool PointMesh::start(std::span<const Vertex> vertices) {
  for (std::size_t k = 2; k < vertices.size(); ++k)
    if (orientation(vertices[0].point(), vertices[1].point(), vertices[k].point()) != 0) {
      mesh_->start(vertices[0], vertices[1], vertices[k]);
      return true;
    }
  return false;
}

// The vertex at this point, which is new, or there already. `hint`: where the search begins; becomes a triangle at the vertex.
triangulation::VertexId PointMesh::insert(const Vertex& p, TriangleId& hint) {
  hint = mesh_->locate(p.point(), hint, everything_);
  VertexId made = kNoVertex;
  switch (mesh_->insert(p, hint, everything_, &made)) {
    case Change::kDone:
      hint = mesh_->edgeOf(made) >> 2;
      return effort_.spend(everything_.star().size()) ? made : kNoVertex;
    case Change::kDuplicate:
      for (VertexId v : mesh_->triangle(hint).v)
        if (v != kInfinite && mesh_->vertex(v).point() == p.point()) return v;
      return kNoVertex;
    default:
      return kNoVertex;
  }
}

// A vertex near a point of the region: the nearest of a few of each page, which share a line of the cache.
triangulation::VertexId PointMesh::hintFor(RegionId region, triangulation::Point2 p) const {
  constexpr int kOfEachPage = 4;
  const triangulation::VertexPages& pages = mesh_->vertexPages();
  VertexId nearest = kNoVertex;
  std::int64_t least = std::numeric_limits<std::int64_t>::max();
  for (std::uint32_t page : pages.pagesOf(region)) {
    auto alive = pages.aliveMask(page);
    for (int k = 0; k < kOfEachPage && alive != 0; ++k, alive &= alive - 1) {
      const VertexId v = pages.slotAt(page, static_cast<std::uint32_t>(std::countr_zero(alive)));
      const Vertex& u = mesh_->vertex(v);
      const std::int64_t dx = std::int64_t{u.x} - p.x, dz = std::int64_t{u.z} - p.z, distance = dx * dx + dz * dz;
      if (distance < least) least = distance, nearest = v;
    }
  }
  return nearest;
}

// Brings the vertices that change() looks at into the cache.
void PointMesh::prefetch(std::span<const points::Change> changes) const {
  const triangulation::VertexPages& pages = mesh_->vertexPages();
  std::vector<RegionId> regions;
  for (const points::Change& change : changes)
    if (const auto region = regions_.find(change.square); region != regions_.end()) {
      regions.push_back(region->second);
      for (std::uint32_t page : pages.pagesOf(region->second)) pages.prefetch(page);
    }
  for (RegionId region : regions)
    for (std::uint32_t page : pages.pagesOf(region)) pages.forEachBlock(page, [&](std::uint32_t block) { mesh_->prefetchVertices(block); });
}

// Where the search for each point that comes begins, found before any comes: so the triangles can be brought into the cache.
void PointMesh::findHints(std::span<const points::Change> changes) {
  hints_.clear();
  for (const points::Change& change : changes) {
    const LeafAddress& square = change.square;
    const auto region = regions_.find(square);
    const auto dx = static_cast<std::int32_t>(square.x() - anchor_.x), dz = static_cast<std::int32_t>(square.z() - anchor_.z);
    for (const points::Place& p : change.inserted) {
      hints_.push_back(region == regions_.end() ? kNoVertex : hintFor(region->second, {dx + p.x, dz + p.z}));
      if (hints_.back() != kNoVertex) mesh_->prefetch(mesh_->edgeOf(hints_.back()) >> 2);
    }
  }
}

bool PointMesh::begin(std::span<const Held> leaves) {
  held_.clear();
  active_.clear();
  for (const Held& leaf : leaves) {
    expects(leaf.mesh != nullptr, "a leaf whose points are taken is made");
    expects(!leaf.shades || leaf.shades->size() == leaf.mesh->vertices.size(), "each vertex has a shade, or none has");
    held_.push_back(leaf.mesh->address);
  }
  std::sort(held_.begin(), held_.end());
  if (!startOver()) return false;
  std::vector<Vertex> vertices;
  std::vector<terrain::Shade> shades;
  for (const Held& leaf : leaves) {
    const mesh::LeafMesh& m = *leaf.mesh;
    const lattice::Step dx = m.address.x() - anchor_.x, dz = m.address.z() - anchor_.z;
    for (std::size_t k = 0; k < m.vertices.size(); ++k) {
      const lattice::Step x = dx + m.vertices[k].x, z = dz + m.vertices[k].z;
      if (std::max(std::abs(x), std::abs(z)) >= kReach) return false;
      vertices.push_back({static_cast<std::int32_t>(x), static_cast<std::int32_t>(z), m.vertices[k].y, triangulation::kNoEdge});
      if (shaded_) shades.push_back(leaf.shades ? (*leaf.shades)[k] : terrain::Shade{});
    }
  }
  if (vertices.size() > 3 * points::kMaxPoints) return false;
  reserve(vertices.size());
  allow(vertices.size());
  if (vertices.empty()) return true;
  if (!start(vertices)) return false;
  TriangleId hint = mesh_->anyTriangle();
  for (std::size_t k = 0; k < vertices.size(); ++k) {
    const VertexId v = insert(vertices[k], hint);
    if (v == kNoVertex || mesh_->vertex(v).y != vertices[k].y) return false;
    if (shaded_) shades_[v] = shades[k];
  }
  forEachVertex([&](VertexId v) { mesh_->vertexPages().clearFresh(v); });
  return true;
}

bool PointMesh::follow(const Step& step) {
  if (!replaceLeaves(step)) return false;
  open_.clear();
  points::Reader reader(step.payload);
  std::vector<points::Change> changes;
  std::vector<LeafAddress> fresh(step.come.begin(), step.come.end());
  std::sort(fresh.begin(), fresh.end());
  const auto countOf = [this](const LeafAddress& square) { return count(square); };
  if (!reader.changes({held_, fresh, active_}, countOf, changes)) return false;
  std::size_t inserted = 0, removed = 0;
  for (const points::Change& change : changes) {
    inserted += change.inserted.size();
    removed += change.removed.size();
  }
  if (mesh_->liveVertices() + inserted > points::kMaxPoints) return false;
  reserve(inserted);
  allow(inserted + removed);
  std::vector<Resolved> resolved;
  if (!change(changes, resolved) || !readHeights(changes, resolved, reader, step.shades)) return false;
  active_.clear();
  for (const points::Change& change : changes) active_.push_back(change.square);
  std::sort(active_.begin(), active_.end());
  return true;
}

// Filling a star takes the square of its triangles.
bool PointMesh::isCheap(VertexId v) {
  std::size_t degree = 0;
  mesh_->forEachAround(v, [&](triangulation::HalfEdge) { ++degree; });
  return effort_.spend(degree * degree);
}

// What so many changes may cost: a usual one costs 4 to 40, so that only who means harm comes near.
void PointMesh::allow(std::size_t changes) { effort_ = {0, (std::size_t{1} << 20) + 256 * changes}; }

bool PointMesh::change(std::span<const points::Change> changes, std::vector<Resolved>& resolved) {
  std::vector<Vertex> begins;  // three of these begin an empty mesh
  prefetch(changes);
  for (const points::Change& change : changes) {
    Resolved& r = resolved.emplace_back();
    const bool needsList = !change.removed.empty() || !change.raised.empty();
    const std::vector<VertexId>& before = needsList ? list(change.square) : list_;
    expects(change.removed.empty() || change.removed.back() < before.size(), "the points that go are among those that were counted");
    for (std::uint32_t k : change.removed) r.removed.push_back(before[k]);
    std::size_t gone = 0, stays = 0;
    auto raised = change.raised.begin();
    for (std::size_t k = 0; k < before.size() && raised != change.raised.end(); ++k) {
      if (gone < r.removed.size() && r.removed[gone] == before[k]) {
        ++gone;
      } else if (stays++ == *raised) {
        r.raised.push_back(before[k]);
        ++raised;
      }
    }
    const lattice::Step dx = change.square.x() - anchor_.x, dz = change.square.z() - anchor_.z;
    if (std::max(std::abs(dx), std::abs(dz)) + change.square.side() > kReach) return false;
    if (mesh_->empty())
      for (const points::Place& p : change.inserted)
        begins.push_back({static_cast<std::int32_t>(dx + p.x), static_cast<std::int32_t>(dz + p.z), 0, triangulation::kNoEdge});
  }
  if (mesh_->empty() && !begins.empty() && !start(begins)) return false;
  TriangleId hint = mesh_->empty() ? 0 : mesh_->anyTriangle();
  findHints(changes);
  auto known = hints_.begin();
  for (std::size_t n = 0; n < changes.size(); ++n) {
    const points::Change& change = changes[n];
    const auto dx = static_cast<std::int32_t>(change.square.x() - anchor_.x), dz = static_cast<std::int32_t>(change.square.z() - anchor_.z);
    for (const points::Place& p : change.inserted) {
      constexpr std::ptrdiff_t kAhead = 3;
      if (hints_.end() - known > kAhead && known[kAhead] != kNoVertex) {
        const TriangleId soon = mesh_->edgeOf(known[kAhead]) >> 2;
        mesh_->prefetchCorners(soon);
        mesh_->prefetchNeighbours(soon);
      }
      expects(known != hints_.end(), "each point that comes has a hint");
      if (const VertexId near = *known++; near != kNoVertex) hint = mesh_->edgeOf(near) >> 2;
      const VertexId v = insert({dx + p.x, dz + p.z, 0, triangulation::kNoEdge}, hint);
      if (v == kNoVertex || !mesh_->vertexPages().fresh(v)) return false;
      resolved[n].inserted.push_back(v);
    }
  }
  for (const Resolved& r : resolved)
    for (VertexId v : r.removed)
      if (!isCheap(v) || mesh_->remove(v, everything_) != Change::kDone) return false;
  return true;
}

bool PointMesh::readHeights(std::span<const points::Change> changes, std::span<const Resolved> resolved, points::Reader& reader,
                            std::span<const std::uint8_t> shades) {
  const auto takeShade = [&](VertexId v) {
    if (!shaded_) return true;
    if (shades.size() < terrain::kShadeBytes) return false;
    shades_[v] = shadeOf(shades.data());
    shades = shades.subspan(terrain::kShadeBytes);
    return true;
  };
  for (std::size_t n = 0; n < changes.size(); ++n)
    for (VertexId v : resolved[n].raised) {
      if (!setHeight(v, reader.raised(changes[n].square.level, mesh_->vertex(v).y)) || !takeShade(v)) return false;
      mesh_->forEachAround(v, [&](triangulation::HalfEdge h) {
        mesh_->markChanged(mesh_->regionOf(h >> 2));
        mesh_->trianglePages().setFresh(h >> 2);
      });
    }
  points::Guesser guesser;
  for (std::size_t n = 0; n < changes.size(); ++n)
    for (VertexId v : resolved[n].inserted) {
      const points::Guess guess = guesser.guess(*mesh_, v, [&](VertexId u) { return !mesh_->vertexPages().fresh(u); });
      if (!setHeight(v, reader.inserted(changes[n].square.level, guess.y, guess.isSure)) || !takeShade(v)) return false;
      mesh_->vertexPages().clearFresh(v);
    }
  return reader.finished() && shades.empty();
}

bool PointMesh::setHeight(VertexId v, std::int32_t y) {
  mesh_->setHeight(v, y);
  return std::abs(y) <= lattice::kMaxHeight;
}

}  // namespace ridgecast::core
