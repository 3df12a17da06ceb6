#include "server/edit_log/tiles.h"

#include <bit>
#include <cstring>

#include "common/codec/varint.h"
#include "common/lattice/lattice.h"

namespace ridgecast::edit_log {
namespace {

constexpr std::size_t kSide = edits::kTileSide, kPosts = kSide * kSide;

std::int64_t guess(const std::array<std::int32_t, kPosts>& rise, std::size_t k) {
  if (k < kSide) return k == 0 ? 0 : rise[k - 1];
  if (k % kSide == 0) return rise[k - kSide];
  return std::int64_t{rise[k - 1]} + rise[k - kSide] - rise[k - kSide - 1];
}

}  // namespace

void encodeTile(const edits::TilePosts& tile, std::vector<std::uint8_t>& out) {
  out.clear();
  std::uint64_t zeros = 0;
  const auto flush = [&] {
    if (zeros == 0) return;
    codec::putVarint(out, 0);
    codec::putVarint(out, zeros - 1);
    zeros = 0;
  };
  const auto put = [&](std::int64_t difference) {
    if (difference == 0) {
      ++zeros;
      return;
    }
    flush();
    codec::putVarint(out, codec::zigzag(difference));
  };
  for (std::size_t k = 0; k < kPosts; ++k) put(tile.rise[k] - guess(tile.rise, k));
  for (std::size_t k = 0; k < kPosts; ++k) put(tile.material[k] - (k == 0 ? 0 : tile.material[k - 1]));
  flush();
}

std::shared_ptr<const edits::Tile> decodeTile(std::span<const std::uint8_t> bytes) {
  codec::Reader in(bytes);
  std::uint64_t zeros = 0;
  bool isWhole = true;
  const auto get = [&]() -> std::int64_t {
    if (zeros > 0) return --zeros, 0;
    std::uint64_t v = 0;
    isWhole = isWhole && in.varint(v);
    if (isWhole && v == 0) isWhole = in.varint(zeros);
    return codec::unzigzag(v);
  };
  edits::TilePosts tile;
  for (std::size_t k = 0; k < kPosts && isWhole; ++k) {
    const std::int64_t rise = guess(tile.rise, k) + get();
    isWhole = isWhole && rise >= -edits::kMaxRise && rise <= edits::kMaxRise;
    tile.rise[k] = static_cast<std::int32_t>(rise);
  }
  for (std::size_t k = 0; k < kPosts && isWhole; ++k) {
    const std::int64_t material = (k == 0 ? 0 : tile.material[k - 1]) + get();
    isWhole = isWhole && material >= 0 && material <= std::int64_t{edits::kMaterials};
    tile.material[k] = static_cast<std::uint8_t>(material);
  }
  return isWhole && zeros == 0 && in.rest().empty() ? std::make_shared<const edits::Tile>(tile) : nullptr;
}

std::uint64_t hashOfBytes(std::span<const std::uint8_t> bytes, std::uint64_t start) {
  static_assert(std::endian::native == std::endian::little);
  std::uint64_t hash = lattice::mix(start ^ bytes.size());
  for (; !bytes.empty(); bytes = bytes.subspan(std::min<std::size_t>(8, bytes.size()))) {
    std::uint64_t word = 0;
    std::memcpy(&word, bytes.data(), std::min<std::size_t>(8, bytes.size()));
    hash = lattice::mix(hash ^ word);
  }
  return hash;
}

std::uint64_t hashOf(edits::TileAddress address, std::span<const std::uint8_t> bytes) {
  return hashOfBytes(bytes, lattice::mix(static_cast<std::uint64_t>(address.i) + lattice::mix(static_cast<std::uint64_t>(address.j))));
}

}  // namespace ridgecast::edit_log
