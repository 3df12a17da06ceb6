// Deltas against leaves sent whole: one leaf of about 4,000 triangles that receives k points, and every changed leaf of a flight.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <memory>
#include <stdexcept>

#include "common/camera/path.h"
#include "common/codec/codec.h"
#include "common/codec/delta.h"
#include "common/mesh/leaf_mesh.h"
#include "common/terrain/terrain.h"
#include "common/triangulation/triangulation.h"
#include "server/pipeline/pipeline.h"
#include "server/scheduling/pool.h"
#include "tests/bench/bench.h"

namespace ridgecast::bench {
namespace {

using namespace triangulation;
using Bytes = std::vector<std::uint8_t>;

// ---- one leaf ----

// Nine leaves of level 0, side by side.
class Nine : public Partition {
 public:
  RegionId regionAt(Point2 p) const override {
    const int i = p.x >> 13, j = p.z >> 13;
    return i < 0 || j < 0 || i > 2 || j > 2 ? kOutside : regions_[i][j];
  }
  void fill(Triangulation& mesh) {
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) regions_[i][j] = mesh.addRegion({i << 13, j << 13, 1 << 13});
  }
  RegionId middle() const { return regions_[1][1]; }

 private:
  RegionId regions_[3][3] = {};
};

// A square of terrain that is refined where the error is greatest, as the engine does it: one point a triangle and pass, at its centroid.
class Refined {
 public:
  Refined(const terrain::Terrain& terrain, lattice::Point corner) : terrain_(terrain), corner_(corner), mesh_(400'000, leaves_) {
    leaves_.fill(mesh_);
    all_.allowAll();
    const int most = (3 << 13) - 1;
    mesh_.start(at({0, 0}), at({0, most}), at({most, 0}));
    const Point2 last{most, most};
    mesh_.insert(at(last), mesh_.locate(last, mesh_.anyTriangle(), all_), all_);
  }

  std::uint32_t triangles() const { return mesh_.triangleCount(leaves_.middle()); }

  // Inserts up to `most` of the points that are wanted most in the middle leaf, and, unless `alone`, what is wanted as much around it.
  void refine(std::size_t most, bool alone) {
    struct Wish {
      double error;
      TriangleId triangle;
      Point2 point;
      bool middle;
    };
    for (RegionId r = 0; r < mesh_.regionLimit(); ++r)
      mesh_.trianglePages().forEach(r, [&](TriangleId t) { mesh_.trianglePages().clearFresh(t); });
    std::vector<Wish> wishes;
    for (RegionId r = 1; r < mesh_.regionLimit(); ++r)
      mesh_.trianglePages().forEach(r, [&](TriangleId t) {
        if (mesh_.isGhost(t)) return;
        const Vertex &a = mesh_.vertex(mesh_.triangle(t).v[0]), &b = mesh_.vertex(mesh_.triangle(t).v[1]),
                     &c = mesh_.vertex(mesh_.triangle(t).v[2]);
        const Point2 p{(a.x + b.x + c.x) / 3, (a.z + b.z + c.z) / 3};
        const auto left = [&](const Vertex& u, const Vertex& v) {
          return std::int64_t{v.z - u.z} * (p.x - u.x) - std::int64_t{v.x - u.x} * (p.z - u.z);
        };
        if (left(a, b) <= 0 || left(b, c) <= 0 || left(c, a) <= 0) return;  // rounded out of its triangle
        const double flat = (a.y + b.y + c.y) / 3.0;
        const double area = std::abs(double(b.x - a.x) * (c.z - a.z) - double(b.z - a.z) * (c.x - a.x));
        wishes.push_back({std::abs(at(p).y - flat) * std::pow(area, 0.25), t, p, r == leaves_.middle()});
      });
    std::sort(wishes.begin(), wishes.end(), [](const Wish& a, const Wish& b) { return a.error > b.error; });
    std::size_t done = 0;
    bool any = false;
    for (const Wish& w : wishes) {
      if (done == most) break;
      if (alone && !w.middle) continue;
      if (!mesh_.trianglePages().alive(w.triangle) || mesh_.trianglePages().fresh(w.triangle)) continue;
      if (mesh_.insert(at(w.point), w.triangle, all_) != Change::kDone) continue;
      done += w.middle;
      any = true;
    }
    if (!any) throw std::runtime_error("nothing left to refine");
  }

  mesh::LeafMesh leaf() const {
    mesh::LeafMesh out{.address = lattice::leafAt({corner_.x + 8192, corner_.z + 8192}, 0), .vertices = {}, .triangles = {}};
    mesh_.trianglePages().forEach(leaves_.middle(), [&](TriangleId t) {
      mesh::Triangle triangle;
      for (std::size_t k = 0; k < 3; ++k) {
        const Vertex& v = mesh_.vertex(mesh_.triangle(t).v[k]);
        triangle[k] = static_cast<std::uint32_t>(out.vertices.size());
        out.vertices.push_back({v.x - 8192, v.z - 8192, v.y});
      }
      out.triangles.push_back(triangle);
    });
    mesh::canonicalize(out);
    return out;
  }

