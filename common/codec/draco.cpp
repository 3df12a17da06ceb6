#include "common/codec/draco.h"

#include <algorithm>
#include <cstring>
#include <memory>

#include <draco/attributes/point_attribute.h>
#include <draco/compression/config/compression_shared.h>
#include <draco/compression/config/decoder_options.h>
#include <draco/compression/expert_encode.h>
#include <draco/compression/mesh/mesh_edgebreaker_decoder.h>
#include <draco/core/decoder_buffer.h>
#include <draco/core/encoder_buffer.h>
#include <draco/mesh/mesh.h>

#include "common/codec/varint.h"

namespace ridgecast::codec {
namespace {

// 7 is the slowest speed that still predicts by parallelogram. 8 and faster lose half of the gain; slower ones save less than 2 %.
constexpr int kSpeed = 7;

// The only attribute: one, POSITION, its type, three components, not normalised, id 0, coded as integers.
constexpr std::uint8_t kInteger32 = 5;  // draco::DT_INT32
constexpr std::array<std::uint8_t, 7> kAttribute{1, 0, kInteger32, 3, 0, 0, 1};
// Draco never codes larger symbols as one symbol (draco/compression/entropy/symbol_encoding.cc).
constexpr std::uint64_t kMaxSymbols = (1u << 18) + 1;

// Draco's decoder, with checks before it believes a count. It sizes its tables by triangles (checked before it starts), by attributes and
// components, and by entropy symbols. The last two are checked here, just before the attribute's description is read.
class CarefulDecoder : public draco::MeshEdgebreakerDecoder {
 protected:
  bool CreateAttributesDecoder(std::int32_t id) override {
    return id == 0 && draco::MeshEdgebreakerDecoder::CreateAttributesDecoder(id) && descriptionIsOurs();
  }

 private:
  bool descriptionIsOurs() {
    const std::span<const std::uint8_t> next(reinterpret_cast<const std::uint8_t*>(buffer()->data_head()),
                                             static_cast<std::size_t>(std::max<std::int64_t>(0, buffer()->remaining_size())));
    if (next.size() < kAttribute.size() || !std::equal(kAttribute.begin(), kAttribute.end(), next.begin())) return false;
    Reader reader(next.subspan(kAttribute.size()));
    std::uint8_t prediction = 0, transform = 0, compressed = 0, scheme = 0, bits = 0;
    std::uint64_t symbols = 0;
    if (!reader.byte(prediction) || (prediction != 0xfe && !reader.byte(transform)) || !reader.byte(compressed)) return false;
    if (compressed == 0) return true;  // plain bytes: Draco checks them against the rest of the buffer
    if (!reader.byte(scheme) || (scheme == draco::SYMBOL_CODING_RAW && !reader.byte(bits))) return false;
    return reader.varint(symbols) && symbols <= kMaxSymbols;
  }
};

std::unique_ptr<draco::Mesh> toDraco(std::span<const std::array<std::uint32_t, 3>> points, std::span<const mesh::Triangle> triangles) {
  auto out = std::make_unique<draco::Mesh>();
  out->set_num_points(static_cast<std::uint32_t>(points.size()));
  draco::GeometryAttribute description;
  description.Init(draco::GeometryAttribute::POSITION, nullptr, 3, draco::DT_INT32, false, 3 * sizeof(std::int32_t), 0);
  const int id = out->AddAttribute(description, true, static_cast<std::uint32_t>(points.size()));
  // Every value is at most kMaxDracoValue, so the signed attribute holds the same bytes.
  out->attribute(id)->buffer()->Write(0, points.data(), points.size_bytes());
  out->SetNumFaces(triangles.size());
  for (std::size_t k = 0; k < triangles.size(); ++k) {
    const mesh::Triangle& t = triangles[k];
    out->SetFace(draco::FaceIndex(static_cast<std::uint32_t>(k)),
                 {draco::PointIndex(t[0]), draco::PointIndex(t[1]), draco::PointIndex(t[2])});
  }
  return out;
}

}  // namespace

bool encodeEdgebreaker(std::span<const std::array<std::uint32_t, 3>> points, std::span<const mesh::Triangle> triangles,
                       std::vector<std::uint8_t>& out) {
  const std::unique_ptr<draco::Mesh> mesh = toDraco(points, triangles);
  draco::ExpertEncoder encoder(*mesh);
  encoder.SetSpeedOptions(kSpeed, kSpeed);
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  encoder.SetEncodingSubmethod(draco::MESH_EDGEBREAKER_STANDARD_ENCODING);
  draco::EncoderBuffer buffer;
  if (!encoder.EncodeToBuffer(&buffer).ok()) return false;
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(buffer.data());
  out.insert(out.end(), bytes, bytes + buffer.size());
  return true;
}

std::string decodeDraco(std::span<const std::uint8_t> bytes, std::uint32_t triangles, Soup& out) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  draco::Mesh mesh;
  const draco::DecoderOptions options;
  CarefulDecoder decoder;
  if (!decoder.Decode(options, &buffer, &mesh).ok()) return "its Draco stream is damaged";
  if (buffer.remaining_size() != 0) return "its Draco stream has bytes after its end";
  if (mesh.num_faces() != triangles || mesh.num_points() > 3 * std::uint64_t{triangles} || mesh.num_attributes() != 1)
    return "its Draco stream does not have the announced counts";

  const draco::PointAttribute& position = *mesh.attribute(0);
  out.points.resize(mesh.num_points());
  for (std::uint32_t p = 0; p < mesh.num_points(); ++p) {
    const draco::AttributeValueIndex at = position.mapped_index(draco::PointIndex(p));
    if (at.value() >= position.size()) return "its Draco stream is damaged";
    position.GetValue(at, out.points[p].data());
  }
  out.triangles.resize(triangles);
  for (std::uint32_t k = 0; k < triangles; ++k) {
    const draco::Mesh::Face& face = mesh.face(draco::FaceIndex(k));
    for (std::size_t c = 0; c < 3; ++c) out.triangles[k][c] = face[c].value();
  }
  return {};
}

}  // namespace ridgecast::codec
