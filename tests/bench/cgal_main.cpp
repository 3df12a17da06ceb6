// CGAL's side of `ridgecast-bench delaunay`: replays the insertions and removals of a file. Prints
//   VERSION INPUT_HASH LOCATED_SECONDS KNOWN_SECONDS REMOVE_SECONDS VERTICES_LEFT
// Located: insert() finds the face from one at a corner. Known: insert() is handed the face.
#include <cstddef>
#include <cstdlib>
#include <new>

// Hands out the same addresses in the same order once `used` is 0 again, so that the faces that one run has located are those of the next.
struct Ground {
  static constexpr std::size_t kBytes = std::size_t{2} << 30;  // of addresses; resident is what is touched
  static inline char* const base = static_cast<char*>(std::aligned_alloc(4096, kBytes));
  static inline std::size_t used = 0;
};
template <class T>
struct Arena {
  using value_type = T;
  Arena() = default;
  template <class U>
  Arena(const Arena<U>&) {}
  T* allocate(std::size_t n) {
    const std::size_t at = (Ground::used + 63) / 64 * 64;
    if (!Ground::base || n > (Ground::kBytes - at) / sizeof(T)) throw std::bad_alloc();
    Ground::used = at + n * sizeof(T);
    return reinterpret_cast<T*>(Ground::base + at);
  }
  void deallocate(T*, std::size_t) {}
  friend bool operator==(const Arena&, const Arena&) { return true; }
};
#define CGAL_ALLOCATOR(T) Arena<T>
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
  struct At {
    Delaunay::Face_handle face;
    Delaunay::Locate_type type;
    int index;
  };
  const std::size_t count = input.insertions.size();
  std::vector<Delaunay::Vertex_handle> handles(count);
  std::vector<At> at(count);
  const auto now = [] { return std::chrono::steady_clock::now(); };
  const auto seconds = [&](auto since) { return std::chrono::duration<double>(now() - since).count(); };
  enum { kNote, kLocated, kKnown };  // the first run notes the faces and touches the memory, so that neither of the others pays for that
  double inserting[3] = {0, 0, 0}, removing = 0;
  std::size_t left = 0;
  for (int run : {kNote, kLocated, kKnown}) {
    Ground::used = 0;
    Delaunay mesh;
    const auto start = now();
    for (std::size_t k = 0; k < count; ++k) {
      const auto& p = input.insertions[k];
      const Delaunay::Point point(p.x, p.z);
      const auto hint = [&] { return p.corner == k ? Delaunay::Face_handle() : handles[p.corner]->face(); };
      if (run == kNote) at[k].face = mesh.locate(point, at[k].type, at[k].index, hint());
      handles[k] = run == kLocated ? mesh.insert(point, hint()) : mesh.insert(point, at[k].type, at[k].face, at[k].index);
    }
    inserting[run] = seconds(start);
    const auto inserted = now();
    for (std::uint32_t k : input.removals) mesh.remove(handles[k]);
    removing = seconds(inserted);
    left = static_cast<std::size_t>(mesh.number_of_vertices());
  }
  std::printf("%s %016lx %.6f %.6f %.6f %zu\n", CGAL_VERSION_STR, static_cast<unsigned long>(input.hash()), inserting[kLocated],
              inserting[kKnown], removing, left);
}
