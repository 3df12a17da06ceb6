#include "client/render/mesh_pass.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include "common/outcome/contract.h"
#include "common/shaders/shaders.h"

namespace ridgecast::render {
namespace {

constexpr std::string_view kFragment = R"(
uniform float near;
in vec3 offset;
in float depth;
layout(location = 0) out vec4 surface;
#ifdef SHADED
in vec3 normal, albedo;
layout(location = 1) out vec4 carried;
// Sun, sky and what the ground throws back, as shading.glsl without shadows and hollows, which a client without the terrain cannot know.
vec3 lit() {
  vec3 n = normalize(normal);
  vec3 sun = vec3(0.5609701, 0.5385313, -0.6283046);
  vec3 light = vec3(2.75, 2.4, 1.9) * max(dot(n, sun), 0.0) + vec3(0.27, 0.38, 0.56) * (0.55 + 0.45 * n.y);
  light += vec3(0.16, 0.14, 0.11) * max(0.5 - 0.5 * dot(n, vec3(sun.x, -0.3, sun.z)), 0.0);
  return albedo * light;
}
#endif
void main() {
  surface = vec4(offset, 1.0);
#ifdef SHADED
  carried = vec4(lit(), 1.0);
#endif
#ifdef LOGARITHMIC
  // Without glClipControl half of the float's range would be wasted: the logarithm spreads 0.1 m to 200 km evenly instead.
  gl_FragDepth = clamp(1.0 - log2(depth / near) / log2(200000.0 / near), 0.0, 1.0);
#endif
}
)";

constexpr std::size_t kShadeSize = 8, kVertexSize = sizeof(mesh::LocalVertex), kIndexSize = sizeof(std::uint32_t);
static_assert(kVertexSize == 12 && offsetof(mesh::LocalVertex, z) == 4 && offsetof(mesh::LocalVertex, y) == 8);
static_assert(sizeof(mesh::Triangle) == 12);

constexpr std::size_t kMinCapacity = std::size_t{1} << 18;  // elements

// A buffer of `bytes` that begins with the `kept` bytes of an older one.
GlObject grown(const GlObject& older, std::size_t kept, std::size_t bytes) {
  GlObject larger = makeBuffer();
  glBindBuffer(GL_COPY_WRITE_BUFFER, larger.name());
  glBufferData(GL_COPY_WRITE_BUFFER, static_cast<GLsizeiptr>(bytes), nullptr, GL_DYNAMIC_DRAW);
  if (!kept) return larger;
  glBindBuffer(GL_COPY_READ_BUFFER, older.name());
  glCopyBufferSubData(GL_COPY_READ_BUFFER, GL_COPY_WRITE_BUFFER, 0, 0, static_cast<GLsizeiptr>(kept));
  return larger;
}

// Room for `size` more elements, in a buffer that is twice as large when the old one is full.
std::size_t takeOrGrow(Arena& arena, GlObject& buffer, std::size_t elementSize, std::size_t size) {
  if (const auto start = arena.take(size)) return *start;
  const std::size_t old = arena.capacity(), capacity = std::max({old * 2, old + size, kMinCapacity});
  buffer = grown(buffer, old * elementSize, capacity * elementSize);
  arena.grow(capacity);
  return *arena.take(size);
}

void write(const GlObject& buffer, std::size_t start, std::size_t bytes, const void* data) {
  glBindBuffer(GL_COPY_WRITE_BUFFER, buffer.name());
  glBufferSubData(GL_COPY_WRITE_BUFFER, static_cast<GLintptr>(start), static_cast<GLsizeiptr>(bytes), data);
}

// One update's writes into one buffer. Each call costs a driver microseconds and may wait for drawing in progress, so adjacent ranges go
// together, as does everything for an empty buffer.
class Writes {
 public:
  void add(std::size_t start, std::size_t bytes, const void* data) { parts_.push_back({start, bytes, data}); }
  void write(const GlObject& buffer) {
    std::sort(parts_.begin(), parts_.end(), [](const Part& a, const Part& b) { return a.start < b.start; });
    std::vector<unsigned char> run;
    for (std::size_t k = 0; k < parts_.size();) {
      const std::size_t start = parts_[k].start;
      run.clear();
      for (; k < parts_.size() && parts_[k].start == start + run.size(); ++k) {
        const auto* bytes = static_cast<const unsigned char*>(parts_[k].data);
        run.insert(run.end(), bytes, bytes + parts_[k].bytes);
      }
      render::write(buffer, start, run.size(), run.data());
    }
  }

