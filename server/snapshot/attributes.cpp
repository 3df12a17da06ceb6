#include "server/snapshot/attributes.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "common/terrain/materials.h"

namespace ridgecast::snapshot {
namespace {

using lattice::Step;
using Float3 = std::array<float, 3>;

constexpr int kFinest = -1, kWidest = 9;  // sample widths of a vertex, as powers of two in metres
constexpr std::size_t kBatch = 1024;

// A vertex, in every leaf that holds it.
struct Shared {
  Step x = 0, z = 0;
  std::int32_t y = 0;  // steps; the highest, for below the sides of a tile its skirt hangs
  std::int8_t width = kFinest;
  double area = 0;  // of its triangles, square steps, twice
};

struct Corner {
  Step x, z;
  std::uint32_t leaf, vertex;
};

std::int8_t widthOf(double metres) { return static_cast<std::int8_t>(std::clamp(std::ilogb(std::max(metres, 0.01)), kFinest, kWidest)); }

// `vertices` by x, then z.
void widenAlong(const Sides& sides, std::vector<Shared>& vertices) {
  constexpr double kOfError = 8;  // about the width of triangles that keep it
  constexpr double kOfGap = 0.7;  // the triangles beside a straight side are smaller than its edges
  std::array<std::vector<Shared*>, 4> along;
  for (Shared& v : vertices) {
    if (v.x == sides.low.x) along[0].push_back(&v);
    if (v.x == sides.high.x) along[1].push_back(&v);
    if (v.z == sides.low.z) along[2].push_back(&v);
    if (v.z == sides.high.z) along[3].push_back(&v);
  }
  for (const auto& side : along)
    for (std::size_t k = 1; k + 1 < side.size(); ++k) {
      const auto gap = [&](std::size_t j) { return side[j]->x - side[j - 1]->x + side[j]->z - side[j - 1]->z; };
      side[k]->width = widthOf(kOfGap * lattice::metres(std::min(gap(k), gap(k + 1))));
    }
  for (const auto& side : along)
    if (!side.empty()) side.front()->width = side.back()->width = widthOf(kOfError * sides.error);
}

std::vector<Shared> gather(const std::vector<gltf::Leaf>& leaves, const std::optional<Sides>& sides,
                           std::vector<std::vector<std::uint32_t>>& indices) {
  std::vector<Corner> corners;
  indices.resize(leaves.size());
  for (std::uint32_t l = 0; l < leaves.size(); ++l) {
    const mesh::LeafMesh& mesh = *leaves[l].mesh;
    indices[l].resize(mesh.vertices.size());
    for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v)
      corners.push_back({mesh.address.x() + mesh.vertices[v].x, mesh.address.z() + mesh.vertices[v].z, l, v});
  }
  std::sort(corners.begin(), corners.end(), [](const Corner& a, const Corner& b) { return a.x != b.x ? a.x < b.x : a.z < b.z; });
  std::vector<Shared> out;
  for (const Corner& c : corners) {
    const std::int32_t y = leaves[c.leaf].mesh->vertices[c.vertex].y;
    if (out.empty() || out.back().x != c.x || out.back().z != c.z) out.push_back({c.x, c.z, y, kFinest, 0});
    out.back().y = std::max(out.back().y, y);
    indices[c.leaf][c.vertex] = static_cast<std::uint32_t>(out.size() - 1);
  }
  for (std::uint32_t l = 0; l < leaves.size(); ++l) {
    const mesh::LeafMesh& mesh = *leaves[l].mesh;
    for (const mesh::Triangle& t : mesh.triangles) {
      const auto &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
      const double area = std::abs((double(b.z) - a.z) * (double(c.x) - a.x) - (double(b.x) - a.x) * (double(c.z) - a.z));
      for (const std::uint32_t v : t) out[indices[l][v]].area += area;
    }
  }
  for (Shared& v : out) {  // a vertex has a third of six triangles: the width squared is their area / 6 * 2
    v.width = widthOf(std::sqrt(v.area / 6) * lattice::kMetresPerStep);
  }
  if (sides) widenAlong(*sides, out);
  return out;
}

// The slope between neighbours a quarter of the width away on each side.
void normalsOf(const terrain::Terrain& terrain, const Shared* v, std::size_t n, Float3* out) {
  std::vector<Step> x, z;
  for (std::size_t k = 0; k < n; ++k) {
    const Step reach = Step{1} << (lattice::kStepBits + v[k].width - 1);
    for (const auto& [dx, dz] : {std::pair{-reach, Step{0}}, {reach, Step{0}}, {Step{0}, -reach}, {Step{0}, reach}}) {
      x.push_back(v[k].x + dx);
      z.push_back(v[k].z + dz);
    }
  }
  std::vector<float> h(x.size());
  terrain.heights(x, z, h);
  for (std::size_t k = 0; k < n; ++k) {
    const double reach = std::ldexp(1.0, v[k].width - 1), nx = h[4 * k] - h[4 * k + 1], nz = h[4 * k + 2] - h[4 * k + 3], ny = 2 * reach;
    const double length = std::sqrt(nx * nx + ny * ny + nz * nz);
    out[k] = {static_cast<float>(nx / length), static_cast<float>(ny / length), static_cast<float>(nz / length)};
  }
}

void coloursOf(const terrain::Terrain& terrain, const terrain::Colours& colours, const Shared* v, std::size_t n, const Float3* normals,
               std::array<std::uint16_t, 3>* out) {
  for (int width = kFinest; width <= kWidest; ++width) {
    std::vector<std::size_t> which;
    std::vector<Step> x, z;
    std::vector<float> height;
    std::vector<Float3> normal;
    for (std::size_t k = 0; k < n; ++k) {
      if (v[k].width != width) continue;
      which.push_back(k);
      x.push_back(v[k].x);
      z.push_back(v[k].z);
      height.push_back(static_cast<float>(v[k].y * lattice::kMetresPerStep));
      normal.push_back(normals[k]);
    }
    if (which.empty()) continue;
    std::vector<Float3> made(which.size());
    colours(x.data(), z.data(), height.data(), normal.data(), static_cast<float>(std::ldexp(1.0, width)), made.data(), made.size(),
            terrain.seed());
    for (std::size_t k = 0; k < which.size(); ++k)
      for (std::size_t c = 0; c < 3; ++c)
        out[which[k]][c] =
            made[k][c] > 0 ? static_cast<std::uint16_t>(std::lround(std::min(made[k][c], 1.0f) * 65535.0f)) : std::uint16_t{0};
  }
}

void materialsOf(const terrain::Terrain& terrain, std::span<const Shared> vertices, std::uint8_t* out) {
  std::vector<Step> x, z;
  for (const Shared& v : vertices) x.push_back(v.x), z.push_back(v.z);
  terrain.materials(x, z, {out, vertices.size()});
}

}  // namespace