 private:
  Vertex at(Point2 p) const {
    lattice::Step x = corner_.x + p.x, z = corner_.z + p.z;
    std::int32_t y = 0;
    terrain_.heightSteps({&x, 1}, {&z, 1}, {&y, 1});
    return {p.x, p.z, y, kNoEdge};
  }

  const terrain::Terrain& terrain_;
  lattice::Point corner_;
  Nine leaves_;
  Triangulation mesh_;
  WriteSet all_;
};

Bytes deltaOf(const mesh::LeafMesh& base, const mesh::LeafMesh& target) {
  const auto payload = codec::encodeDelta(base, target, mesh::hashLeaf(target));
  if (!payload) throw std::runtime_error("a change has no delta");
  const auto decoded = codec::decodeDelta(*payload, base, mesh::hashLeaf(base));
  if (!decoded) throw std::runtime_error(decoded.error().message);
  if (!(decoded->leaf == target)) throw std::runtime_error("a delta does not make the leaf it was made from");
  return *payload;
}

// ---- a flight ----

struct Flown {
  double changed = 0, delta = 0, whole = 0, ratios = 0;  // leaves that changed: how many, bytes as deltas, bytes whole, sum of ratios
  double moved = 0, movedDelta = 0, movedWhole = 0;      // leaves that came by a split or merge
  double fresh = 0, freshWhole = 0, freshTriangles = 0;  // leaves with nothing before
  double wholeBytes = 0, wholeTriangles = 0, newTriangles = 0;
  double encode = 0, extract = 0, extracted = 0, decode = 0, wholeEncode = 0;  // seconds
};

// What a message adds to a payload: tags, lengths and the address.
constexpr double kFrameBytes = 14;

Flown fly(const std::shared_ptr<const terrain::Terrain>& terrain, const camera::Path& path, double seconds, std::uint32_t budget) {
  scheduling::Executor executor(0);
  settings::Settings asked;
  asked.triangleBudget = budget;
  pipeline::Pipeline pipeline(terrain, pipeline::grant(asked, {}), executor.makePool());
  std::map<lattice::LeafAddress, mesh::LeafMesh> held;
  std::map<lattice::LeafAddress, std::uint64_t> hashes;
  Flown f;
  const auto frame = [&](double t) {
    camera::Camera camera;
    camera.pose = camera::poseAt(path, t, [&](lattice::Point p) { return terrain->height(p); });
    camera.projection.verticalFov = path.verticalFov;
    pipeline.iterate(camera);
    std::map<lattice::LeafAddress, std::uint64_t> now;
    for (const mesh::LeafState& s : pipeline.leaves()) now[s.address] = s.hash;
    std::vector<std::pair<lattice::LeafAddress, mesh::LeafMesh>> gone;
    for (auto it = held.begin(); it != held.end();) {
      if (now.contains(it->first)) {
        ++it;
        continue;
      }
      gone.emplace_back(it->first, std::move(it->second));
      hashes.erase(it->first);
      it = held.erase(it);
    }
    for (const auto& [address, hash] : now) {
      if (const auto it = hashes.find(address); it != hashes.end() && it->second == hash) continue;
      Clock clock;
      mesh::LeafMesh target = pipeline.extract(address);
      f.extract += clock.seconds();
      ++f.extracted;
      clock = {};
      const double whole = static_cast<double>(codec::encodeLeaf(target).size());
      f.wholeEncode += clock.seconds();
      f.wholeBytes += whole;
      f.wholeTriangles += static_cast<double>(target.triangles.size());
      const bool known = held.contains(address);
      mesh::LeafMesh base;
      if (known) {
        base = held[address];
      } else {
        std::vector<const mesh::LeafMesh*> sources;
        for (const auto& [from, leaf] : gone)
          if (from.isAncestorOf(address) || address.isAncestorOf(from)) sources.push_back(&leaf);
        base = mesh::gather(address, sources);
      }
      double bytes = whole;
      if (!base.triangles.empty()) {
        clock = {};
        const auto payload = codec::encodeDelta(base, target, hash);
        f.encode += clock.seconds();
        if (payload) {
          clock = {};
          const auto decoded = codec::decodeDelta(*payload, base, known ? hashes[address] : mesh::hashLeaf(base));
          f.decode += clock.seconds();
          if (!decoded) throw std::runtime_error(decoded.error().message);
          if (!(decoded->leaf == target)) throw std::runtime_error("a delta does not make the leaf it was made from");
          bytes = std::min(bytes, static_cast<double>(payload->size()));
        }
      }
      if (known) {
        ++f.changed;
        f.delta += bytes + kFrameBytes;
        f.whole += whole + kFrameBytes;
        f.ratios += (bytes + kFrameBytes) / (whole + kFrameBytes);
        std::size_t shared = 0;
        for (auto a = base.triangles.begin(), b = target.triangles.begin(); a != base.triangles.end() && b != target.triangles.end();) {
          // Counted by place, not by index: a new vertex renumbers the others.
          const auto place = [](const mesh::LeafMesh& m, const mesh::Triangle& v) {
            return std::array{m.vertices[v[0]], m.vertices[v[1]], m.vertices[v[2]]};
          };
          const auto pa = place(base, *a), pb = place(target, *b);
          shared += pa == pb;
          if (pa <= pb) ++a;
          if (pb <= pa) ++b;
        }
        f.newTriangles += static_cast<double>(target.triangles.size() - shared);
      } else if (base.triangles.empty()) {
        ++f.fresh;
        f.freshWhole += whole;
        f.freshTriangles += static_cast<double>(target.triangles.size());
      } else {
        ++f.moved;
        f.movedDelta += bytes + kFrameBytes;
        f.movedWhole += whole + kFrameBytes;
      }
      hashes[address] = hash;
      held[address] = std::move(target);
    }
  };
  // The first picture is settled before the flight begins.
  for (int k = 0; k < 60 && !pipeline.settled(); ++k) frame(0);
  const Flown before = f;
  f = {};
  f.fresh = before.fresh;
  for (int n = 1; n <= static_cast<int>(seconds * 10); ++n) frame(n * 0.1);
  return f;
}

std::string text(const char* format, double a, double b, double c = 0) {
  char out[200];
  std::snprintf(out, sizeof out, format, a, b, c);
  return out;
}

}  // namespace

