#include "server/encoding/encoder.h"

#include <span>
#include <utility>

#include "common/codec/codec.h"
#include "common/outcome/contract.h"
#include "common/terrain/shades.h"
#include "server/query/query.h"

namespace ridgecast::encoding {

namespace {

std::vector<std::uint8_t> bytesOf(std::span<const terrain::Shade> shades) {
  std::vector<std::uint8_t> out;
  out.reserve(shades.size() * terrain::kShadeBytes);
  for (const terrain::Shade& s : shades)
    out.insert(out.end(), {static_cast<std::uint8_t>(s.normalX), static_cast<std::uint8_t>(s.normalZ), s.red, s.green, s.blue});
  return out;
}

}  // namespace

// Of all vertices, in order.
std::vector<std::uint8_t> Encoder::shadesOf(const mesh::LeafMesh& leaf) const {
  std::vector<lattice::Step> x, z;
  for (const mesh::LocalVertex& v : leaf.vertices) {
    x.push_back(leaf.address.x() + v.x);
    z.push_back(leaf.address.z() + v.z);
  }
  std::vector<terrain::Shade> shades(x.size());
  terrain::shadesAt(*terrain_, x, z, leaf.address.level, shades);
  return bytesOf(shades);
}

std::vector<std::uint8_t> Encoder::shadesOf(const HeldPoints::News& news) const {
  expects(news.points.size() == news.levels.size(), "each new point has a level");
  std::vector<terrain::Shade> shades(news.points.size());
  for (std::size_t k = 0, end = 0; k < shades.size(); k = end) {  // a level at a time
    std::vector<lattice::Step> x, z;
    for (; end < shades.size() && news.levels[end] == news.levels[k]; ++end) {
      x.push_back(news.points[end].x);
      z.push_back(news.points[end].z);
    }
    terrain::shadesAt(*terrain_, x, z, news.levels[k], std::span(shades).subspan(k, end - k));
  }
  return bytesOf(shades);
}

wire::LeafWhole Encoder::whole(const mesh::LeafMesh& leaf) const {
  return {leaf.address,
          static_cast<std::uint32_t>(leaf.vertices.size()),
          static_cast<std::uint32_t>(leaf.triangles.size()),
          codec::encodeLeaf(leaf),
          form_.errors ? query::deviation(*terrain_, leaf) : 0,
          form_.shades ? shadesOf(leaf) : std::vector<std::uint8_t>{}};
}

void Encoder::encode(replica::Changes changes, pipeline::IteratingMesh& mesh, wire::Iteration& iteration) {
  expects(form_.points || (changes.come.empty() && changes.touched.empty()), "only clients that follow points get leaves by them");
  iteration.number = changes.number;
  iteration.meshHash = changes.meshHash;
  iteration.whole.resize(changes.whole.size());
  pool_->forEach(changes.whole.size(), 2, [&](std::size_t k) { iteration.whole[k] = whole(mesh.extract(changes.whole[k])); });
  if (form_.points) {
    HeldPoints::News news;
    iteration.points = held_.update(changes, mesh, news);
    if (form_.shades) iteration.shades = shadesOf(news);
    if (form_.errors) {
      iteration.errors.resize(changes.other.size());
      pool_->forEach(changes.other.size(), 2,
                     [&](std::size_t k) { iteration.errors[k] = query::deviation(*terrain_, mesh.extract(changes.other[k])); });
    }
  }
  iteration.gone = std::move(changes.gone);
  iteration.come = std::move(changes.come);
}

}  // namespace ridgecast::encoding
