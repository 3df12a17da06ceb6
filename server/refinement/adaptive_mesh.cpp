// Storage: what is kept beside the mesh follows its records, and changes of single vertices.
#include "server/refinement/adaptive_mesh.h"

#include <bit>
#include <cmath>

#include "common/outcome/contract.h"

namespace ridgecast::refinement {

using lattice::Step;
using triangulation::Change;
using triangulation::kNoEdge;
using triangulation::kOutside;
using triangulation::Move;
using triangulation::Point2;
using triangulation::TrianglePages;
using triangulation::Vertex;
using triangulation::VertexPages;
using triangulation::WriteSet;

namespace {
constexpr float kFixed = std::numeric_limits<float>::infinity();  // the loss of a fixed vertex
}  // namespace

AdaptiveMesh::AdaptiveMesh(std::shared_ptr<const terrain::Terrain> terrain, std::uint32_t triangles, Metric metric,
                           const triangulation::Partition& partition, double colourError)
    : mesh_(triangles, partition),
      partition_(partition),
      terrain_(std::move(terrain)),
      metric_(metric),
      colour_(terrain_, colourError),
      candidates_(mesh_.triangleCapacity() / Candidates::kSlots),
      checks_(mesh_.triangleCapacity() / TrianglePages::kSlots),
      screens_(mesh_.triangleCapacity() / TrianglePages::kSlots),
      hashes_(mesh_.triangleCapacity()),
      losses_(mesh_.vertexCapacity() / VertexPages::kSlots),
      extras_(mesh_.vertexCapacity()),
      curvature_(metric == Metric::kThesis ? mesh_.vertexCapacity() : 0),
      regions_(1) {
  regions_[kOutside].level = kOutsideLevel;
  everything_.allowAll();
}

std::size_t AdaptiveMesh::memoryBytes() const {
  const auto bytesOf = [](const auto& pages, std::size_t ofPage, std::size_t ofSlot) {
    return pages.pagesInUse() * ofPage + std::size_t{pages.blocksInUse()} * pages.kBlock * ofSlot;
  };
  return mesh_.residentBytes() +
         bytesOf(mesh_.trianglePages(), sizeof(NextCheck) + sizeof(PageScreen),
                 sizeof(Candidates) / Candidates::kSlots + sizeof(std::uint64_t)) +
         bytesOf(mesh_.vertexPages(), sizeof(PageLosses), sizeof(VertexExtra));
}

void AdaptiveMesh::setAnchor(lattice::Point anchor) {
  const auto dx = static_cast<std::int32_t>(anchor_.x - anchor.x), dz = static_cast<std::int32_t>(anchor_.z - anchor.z);
  anchor_ = anchor;
  if (mesh_.empty()) return;
  mesh_.translate(dx, dz);
  for (RegionId region = 0; region < mesh_.regionLimit(); ++region)
    if (mesh_.trianglePages().hasRegion(region))
      mesh_.trianglePages().forEach(region, [&](TriangleId t) {
        if (mesh_.trianglePages().fresh(t)) return;  // it has no candidate yet
        Candidates& four = candidates_[t / Candidates::kSlots];
        four.x[t % Candidates::kSlots] += dx;
        four.z[t % Candidates::kSlots] += dz;
      });
}

// ---- regions ----

triangulation::RegionId AdaptiveMesh::addRegion(const triangulation::Square& square, int level) {
  const RegionId region = mesh_.addRegion(square);
  if (region >= regions_.size()) regions_.resize(region + 1);
  regions_[region] = {};
  regions_[region].level = level;
  return region;
}

bool AdaptiveMesh::split(std::span<const RegionId> regions, const triangulation::Triangulation::Loop& loop) {
  return mesh_.split(regions, loop, moves(nullptr));
}

void AdaptiveMesh::refile(RegionId region, std::vector<VertexId>& moved) { mesh_.refile(region, moves(&moved)); }

void AdaptiveMesh::takeFreshVertices(RegionId region, std::vector<VertexId>& out) {
  VertexPages& pages = mesh_.vertexPages();
  pages.takeFreshPages(region, [&](std::uint32_t page) {
    pages.forEachIn(page, pages.freshMask(page), [&](VertexId v) {
      out.push_back(v);
      pages.clearFresh(v);
    });
  });
}

void AdaptiveMesh::compact(RegionId region) { mesh_.compact(region, moves(nullptr)); }

triangulation::Moves AdaptiveMesh::moves(std::vector<VertexId>* moved) {
  return {[this](std::span<const Move> list) { moveTriangles(list); },
          [this, moved](std::span<const Move> list) {
            moveVertices(list);
            if (moved)
              for (const Move& move : list) moved->push_back(move.to);
          }};
}

namespace {
// visit(page, run) for every run of moves to one page.
template <class Storage, class F>
void forEachPage(const Storage& pages, std::span<const Move> moves, F&& visit) {
  while (!moves.empty()) {
    const std::uint32_t page = pages.pageOf(moves.front().to);
    const auto end = std::find_if(moves.begin(), moves.end(), [&](const Move& m) { return pages.pageOf(m.to) != page; });
    const auto count = static_cast<std::size_t>(end - moves.begin());
    visit(page, moves.first(count));
    moves = moves.subspan(count);
  }
}
}  // namespace

void AdaptiveMesh::moveTriangles(std::span<const Move> moves) {
  const TrianglePages& pages = mesh_.trianglePages();
  const RegionId region = mesh_.regionOf(moves.front().to);
  forEachPage(pages, moves, [&](std::uint32_t number, std::span<const Move> run) {
    Mask slots = 0;
    for (const Move& move : run) slots |= Mask{1} << pages.indexOf(move.to);
    const Mask evaluated = pages.aliveMask(number) & ~pages.freshMask(number);
    if ((evaluated & ~slots) == 0) beginScreen(number, -1);  // new ones beside them have not been looked at
    for (const auto& [from, to] : run) {
      Candidate c = candidate(from);
      c.error = std::abs(c.error);  // a candidate that moves is not dormant
      setCandidate(to, c);
      setHash(to, hashes_[from]);
    }
    wakeCandidate(run.front().to, region);
  });
}

void AdaptiveMesh::moveVertices(std::span<const Move> moves) {
  const RegionId region = mesh_.regionOfVertex(moves.front().to);
  for (const auto& [from, to] : moves) {
    extras_[to] = extras_[from];
    if (metric_ == Metric::kThesis) curvature_[to] = curvature_[from];
  }
  forEachPage(mesh_.vertexPages(), moves, [&](std::uint32_t, std::span<const Move> run) { wakeVertex(run.front().to, region); });
}

// ---- vertices ----

// What is kept beside a vertex just inserted.
void AdaptiveMesh::keepExtra(VertexId v, std::int32_t fineY, int level, float loss) {
  const std::uint32_t page = mesh_.vertexPages().pageOf(v);
  if (std::popcount(mesh_.vertexPages().aliveMask(page)) == 1) losses_[page] = {};  // what another region left there is forgotten
  VertexExtra& extra = extras_[v];
  extra.loss = loss;
  extra.fineY = fineY;
  extra.level = static_cast<std::uint32_t>(level) & 31;
}

void AdaptiveMesh::addCurvature(std::span<const VertexId> vertices) {
  if (metric_ != Metric::kThesis) return;
  std::vector<Step> x, z;
  for (VertexId v : vertices) {
    x.push_back(anchor_.x + mesh_.vertex(v).x);
    z.push_back(anchor_.z + mesh_.vertex(v).z);
  }
  std::vector<float> out(vertices.size());
  terrain::curvatures(*terrain_, x, z, Step{1} << lattice::kStepBits, out);
  heights_ += 9 * vertices.size();
  for (std::size_t k = 0; k < vertices.size(); ++k) curvature_[vertices[k]] = out[k];
}

std::vector<std::int32_t> AdaptiveMesh::heightsAt(std::span<const lattice::Point> points) {
  std::vector<Step> x, z;
  for (const lattice::Point& p : points) {
    x.push_back(p.x);
    z.push_back(p.z);
  }
  std::vector<std::int32_t> y(points.size());
  terrain_->heightSteps(x, z, y);
  heights_ += y.size();
  return y;
}

triangulation::Vertex AdaptiveMesh::vertexAt(const GridPoint& p) const {
  const Point2 q = local(p.at);
  return {q.x, q.z, lattice::snapHeight(p.y, levelAt(q)), kNoEdge};
}

void AdaptiveMesh::start(const GridPoint& a, const GridPoint& b, const GridPoint& c) {
  mesh_.start(vertexAt(a), vertexAt(b), vertexAt(c));
  const TriangleId first = mesh_.twin(mesh_.anyTriangle() * 4) >> 2;
  const auto& corners = mesh_.triangle(first).v;
  for (VertexId v : corners)
    for (const GridPoint& p : {a, b, c})
      if (mesh_.vertex(v).point() == local(p.at)) keepExtra(v, p.y, levelAt(local(p.at)), kFixed);
  addCurvature(corners);
}

void AdaptiveMesh::insertGrid(std::span<const GridPoint> points, TriangleId& hint) {
  std::vector<VertexId> inserted;
  for (const GridPoint& p : points) {
    const Point2 at = local(p.at);
    const TriangleId t = mesh_.locate(at, hint, everything_);
    VertexId v;
    const Change change = mesh_.insert(vertexAt(p), t, everything_, &v);
    if (change == Change::kFull) throw std::bad_alloc();
    if (change == Change::kDone) {
      keepExtra(v, p.y, levelAt(at), kFixed);
      inserted.push_back(v);
      hint = mesh_.edgeOf(v) >> 2;
    } else {  // refinement was here before
      for (VertexId corner : mesh_.triangle(t).v)
        if (corner != triangulation::kInfinite && mesh_.vertex(corner).point() == at) setFixed(corner, true);
      hint = t;
    }
  }
  addCurvature(inserted);
}

void AdaptiveMesh::setFixed(VertexId v, bool fixed) {
  if (fixed == isFixed(v)) return;
  extras_[v].loss = fixed ? kFixed : 0;
  wakeVertex(v, mesh_.regionOfVertex(v));
}

void AdaptiveMesh::drop(VertexId v) {
  [[maybe_unused]] const Change change = mesh_.remove(v, everything_);
  expects(change == Change::kDone, "what was planned can be done");
}

void AdaptiveMesh::snap(VertexId v) {
  const int level = regions_[mesh_.regionOfVertex(v)].level;
  VertexExtra& extra = extras_[v];
  if (static_cast<int>(extra.level) <= level + 1) return;
  extra.level = static_cast<std::uint32_t>(level) & 31;
  const std::int32_t y = lattice::snapHeight(extra.fineY, level);
  if (y == mesh_.vertex(v).y) return;
  setHeight(v, y);
  mesh_.forEachAround(v, [&](triangulation::HalfEdge h) {
    mesh_.trianglePages().setFresh(h >> 2);
    mesh_.markChanged(mesh_.regionOf(h >> 2));
  });
}

// ---- other ground ----

void AdaptiveMesh::setTerrain(std::shared_ptr<const terrain::Terrain> terrain, std::span<const lattice::Area> changed) {
  terrain_ = std::move(terrain);
  colour_.setTerrain(terrain_);
  changed_.assign(changed.begin(), changed.end());
}

void AdaptiveMesh::raiseVertices(RegionId region) {
  std::vector<VertexId> inside;
  std::vector<lattice::Point> places;
  if (!mesh_.vertexPages().hasRegion(region)) return;
  mesh_.vertexPages().forEach(region, [&](VertexId v) {
    const lattice::Point p = absolute(mesh_.vertex(v).point());
    if (std::ranges::none_of(changed_, [&](const lattice::Area& a) { return a.holds(p); })) return;
    inside.push_back(v);
    places.push_back(p);
  });
  const std::vector<std::int32_t> heights = heightsAt(places);
  addCurvature(inside);
  for (std::size_t k = 0; k < inside.size(); ++k) {
    const VertexId v = inside[k];
    VertexExtra& extra = extras_[v];
    if (!isFixed(v)) extra.loss = 0;  // what it was worth says nothing any more
    wakeVertex(v, region);
    extra.fineY = heights[k];
    const std::int32_t y = lattice::snapHeight(extra.fineY, static_cast<int>(extra.level));
    if (y != mesh_.vertex(v).y) setHeight(v, y);
  }
}

void AdaptiveMesh::refreshTriangles(RegionId region) {
  TrianglePages& pages = mesh_.trianglePages();
  if (!pages.hasRegion(region)) return;
  bool any = false;
  pages.forEach(region, [&](TriangleId t) {
    if (mesh_.isGhost(t)) return;
    const lattice::Area box = boxOf(t);
    if (std::ranges::none_of(changed_, [&](const lattice::Area& a) { return a.meets(box); })) return;
    pages.setFresh(t);
    any = true;
  });
  if (any) mesh_.markChanged(region);
}

lattice::Area AdaptiveMesh::boxOf(TriangleId t) const {
  const auto& v = mesh_.triangle(t).v;
  const Vertex &a = mesh_.vertex(v[0]), &b = mesh_.vertex(v[1]), &c = mesh_.vertex(v[2]);
  return {anchor_.x + std::min({a.x, b.x, c.x}), anchor_.z + std::min({a.z, b.z, c.z}), anchor_.x + std::max({a.x, b.x, c.x}) + 1,
          anchor_.z + std::max({a.z, b.z, c.z}) + 1};
}

// False: the change would leave the write set.
bool AdaptiveMesh::insertOne(const Pending& wanted, RegionId region, const View& view, WriteSet& set, Work& work) {
  const TrianglePages& pages = mesh_.trianglePages();
  const Candidate c = candidate(wanted.triangle);
  // Its triangle is gone, and perhaps another in its place: judged again next time.
  if (!pages.alive(wanted.triangle) || pages.fresh(wanted.triangle) || !(c.point == wanted.point)) return true;
  const int level = levelAt(c.point);
  VertexId v;
  const Change change = mesh_.insert({c.point.x, c.point.z, lattice::snapHeight(c.y, level), kNoEdge}, wanted.triangle, set, &v);
  if (change == Change::kDeferred) return false;
  if (change != Change::kDone) {
    wakeCandidate(wanted.triangle, region);
    return true;
  }
  mesh_.forEachAround(v, [&](triangulation::HalfEdge h) { prefetchEvaluation(h >> 2); });
  keepExtra(v, c.y, level, c.error);
  foldLoss(mesh_.vertex(v), v, c.error, mesh_.regionOfVertex(v), view);
  addCurvature({&v, 1});
  ++work.inserted;
  return true;
}

void AdaptiveMesh::insertWanted(RegionId region, const View& view, WriteSet& set, Work& work) {
  work.deferred.clear();
  const std::vector<Pending>& pending = work.pending;
  constexpr std::size_t kAhead = 3;
  const auto fetch = [&](std::size_t k) {
    if (k >= pending.size()) return;
    mesh_.prefetchCorners(pending[k].triangle);
    mesh_.prefetchNeighbours(pending[k].triangle);
  };
  for (std::size_t k = 0; k < kAhead; ++k) fetch(k);
  for (std::size_t k = 0; k < pending.size(); ++k) {
    fetch(k + kAhead);
    if (k + 1 < pending.size())
      for (triangulation::HalfEdge h : mesh_.triangle(pending[k + 1].triangle).twin) mesh_.prefetchCorners(h >> 2);
    if (!insertOne(pending[k], region, view, set, work)) work.deferred.push_back(pending[k]);
  }
}

void AdaptiveMesh::insertDeferred(RegionId region, const View& view, Work& work) {
  for (const Pending& wanted : work.deferred) insertOne(wanted, region, view, everything_, work);
}

}  // namespace ridgecast::refinement