Report deltas(const Options& options) {
  Report report;
  const auto terrain = terrain::create("alpine", 1);
  if (!terrain) throw std::runtime_error(terrain.error().message);

  const lattice::Point corner{lattice::floorTo(1900 * 256, 13), lattice::floorTo(2000 * 256, 13)};
  for (const std::size_t k : {8, 64, 512}) {
    Refined refined(**terrain, corner);
    while (refined.triangles() < 4096)
      refined.refine(std::max<std::size_t>(16, std::min<std::size_t>(400, (4110 - refined.triangles()) / 2)), false);
    const mesh::LeafMesh base = refined.leaf();
    refined.refine(k, true);
    const mesh::LeafMesh target = refined.leaf();
    const double delta = static_cast<double>(deltaOf(base, target).size()), whole = static_cast<double>(codec::encodeLeaf(target).size());
    report.add("k" + std::to_string(k), delta / whole);
    report.note(text("%4.0f points: %5.0f bytes as a delta, %5.0f whole", static_cast<double>(k), delta, whole));
  }

  std::string file = RIDGECAST_PATHS "/alpine.json";
  for (std::size_t n = 0; n + 1 < options.arguments.size(); ++n)
    if (options.arguments[n] == "--path") file = options.arguments[n + 1];
  const auto path = camera::readPath(file);
  if (!path) throw std::runtime_error(path.error().message + " (--path FILE)");
  const double seconds = options.quick ? 4 : path->duration();
  const Flown f = fly(*terrain, *path, seconds, 0);
  report.add("flight", f.delta / f.whole);
  report.add("flight_mean_of_ratios", f.ratios / f.changed);
  report.add("splits_and_merges", f.movedDelta / f.movedWhole);
  report.add("bytes_per_new_triangle", f.delta / f.newTriangles, "B");
  report.add("whole_bytes_per_triangle", f.wholeBytes / f.wholeTriangles, "B");
  report.add("leaves_changed", f.changed);
  report.add("bytes_per_second", (f.delta + f.movedDelta + f.freshWhole) / seconds, "B/s");
  report.add("whole_bytes_per_second", (f.whole + f.movedWhole + f.freshWhole) / seconds, "B/s");
  report.add("extract_us_per_leaf", f.extract / f.extracted * 1e6, "us");
  report.add("encode_us_per_leaf", f.encode / (f.changed + f.moved) * 1e6, "us");
  report.add("decode_us_per_leaf", f.decode / (f.changed + f.moved) * 1e6, "us");
  report.add("whole_encode_us_per_leaf", f.wholeEncode / (f.changed + f.moved) * 1e6, "us");
  report.note("flight: " + file.substr(file.rfind('/') + 1) + ", default settings, 10 iterations a second, from the settled start on; " +
              std::to_string(static_cast<int>(kFrameBytes)) + " bytes a leaf added to both sides for address and frame");
  return report;
}

}  // namespace ridgecast::bench
