// CGAL's side of `ridgecast-bench delaunay`: replays the insertions and removals of a file. Prints
//   VERSION INPUT_HASH INSERT_SECONDS REMOVE_SECONDS VERTICES_LEFT
#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/version.h>

#include <chrono>
#include <cstdio>

#include "tests/bench/delaunay_input.h"

int main(int argc, char** argv) {
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  using Delaunay = CGAL::Delaunay_triangulation_2<Kernel>;
  if (argc != 2) return 2;
  const auto input = ridgecast::bench::readInput(argv[1]);
  Delaunay mesh;
  std::vector<Delaunay::Vertex_handle> handles(input.insertions.size());
  const auto now = [] { return std::chrono::steady_clock::now(); };
  const auto start = now();
  for (std::size_t k = 0; k < handles.size(); ++k) {
    const auto& p = input.insertions[k];
    handles[k] = mesh.insert(Delaunay::Point(p.x, p.z), p.corner == k ? Delaunay::Face_handle() : handles[p.corner]->face());
  }
  const auto inserted = now();
  for (std::uint32_t k : input.removals) mesh.remove(handles[k]);
  const auto removed = now();
  std::printf("%s %016lx %.6f %.6f %zu\n", CGAL_VERSION_STR, static_cast<unsigned long>(input.hash()),
              std::chrono::duration<double>(inserted - start).count(), std::chrono::duration<double>(removed - inserted).count(),
              static_cast<std::size_t>(mesh.number_of_vertices()));
}