 private:
  struct Part {
    std::size_t start, bytes;
    const void* data;
  };
  std::vector<Part> parts_;
};

}  // namespace

MeshPass::MeshPass(Program program, bool reversedDepth, bool shaded)
    : program_(std::move(program)), reversedDepth_(reversedDepth), shaded_(shaded), vertexArray_(makeVertexArray()) {}

Outcome<MeshPass> MeshPass::create(bool shaded) {
  const bool reversed = epoxy_gl_version() >= 45 || epoxy_has_gl_extension("GL_ARB_clip_control");
  const std::string shades = shaded ? "#define SHADED\n" : "", logarithmic = reversed ? "" : "#define LOGARITHMIC\n";
  auto program = Program::build("mesh", shades + std::string(shaders::mesh_vertex), shades + logarithmic + std::string(kFragment));
  if (!program) return program.error();
  return MeshPass(std::move(*program), reversed, shaded);
}

// Reserves space for a leaf and its shades; update() writes its vertices and indices.
void MeshPass::place(const core::HeldLeaf& held, Slot& slot) {
  expects(held.mesh != nullptr, "a leaf that is drawn is made");
  const mesh::LeafMesh& leaf = *held.mesh;
  slot.vertices = leaf.vertices.size();
  slot.indices = leaf.triangles.size() * 3;
  if (!slot.indices) return;
  slot.firstVertex = takeOrGrow(vertexArena_, vertexBuffer_, kVertexSize, slot.vertices);
  slot.firstIndex = takeOrGrow(indexArena_, indexBuffer_, kIndexSize, slot.indices);
  if (shaded_) {
    if (shadeCapacity_ != vertexArena_.capacity())
      shadeBuffer_ =
          grown(shadeBuffer_, std::exchange(shadeCapacity_, vertexArena_.capacity()) * kShadeSize, vertexArena_.capacity() * kShadeSize);
    std::vector<std::array<std::uint8_t, kShadeSize>> shades(slot.vertices);
    if (held.shades)
      for (std::size_t k = 0; k < std::min(shades.size(), held.shades->size()); ++k) {
        const terrain::Shade& s = (*held.shades)[k];
        shades[k] = {static_cast<std::uint8_t>(s.normalX), static_cast<std::uint8_t>(s.normalZ), 0, 0, s.red, s.green, s.blue, 0};
      }
    write(shadeBuffer_, slot.firstVertex * kShadeSize, shades.size() * kShadeSize, shades.data());
  }
  slot.low = held.low;
  slot.high = held.high;
}

void MeshPass::giveBack(const Slot& slot) {
  if (!slot.indices) return;
  vertexArena_.giveBack(slot.firstVertex, slot.vertices);
  indexArena_.giveBack(slot.firstIndex, slot.indices);
}

void MeshPass::update(const core::Leaves& leaves) {
  for (auto slot = slots_.begin(); slot != slots_.end();) {
    const auto held = leaves.find(slot->first);
    const bool stale = held == leaves.end() || held->second.version != slot->second.version;
    if (stale) giveBack(slot->second);
    slot = stale ? slots_.erase(slot) : std::next(slot);
  }
  Writes vertices, indices;
  for (const auto& [address, held] : leaves) {
    const auto [entry, isNew] = slots_.try_emplace(address);
    if (!isNew) continue;
    Slot& slot = entry->second;
    slot.version = held.version;
    place(held, slot);
    if (!slot.indices) continue;
    vertices.add(slot.firstVertex * kVertexSize, slot.vertices * kVertexSize, held.mesh->vertices.data());
    indices.add(slot.firstIndex * kIndexSize, slot.indices * kIndexSize, held.mesh->triangles.data());
  }
  vertices.write(vertexBuffer_);
  indices.write(indexBuffer_);
}

