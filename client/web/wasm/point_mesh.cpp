// What the page takes from the C++ client, as functions of a WebAssembly module: one mesh a module. src/scene/point_mesh.ts calls them.
// Lists are given in `room`; what a pointer names lies there until the next call.

#include "client/core/mesh/point_mesh.h"
#include "common/settings/settings.h"

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

using namespace ridgecast;

// Nothing is caught here: what would throw ends the module.
extern "C" void* __cxa_allocate_exception(std::size_t) { __builtin_trap(); }
extern "C" void __cxa_throw(void*, void*, void (*)(void*)) { __builtin_trap(); }

namespace {

core::PointMesh held(false, settings::kDefaultBudget);
std::vector<std::byte> given;
std::vector<mesh::LeafMesh> leaves;  // to begin with
std::vector<core::PointMesh::Changed> changes;
mesh::LeafMesh made;
core::PointMesh::Drawing drawing;
struct Made {
  const mesh::LocalVertex* vertices;
  std::size_t vertexCount;
  const mesh::Triangle* triangles;
  std::size_t triangleCount;
} view;
struct Drawn {
  const std::uint32_t *ends, *blocks, *changed;
  const mesh::LocalVertex* corners;
  std::size_t blockCount, changedCount;
} drawn;

static_assert(sizeof(core::PointMesh::Changed) == 64 && sizeof(Made) == 16 && sizeof(Drawn) == 24 && sizeof(mesh::LocalVertex) == 12 &&
              sizeof(mesh::Triangle) == 12);

// The next `count` of what was given.
template <class T>
std::span<const T> take(const std::byte*& at, std::size_t count) {
  const std::span<const T> all(reinterpret_cast<const T*>(at), count);
  at += all.size_bytes();
  return all;
}

}  // namespace

#define EXPORT(name) extern "C" __attribute__((export_name(#name)))

EXPORT(room) std::byte* room(std::size_t bytes) {
  given.resize(bytes);
  return given.data();
}

// Given: the leaf's vertices and triangles.
EXPORT(hashLeaf)
std::uint64_t hashLeaf(std::int32_t level, std::int64_t i, std::int64_t j, std::size_t vertices, std::size_t triangles) {
  const std::byte* at = given.data();
  const auto v = take<mesh::LocalVertex>(at, vertices);
  const auto t = take<mesh::Triangle>(at, triangles);
  return mesh::hashLeaf({{level, i, j}, {v.begin(), v.end()}, {t.begin(), t.end()}});
}

EXPORT(hashTerm) std::uint64_t hashTerm(std::int32_t level, std::int64_t i, std::int64_t j, std::uint64_t leafHash) {
  return mesh::hashTerm({level, i, j}, leafHash);
}

// Given: the vertices of a leaf to begin with.
EXPORT(hold) void hold(std::int32_t level, std::int64_t i, std::int64_t j, std::size_t vertices) {
  const std::byte* at = given.data();
  const auto v = take<mesh::LocalVertex>(at, vertices);
  leaves.push_back({{level, i, j}, {v.begin(), v.end()}, {}});
}

EXPORT(begin) bool begin() {
  std::vector<core::PointMesh::Held> all;
  for (const mesh::LeafMesh& leaf : leaves) all.push_back({&leaf, nullptr});
  const bool begun = held.begin(all);
  leaves.clear();
  return begun;
}

// Given: the addresses of the leaves that go, of those that come, and the payload.
EXPORT(follow) bool follow(std::size_t gone, std::size_t come, std::size_t bytes) {
  const std::byte* at = given.data();
  const auto goes = take<lattice::LeafAddress>(at, gone), comes = take<lattice::LeafAddress>(at, come);
  return held.follow({goes, comes, take<std::uint8_t>(at, bytes), {}});
}

// Takes the leaves that changed.
EXPORT(takeChanged) std::size_t takeChanged() {
  changes = held.takeChanged();
  return changes.size();
}
EXPORT(changed) const core::PointMesh::Changed* changed() { return changes.data(); }
EXPORT(extract) const Made* extract(std::int32_t level, std::int64_t i, std::int64_t j) {
  made = held.extract({level, i, j}).mesh;
  view = {made.vertices.data(), made.vertices.size(), made.triangles.data(), made.triangles.size()};
  return &view;
}
// Those that were taken last.
EXPORT(draw) const Drawn* draw() {
  held.draw(changes, drawing);
  drawn = {drawing.ends.data(),    drawing.blocks.data(), drawing.changed.data(),
           drawing.corners.data(), drawing.blocks.size(), drawing.changed.size()};
  return &drawn;
}
