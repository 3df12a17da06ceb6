#include "server/query/query.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "common/ground/ground.h"
#include "common/outcome/contract.h"

namespace ridgecast::query {

Answering::Answering(std::shared_ptr<const terrain::Terrain> terrain, wire::Query query, std::uint64_t edit)
    : terrain_(std::move(terrain)), query_(std::move(query)) {
  answer_.id = query_.id;
  answer_.refusal = query_.refusal;
  answer_.edit = edit;
  if (!answer_.refusal.empty()) return;
  size_ = query_.kind == wire::QueryKind::kRays ? query_.rays.size() : query_.x.size();
  if (query_.kind == wire::QueryKind::kHeights) answer_.heights.resize(size_);
  if (query_.kind == wire::QueryKind::kNormals) answer_.normals.resize(3 * size_);
  if (query_.kind == wire::QueryKind::kRays) answer_.distances.resize(size_);
  if (query_.kind == wire::QueryKind::kMaterials) answer_.materials.resize(size_);
}

std::uint64_t Answering::work() {
  constexpr std::size_t kPlaces = 1024, kRays = 16;  // rays over known ground; over other ground each takes as long
  const std::size_t begin = done_;
  expects(begin < size_, "some of the answer is left");
  if (query_.kind == wire::QueryKind::kRays) {
    std::uint64_t heights = 0;
    done_ = std::min(begin + (terrain_->relief().known == terrain::Relief::Known::kSampled ? 1 : kRays), size_);
    ground::cast(*terrain_, std::span(query_.rays).subspan(begin, done_ - begin),
                 std::span(answer_.distances).subspan(begin, done_ - begin), &heights);
    return heights;
  }
  const std::size_t count = std::min(kPlaces, size_ - begin);
  done_ += count;
  const auto x = std::span(query_.x).subspan(begin, count), z = std::span(query_.z).subspan(begin, count);
  if (query_.kind == wire::QueryKind::kHeights) {
    terrain_->heights(x, z, std::span(answer_.heights).subspan(begin, count));
    return count;
  }
  if (query_.kind == wire::QueryKind::kMaterials) {
    terrain_->materials(x, z, std::span(answer_.materials).subspan(begin, count));
    return 5 * count;  // of formulas: by heights and normals
  }
  terrain::normals(*terrain_, x, z, query_.spacing, std::span(answer_.normals).subspan(3 * begin, 3 * count));
  return 4 * count;
}

namespace {

// Compares heights of triangles with the terrain's, a block at a time.
class Comparison {
 public:
  explicit Comparison(const terrain::Terrain& terrain) : terrain_(terrain) {}

  // `follows`: a neighbour on the grid of the previous one.
  void add(lattice::Step x, lattice::Step z, double height, bool follows) {
    x_[count_] = x;
    z_[count_] = z;
    height_[count_] = height;
    follows_[count_] = follows;
    if (++count_ == x_.size()) flush();
  }
  double bound() {
    flush();
    return most_ + jump_ / 2;
  }

 private:
  void flush() {
    terrain_.heights(std::span(x_).first(count_), std::span(z_).first(count_), std::span(true_).first(count_));
    for (std::size_t k = 0; k < count_; ++k) {
      const double off = true_[k] - height_[k];
      most_ = std::max(most_, std::abs(off));
      if (follows_[k]) jump_ = std::max(jump_, std::abs(off - last_));
      last_ = off;
    }
    count_ = 0;
  }

  static constexpr std::size_t kBlock = 256;
  const terrain::Terrain& terrain_;
  std::array<lattice::Step, kBlock> x_, z_;
  std::array<double, kBlock> height_;
  std::array<bool, kBlock> follows_;
  std::array<float, kBlock> true_;
  std::size_t count_ = 0;
  double most_ = 0, jump_ = 0, last_ = 0;
};

std::int64_t ceilTo(std::int64_t v, std::int64_t spacing) { return (v + spacing - 1) & ~(spacing - 1); }

}  // namespace

float deviation(const terrain::Terrain& terrain, const mesh::LeafMesh& leaf) {
  if (leaf.triangles.empty()) return 0;
  const std::int64_t spacing = std::max<std::int64_t>(32, leaf.address.side() >> 6);  // a power of two
  const lattice::Step cornerX = leaf.address.x(), cornerZ = leaf.address.z();
  Comparison comparison(terrain);
  for (const mesh::LocalVertex& v : leaf.vertices) comparison.add(cornerX + v.x, cornerZ + v.z, v.y * lattice::kMetresPerStep, false);
  for (const mesh::Triangle& t : leaf.triangles) {
    const mesh::LocalVertex &a = leaf.vertices[t[0]], &b = leaf.vertices[t[1]], &c = leaf.vertices[t[2]];
    const auto side = [](const mesh::LocalVertex& p, const mesh::LocalVertex& q, std::int64_t x, std::int64_t z) {
      return (std::int64_t{q.z} - p.z) * (x - p.x) - (std::int64_t{q.x} - p.x) * (z - p.z);
    };
    const double area = static_cast<double>(side(a, b, c.x, c.z));
    const auto heightAt = [&](std::int64_t x, std::int64_t z) {
      const double wa = static_cast<double>(side(b, c, x, z)), wb = static_cast<double>(side(c, a, x, z)),
                   wc = static_cast<double>(side(a, b, x, z));
      return (wa * a.y + wb * b.y + wc * c.y) / area * lattice::kMetresPerStep;
    };
    const std::int64_t middleX = (std::int64_t{a.x} + b.x + c.x) / 3, middleZ = (std::int64_t{a.z} + b.z + c.z) / 3;
    comparison.add(cornerX + middleX, cornerZ + middleZ, heightAt(middleX, middleZ), false);
    const std::int64_t lowX = std::min({a.x, b.x, c.x}), highX = std::max({a.x, b.x, c.x});
    const std::int64_t lowZ = std::min({a.z, b.z, c.z}), highZ = std::max({a.z, b.z, c.z});
    for (std::int64_t z = ceilTo(lowZ, spacing); z <= highZ; z += spacing) {
      bool follows = false;
      for (std::int64_t x = ceilTo(lowX, spacing); x <= highX; x += spacing) {
        const bool inside = side(a, b, x, z) >= 0 && side(b, c, x, z) >= 0 && side(c, a, x, z) >= 0;
        if (inside) comparison.add(cornerX + x, cornerZ + z, heightAt(x, z), follows);
        if (follows && !inside) break;
        follows = inside;
      }
    }
  }
  return std::nextafter(static_cast<float>(comparison.bound()), 1e9f);
}

}  // namespace ridgecast::query