void MeshPass::bindArrays() const {
  glBindVertexArray(vertexArray_.name());
  glBindBuffer(GL_ARRAY_BUFFER, vertexBuffer_.name());
  glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, indexBuffer_.name());
  glEnableVertexAttribArray(0);
  glVertexAttribIPointer(0, 3, GL_INT, kVertexSize, nullptr);
  if (!shaded_) return;
  glBindBuffer(GL_ARRAY_BUFFER, shadeBuffer_.name());
  glEnableVertexAttribArray(1);
  glVertexAttribPointer(1, 2, GL_BYTE, GL_TRUE, kShadeSize, nullptr);
  glEnableVertexAttribArray(2);
  glVertexAttribPointer(2, 3, GL_UNSIGNED_BYTE, GL_TRUE, kShadeSize, std::bit_cast<const void*>(std::uintptr_t{4}));
}

void MeshPass::redraw(const View& view, const Program& program, const std::function<void(const Leaf&)>& each) const {
  if (!vertexArena_.used()) return;
  const camera::Pose& pose = view.camera.pose;
  const int leafOffset = program.location("leafOffset");
  if (reversedDepth_) glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
  bindArrays();
  setCamera(program, view);
  program.set("near", static_cast<float>(kNear));
  program.set("reversedDepth", reversedDepth_ ? 1 : 0);
  const double cameraY = std::floor(pose.y * lattice::kStepsPerMetre);
  program.set("remainder", static_cast<float>(pose.remainderX), static_cast<float>(pose.remainderZ),
              static_cast<float>(pose.y * lattice::kStepsPerMetre - cameraY));

  const camera::Frustum frustum(pose, view.camera.projection);
  for (const auto& [address, slot] : slots_) {
    if (!slot.indices) continue;
    const lattice::Step x = address.x() - pose.x, z = address.z() - pose.z;
    constexpr lattice::Step kFarthest = std::numeric_limits<std::int32_t>::max() / 2;  // 4,194 km: an outdated scene after a jump
    if (std::abs(x) > kFarthest || std::abs(z) > kFarthest) continue;
    const auto metres = [](double steps) { return steps * lattice::kMetresPerStep; };
    if (!frustum.mayIntersect({metres(double(x + slot.low.x) - 1), metres(slot.low.y - cameraY - 1), metres(double(z + slot.low.z) - 1)},
                              {metres(double(x + slot.high.x)), metres(slot.high.y - cameraY), metres(double(z + slot.high.z))}))
      continue;
    if (each) each({address, slot.indices / 3});
    glUniform3i(leafOffset, static_cast<GLint>(x), static_cast<GLint>(z), static_cast<GLint>(-cameraY));
    glDrawElementsBaseVertex(GL_TRIANGLES, static_cast<GLsizei>(slot.indices), GL_UNSIGNED_INT,
                             std::bit_cast<const void*>(slot.firstIndex * kIndexSize), static_cast<GLint>(slot.firstVertex));
  }
  glBindVertexArray(0);
  if (reversedDepth_) glClipControl(GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
}

void MeshPass::draw(const View& view, const Surface& surface) const {
  drawInto(surface);
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_GREATER);
  glDepthMask(GL_TRUE);
  glClearDepth(0.0);
  glClearColor(0, 0, 0, 0);
  glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
  program_.use();
  redraw(view, program_, {});
  glDepthFunc(GL_LESS);
  glClearDepth(1.0);
  glDisable(GL_DEPTH_TEST);
}

}  // namespace ridgecast::render