bool addAttributes(const terrain::Terrain& terrain, const Attributes& wanted, gltf::Document& document, const std::optional<Sides>& sides,
                   scheduling::Pool& pool, const Watch& watch) {
  const terrain::Colours colours = wanted.colours ? terrain.colours() : terrain::Colours();
  std::vector<gltf::Leaf>& leaves = document.leaves;
  if (wanted.materials) document.materialNames = terrain::materialNames(terrain.ownMaterials());
  if (!wanted.normals && !colours && !wanted.materials) return true;
  std::vector<std::vector<std::uint32_t>> indices;
  const std::vector<Shared> vertices = gather(leaves, sides, indices);
  std::vector<Float3> normal(wanted.normals || colours ? vertices.size() : 0);
  std::vector<std::array<std::uint16_t, 3>> colour(colours ? vertices.size() : 0);
  std::vector<std::uint8_t> material(wanted.materials ? vertices.size() : 0);
  pool.forEach((vertices.size() + kBatch - 1) / kBatch, 1, [&](std::size_t k) {
    if (watch.over()) return;
    const std::size_t begin = k * kBatch, n = std::min(kBatch, vertices.size() - begin);
    if (!normal.empty()) normalsOf(terrain, &vertices[begin], n, &normal[begin]);
    if (!material.empty()) materialsOf(terrain, std::span(vertices).subspan(begin, n), &material[begin]);
    if (colours) coloursOf(terrain, colours, &vertices[begin], n, &normal[begin], &colour[begin]);
  });
  if (watch.over()) return false;
  for (std::size_t l = 0; l < leaves.size(); ++l)
    for (const std::uint32_t v : indices[l]) {
      if (wanted.normals) leaves[l].normals.push_back(normal[v]);
      if (colours) leaves[l].colours.push_back(colour[v]);
      if (wanted.materials) leaves[l].materials.push_back(material[v]);
    }
  return true;
}

}  // namespace ridgecast::snapshot
