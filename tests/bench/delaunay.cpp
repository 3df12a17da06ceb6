// Insertion and removal against CGAL, the same points in the same order, in turn in one run.
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <random>
#include <stdexcept>

#include "common/triangulation/triangulation.h"
#include "tests/bench/bench.h"
#include "tests/bench/delaunay_input.h"

namespace ridgecast::bench {
namespace {

using namespace triangulation;

// The engine's regions: one for each leaf of 2^13 steps.
class Leaves : public Partition {
 public:
  explicit Leaves(int side) : side_(side), regions_(static_cast<std::size_t>(side) * side, kOutside) {}
  RegionId regionAt(Point2 p) const override {
    const int i = p.x >> 13, j = p.z >> 13;
    return i < 0 || j < 0 || i >= side_ || j >= side_ ? kOutside : regions_[static_cast<std::size_t>(i) * side_ + j];
  }
  void fill(Triangulation& mesh) {
    for (int i = 0; i < side_; ++i)
      for (int j = 0; j < side_; ++j) regions_[static_cast<std::size_t>(i) * side_ + j] = mesh.addRegion({i << 13, j << 13, 1 << 13});
  }

 private:
  int side_;
  std::vector<RegionId> regions_;
};

struct Times {
  double insert;   // each triangle known
  double located;  // found from a corner of it
  double remove;
  std::size_t left;
  double bytesPerTriangle;
};

Vertex vertexOf(const Insertion& p) { return {p.x, p.z, 0, kNoEdge}; }
int sideFor(std::size_t count) {
  int side = 1;
  while (static_cast<std::size_t>(side) * side * 1000 < count) ++side;
  return side;
}

// Refines a square of leaves with about 1,000 points each the way the engine does.
DelaunayInput makeInput(std::size_t count) {
  const int side = sideFor(count);
  Leaves leaves(side);
  Triangulation mesh(static_cast<std::uint32_t>(2 * count), leaves);
  leaves.fill(mesh);
  WriteSet all;
  all.allowAll();
  std::mt19937 rng(12345);
  DelaunayInput input;
  std::vector<std::uint32_t> indexOf(mesh.vertexCapacity());
  const auto push = [&](Point2 p, TriangleId t) {
    const auto index = static_cast<std::uint32_t>(input.insertions.size());
    std::uint32_t corner = index;
    for (VertexId c : mesh.triangle(t).v)
      if (c != kInfinite) corner = indexOf[c];
    VertexId v = kInfinite;
    if (mesh.insert({p.x, p.z, 0, kNoEdge}, t, all, &v) != Change::kDone) return;
    indexOf[v] = index;
    input.insertions.push_back({p.x, p.z, corner});
    input.at.push_back(t);
  };
  const Point2 seeds[3] = {{0, 0}, {0, 4096}, {4096, 0}};
  mesh.start({0, 0, 0, kNoEdge}, {0, 4096, 0, kNoEdge}, {4096, 0, 0, kNoEdge});
  for (const Point2& p : seeds) {
    const auto index = static_cast<std::uint32_t>(input.insertions.size());
    mesh.trianglePages().forEach(leaves.regionAt({1000, 1000}), [&](TriangleId t) {
      for (VertexId v : mesh.triangle(t).v)
        if (v != kInfinite && mesh.vertex(v).point() == p) indexOf[v] = index;
    });
    input.insertions.push_back({p.x, p.z, index == 0 ? 0 : index - 1});
    input.at.push_back(kNoSlot);
  }
  for (int i = 0; i <= 2 * side; ++i)
    for (int j = 0; j <= 2 * side; ++j) {
      const Point2 p{i * 4096, (i % 2 ? 2 * side - j : j) * 4096};
      push(p, mesh.locate(p, mesh.anyTriangle(), all));
    }
  std::vector<TriangleId> round;
  while (input.insertions.size() < count)
    for (int n = 0; n < side * side; ++n) {
      const int i = n / side, j = i % 2 ? side - 1 - n % side : n % side;
      const RegionId region = leaves.regionAt({i << 13, j << 13});
      round.clear();
      mesh.trianglePages().forEach(region, [&](TriangleId t) {
        mesh.trianglePages().clearFresh(t);
        if (rng() % 3 == 0) round.push_back(t);
      });
      for (TriangleId t : round) {
        if (input.insertions.size() >= count || !mesh.trianglePages().alive(t) || mesh.trianglePages().fresh(t)) continue;
        const auto& v = mesh.triangle(t).v;
        const double wa = 1 + rng() % 4, wb = 1 + rng() % 4, wc = 1 + rng() % 4, w = wa + wb + wc;
        const Vertex &a = mesh.vertex(v[0]), &b = mesh.vertex(v[1]), &c = mesh.vertex(v[2]);
        const Point2 p{static_cast<std::int32_t>((wa * a.x + wb * b.x + wc * c.x) / w),
                       static_cast<std::int32_t>((wa * a.z + wb * b.z + wc * c.z) / w)};
        if (orientation(a.point(), b.point(), p) > 0 && orientation(b.point(), c.point(), p) > 0 &&
            orientation(c.point(), a.point(), p) > 0)
          push(p, t);
      }
    }
  std::size_t grid = static_cast<std::size_t>(2 * side + 1) * (2 * side + 1);
  for (int n = 0; n < side * side; ++n) {
    const int i = n / side, j = i % 2 ? side - 1 - n % side : n % side;
    int k = 0;
    mesh.vertexPages().forEach(leaves.regionAt({i << 13, j << 13}), [&](VertexId v) {
      if (v != kInfinite && indexOf[v] >= grid && ++k % 2) input.removals.push_back(indexOf[v]);
    });
  }
  return input;
}

// What takes slots is the same in both runs, so the ids noted when the input was made hold.
void insertAll(const DelaunayInput& input, Triangulation& mesh, bool known, std::vector<VertexId>& vertices) {
  WriteSet all;
  all.allowAll();
  const auto& points = input.insertions;
  mesh.start(vertexOf(points[0]), vertexOf(points[1]), vertexOf(points[2]));
  const TriangleId first = mesh.twin(mesh.anyTriangle() * 4) >> 2;
  for (std::size_t k = 0; k < 3; ++k)
    for (VertexId v : mesh.triangle(first).v)
      if (mesh.vertex(v).x == points[k].x && mesh.vertex(v).z == points[k].z) vertices[k] = v;
  for (std::size_t k = 3; k < points.size(); ++k) {
    TriangleId t = input.at[k];
    if (!known)
      t = mesh.locate({points[k].x, points[k].z}, mesh.edgeOf(vertices[points[k].corner]) >> 2, all);
    else if (k + 4 < points.size())
      mesh.prefetch(input.at[k + 4]);
    if (mesh.insert(vertexOf(points[k]), t, all, &vertices[k]) != Change::kDone) throw std::runtime_error("an insertion was refused");
  }
}

Times ours(const DelaunayInput& input) {
  Times times{};
  std::vector<VertexId> vertices(input.insertions.size());
  {
    Leaves leaves(sideFor(input.insertions.size()));
    Triangulation mesh(static_cast<std::uint32_t>(2 * input.insertions.size()), leaves);
    leaves.fill(mesh);
    const Clock inserting;
    insertAll(input, mesh, false, vertices);
    times.located = inserting.seconds();
  }
  Leaves leaves(sideFor(input.insertions.size()));
  Triangulation mesh(static_cast<std::uint32_t>(2 * input.insertions.size()), leaves);
  leaves.fill(mesh);
  WriteSet all;
  all.allowAll();
  const Clock inserting;
  insertAll(input, mesh, true, vertices);
  times.insert = inserting.seconds();
  times.bytesPerTriangle = static_cast<double>(mesh.residentBytes()) / mesh.liveTriangles();
  const Clock removing;
  for (std::uint32_t k : input.removals)
    if (mesh.remove(vertices[k], all) != Change::kDone) throw std::runtime_error("a removal was refused");
  times.remove = removing.seconds();
  times.left = mesh.liveVertices();
  return times;
}

bool cgal(const Options& options, const std::string& file, std::uint64_t hash, Times& times, std::string& version) {
  const std::string program = options.programFolder + "/ridgecast-bench-cgal";
  if (!std::filesystem::exists(program)) return false;
  const auto close = [](FILE* f) { pclose(f); };
  std::unique_ptr<FILE, decltype(close)> pipe(popen(("'" + program + "' '" + file + "'").c_str(), "r"), close);
  char name[64] = "";
  unsigned long theirs = 0;
  if (!pipe ||
      std::fscanf(pipe.get(), "%63s %lx %lf %lf %lf %zu", name, &theirs, &times.located, &times.insert, &times.remove, &times.left) != 6)
    return false;
  if (theirs != hash) throw std::runtime_error("CGAL's program read another input");
  version = name;
  return true;
}

}  // namespace

Report delaunay(const Options& options) {
  Report report;
  for (const std::size_t count : options.quick ? std::vector<std::size_t>{100'000} : std::vector<std::size_t>{300'000, 1'000'000}) {
    const DelaunayInput input = makeInput(count);
    const std::uint64_t hash = input.hash();
    const std::string file = (std::filesystem::temp_directory_path() / ("ridgecast-delaunay-" + std::to_string(getpid()))).string();
    writeInput(input, file);
    std::vector<double> insert, remove, insertRatio, locatedRatio, knownRatio, removeRatio;
    std::string version;
    Times mine{}, theirs{};
    for (int round = 0; round < (options.quick ? 1 : 5); ++round) {
      mine = ours(input);
      insert.push_back(mine.insert * 1e9 / static_cast<double>(input.insertions.size()));
      remove.push_back(mine.remove * 1e9 / static_cast<double>(input.removals.size()));
      if (cgal(options, file, hash, theirs, version)) {
        if (theirs.left != mine.left) throw std::runtime_error("CGAL holds another number of vertices");
        insertRatio.push_back(mine.insert / theirs.located);
        locatedRatio.push_back(mine.located / theirs.located);
        knownRatio.push_back(mine.insert / theirs.insert);
        removeRatio.push_back(mine.remove / theirs.remove);
      }
    }
    std::filesystem::remove(file);
    const std::string size = count >= 1'000'000 ? "_1m" : "";
    char text[64];
    std::snprintf(text, sizeof text, "%016lx", static_cast<unsigned long>(hash));
    report.note(std::to_string(count) + " points, " + std::to_string(input.removals.size()) + " removed, input " + text +
                (version.empty() ? "; no CGAL program beside this one"
                                 : "; baseline CGAL " + version + ", EPICK, same flags: " RIDGECAST_BENCH_FLAGS));
    report.add("insert_ns" + size, median(insert), "ns a point");
    report.add("remove_ns" + size, median(remove), "ns a point");
    const auto ratio = [](const std::vector<double>& v) { return v.empty() ? NAN : median(v); };
    report.add("insert_ratio_cgal" + size, ratio(insertRatio),
               "of CGAL's insert(point, face at a corner of the triangle), ours into the known triangle as the engine does");
    report.add("insert_ratio_cgal_located" + size, ratio(locatedRatio), "of CGAL's time when ours, too, walks from a corner");
    report.add("insert_ratio_cgal_known" + size, ratio(knownRatio),
               "of CGAL's time when CGAL, too, is handed the face, recorded by a run before");
    report.add("remove_ratio_cgal" + size, ratio(removeRatio), "of CGAL's time");
    if (size.empty()) report.add("bytes_per_triangle", mine.bytesPerTriangle, "bytes, topology and positions");
  }
  return report;
}

}  // namespace ridgecast::bench
