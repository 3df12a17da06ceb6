// Rows of samples and tiles as bytes.
#include "common/outcome/contract.h"
#include "common/terrain/raster.h"

namespace ridgecast::terrain {
namespace {

constexpr const char* kWholeRows = "samples are whole rows";

std::int64_t guess(std::span<const std::int32_t> samples, std::size_t columns, std::size_t k) {
  if (k == 0) return 0;
  if (k % columns == 0) return samples[k - columns];
  if (k < columns) return samples[k - 1];
  return std::int64_t{samples[k - 1]} + samples[k - columns] - samples[k - columns - 1];
}

}  // namespace

void encodeSamples(std::span<const std::int32_t> samples, std::size_t columns, std::vector<std::uint8_t>& out) {
  expects(samples.empty() || (columns > 0 && samples.size() % columns == 0), kWholeRows);
  const auto put = [&out](std::uint64_t v) {
    for (; v >= 0x80; v >>= 7) out.push_back(static_cast<std::uint8_t>(v | 0x80));
    out.push_back(static_cast<std::uint8_t>(v));
  };
  std::uint64_t zeros = 0;
  const auto flush = [&] {
    if (zeros == 0) return;
    put(0);
    put(zeros - 1);
    zeros = 0;
  };
  for (std::size_t k = 0; k < samples.size(); ++k) {
    const std::int64_t d = samples[k] - guess(samples, columns, k);
    if (d == 0) {
      ++zeros;
      continue;
    }
    flush();
    put((static_cast<std::uint64_t>(d) << 1) ^ static_cast<std::uint64_t>(d >> 63));
  }
  flush();
}

Outcome<void> decodeSamples(std::span<const std::uint8_t> bytes, std::size_t columns, std::span<std::int32_t> out) {
  expects(out.empty() || (columns > 0 && out.size() % columns == 0), kWholeRows);
  std::size_t at = 0;
  const auto get = [&](std::uint64_t& v) {
    v = 0;
    for (int shift = 0; shift < 35; shift += 7) {
      if (at >= bytes.size()) return false;
      const std::uint8_t b = bytes[at++];
      v |= std::uint64_t{b & 0x7fu} << shift;
      if (b < 0x80) return true;
    }
    return false;
  };
  std::uint64_t zeros = 0;
  for (std::size_t k = 0; k < out.size(); ++k) {
    std::int64_t d = 0;
    if (zeros > 0) {
      --zeros;
    } else {
      std::uint64_t v = 0;
      if (!get(v)) return Error{"a tile of heights is cut off"};
      if (v == 0 && !get(zeros)) return Error{"a tile of heights is cut off"};
      d = static_cast<std::int64_t>(v >> 1) ^ -static_cast<std::int64_t>(v & 1);
    }
    const std::int64_t h = guess(out, columns, k) + d;
    if (h < -kMaxSample || h > kMaxSample) return Error{"a tile of heights has one beyond 32,768 m"};
    out[k] = static_cast<std::int32_t>(h);
  }
  if (zeros != 0 || at != bytes.size()) return Error{"a tile of heights is longer than a tile"};
  return {};
}

std::vector<std::uint8_t> encodeTile(const Tile& tile) {
  std::vector<std::uint8_t> out{0x30};
  out.reserve(kTileSamples * 2);
  encodeSamples(tile, kTileSide, out);
  return out;
}

Outcome<Tile> decodeTile(std::span<const std::uint8_t> bytes) {
  if (bytes.empty() || bytes[0] != 0x30) return Error{"a tile of heights has a form that is not known"};
  Tile tile;
  if (auto decoded = decodeSamples(bytes.subspan(1), kTileSide, tile); !decoded) return decoded.error();
  return tile;
}

}  // namespace ridgecast::terrain
