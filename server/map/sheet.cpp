#include "server/map/sheet.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/lattice/lattice.h"
#include "common/outcome/contract.h"

namespace ridgecast::map {
namespace {

using lattice::Step;
using Float3 = std::array<float, 3>;

// One row of middles; row and column may lie outside the sheet.
struct Row {
  std::vector<Step> x, z;
  std::vector<float> height;

  void fill(const terrain::Terrain& terrain, const Sheet& sheet, std::int64_t row, std::int64_t firstColumn, std::size_t count) {
    x.resize(count);
    z.assign(count, static_cast<Step>(std::llround(sheet.z + static_cast<double>(row) * sheet.pitchZ)));
    height.resize(count);
    for (std::size_t k = 0; k < count; ++k)
      x[k] = static_cast<Step>(std::llround(sheet.x + static_cast<double>(firstColumn + static_cast<std::int64_t>(k)) * sheet.pitchX));
    if (!sheet.nodes.empty()) bend(sheet, row, firstColumn);
    terrain.heights(x, z, height);
  }

 private:
  void bend(const Sheet& sheet, std::int64_t row, std::int64_t firstColumn) {
    const std::size_t across = sheet.nodesAcross(), down = sheet.nodes.size() / across;
    const auto before = [](double at, std::size_t nodes) {
      return static_cast<std::size_t>(std::clamp(std::floor(at), 0.0, static_cast<double>(nodes - 2)));
    };
    const double v = (static_cast<double>(row) + 0.5) / Sheet::kNodePixels;
    const std::size_t j = before(v, down);
    for (std::size_t k = 0; k < x.size(); ++k) {
      const double u = (static_cast<double>(firstColumn + static_cast<std::int64_t>(k)) + 0.5) / Sheet::kNodePixels;
      const std::size_t i = before(u, across);
      const double s = u - static_cast<double>(i), t = v - static_cast<double>(j);
      const Sheet::Node *const north = &sheet.nodes[j * across + i], *const south = north + across;
      const auto mixed = [&](double Sheet::Node::*c) {
        return (north[0].*c * (1 - s) + north[1].*c * s) * (1 - t) + (south[0].*c * (1 - s) + south[1].*c * s) * t;
      };
      x[k] = static_cast<Step>(std::llround(mixed(&Sheet::Node::x)));
      z[k] = static_cast<Step>(std::llround(mixed(&Sheet::Node::z)));
    }
  }

 public:
};

std::uint8_t srgb(float linear) {
  const float v = std::clamp(linear, 0.0f, 1.0f);  // NaN stays, and becomes 0 below
  const float s = v <= 0.0031308f ? 12.92f * v : 1.055f * std::pow(v, 1 / 2.4f) - 0.055f;
  return s > 0 ? static_cast<std::uint8_t>(std::lround(s * 255)) : std::uint8_t{0};
}

Float3 normalOf(float west, float east, float north, float south, float spanX, float spanZ) {
  const float nx = (west - east) / spanX, nz = (north - south) / spanZ, length = std::sqrt(nx * nx + 1 + nz * nz);
  return {nx / length, 1 / length, nz / length};
}

void expectsNodes(const Sheet& sheet) {
  expects(sheet.nodes.empty() || sheet.nodes.size() == sheet.nodesAcross() * (sheet.rows / Sheet::kNodePixels + 1),
          "a bent sheet has a node at each 32nd corner of its pixels");
}

}  // namespace

std::vector<float> heights(const terrain::Terrain& terrain, const Sheet& sheet, const std::stop_token& stop) {
  expectsNodes(sheet);
  std::vector<float> out;
  out.reserve(sheet.pixels());
  Row row;
  for (std::uint32_t j = 0; j < sheet.rows; ++j) {
    if (stop.stop_requested()) return {};
    row.fill(terrain, sheet, j, 0, sheet.columns);
    out.insert(out.end(), row.height.begin(), row.height.end());
  }
  return out;
}

std::vector<std::uint8_t> colours(const terrain::Terrain& terrain, const Sheet& sheet, const std::stop_token& stop) {
  expectsNodes(sheet);
  const terrain::Colours colours = terrain.colours();
  if (!colours) return {};
  const auto metres = [](double steps) { return static_cast<float>(steps * lattice::kMetresPerStep); };
  const std::size_t across = std::size_t{sheet.columns} + 2;  // a pixel more on both sides
  std::array<Row, 3> rows;
  rows[0].fill(terrain, sheet, -1, -1, across);
  rows[1].fill(terrain, sheet, 0, -1, across);
  std::vector<Float3> normal(sheet.columns), colour(sheet.columns);
  std::vector<std::uint8_t> out;
  out.reserve(3 * sheet.pixels());
  for (std::uint32_t j = 0; j < sheet.rows; ++j) {
    if (stop.stop_requested()) return {};
    const Row &north = rows[j % 3], &here = rows[(j + 1) % 3];
    Row& south = rows[(j + 2) % 3];
    south.fill(terrain, sheet, std::int64_t{j} + 1, -1, across);
    for (std::size_t i = 0; i < sheet.columns; ++i)
      normal[i] = normalOf(here.height[i], here.height[i + 2], north.height[i + 1], south.height[i + 1], metres(2 * sheet.pitchX),
                           metres(2 * sheet.pitchZ));
    colours(&here.x[1], &here.z[1], &here.height[1], normal.data(), metres(std::max(sheet.pitchX, sheet.pitchZ)), colour.data(),
            colour.size(), terrain.seed());
    for (const Float3& c : colour)
      for (const float channel : c) out.push_back(srgb(channel));
  }
  return out;
}

}  // namespace ridgecast::map
