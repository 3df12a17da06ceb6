#include "client/c/boundary.h"

namespace ridgecast::c {

namespace {
struct Made {
  rc_mesh seen{};  // first, so that a pointer to it is one to the whole
  world::Mesh mesh;
};
}  // namespace

const rc_mesh* made(world::Mesh&& mesh) {
  auto made = std::make_unique<Made>();
  made->mesh = std::move(mesh);
  const world::Mesh& held = made->mesh;
  const auto metres = [](lattice::Step steps) { return static_cast<double>(steps) * lattice::kMetresPerStep; };
  made->seen = {.origin = {metres(held.origin.x), metres(held.origin.z)},
                .error = held.error,
                .vertex_count = held.positions.size(),
                .triangle_count = held.triangles.size(),
                .positions = held.positions.empty() ? nullptr : held.positions.front().data(),
                .triangles = held.triangles.empty() ? nullptr : held.triangles.front().data()};
  return &made.release()->seen;
}

}  // namespace ridgecast::c

void rc_mesh_close(const rc_mesh* mesh) {
  static_assert(std::is_standard_layout_v<rc_mesh>);
  delete reinterpret_cast<const ridgecast::c::Made*>(mesh);
}
