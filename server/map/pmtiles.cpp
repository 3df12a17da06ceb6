#include "server/map/pmtiles.h"

#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/outcome/contract.h"

namespace ridgecast::map {

namespace {

constexpr std::size_t kHeaderBytes = 127, kRootEnds = 16'384;

void addNumber(std::string& out, std::uint64_t v, std::size_t bytes) {
  for (std::size_t k = 0; k < bytes; ++k) out += static_cast<char>(v >> (8 * k));
}

void addVarint(std::string& out, std::uint64_t v) {
  for (; v >= 128; v >>= 7) out += static_cast<char>(v | 128);
  out += static_cast<char>(v);
}

// gzip, the one compression that all readers of directories know. Empty: there is no memory.
std::string packed(std::string_view bytes) {
  z_stream stream{};
  if (deflateInit2(&stream, Z_BEST_COMPRESSION, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY) != Z_OK) return {};
  std::string out(deflateBound(&stream, bytes.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  const bool isWhole = deflate(&stream, Z_FINISH) == Z_STREAM_END;
  out.resize(isWhole ? stream.total_out : 0);
  deflateEnd(&stream);
  return out;
}

}  // namespace

std::uint64_t tileId(const TileAddress& tile) {
  expects(tile.isValid(), "a map tile is one of its level's");
  std::uint64_t id = 0, x = tile.x, y = tile.y;
  for (int level = 0; level < tile.level; ++level) id += std::uint64_t{1} << (2 * level);
  for (std::uint64_t side = std::uint64_t{1} << tile.level >> 1; side > 0; side >>= 1) {
    const bool right = x & side, below = y & side;
    id += side * side * ((right ? 3 : 0) ^ (below ? 1 : 0));
    x &= side - 1;
    y &= side - 1;
    if (below) continue;
    if (right) x = side - 1 - x, y = side - 1 - y;
    std::swap(x, y);
  }
  return id;
}

Archive::Archive(const std::filesystem::path& file) : out_(file, std::ios::binary) { out_ << std::string(kRootEnds, '\0'); }

bool Archive::add(std::uint64_t id, std::string_view tile) {
  expects(entries_.empty() || id >= entries_.back().id + entries_.back().run, "tiles come in the order of the archive");
  expects(!tile.empty() && tile.size() <= std::numeric_limits<std::uint32_t>::max(), "a tile's length is a number of 32 bits, and not 0");
  ++addressed_;
  if (!entries_.empty() && tile == last_) {
    const Entry& before = entries_.back();
    if (id == before.id + before.run)
      ++entries_.back().run;
    else
      entries_.push_back({id, before.offset, before.length, 1});
    return static_cast<bool>(out_);
  }
  entries_.push_back({id, written_, static_cast<std::uint32_t>(tile.size()), 1});
  written_ += tile.size();
  last_ = tile;
  return static_cast<bool>(out_ << tile);
}

std::string Archive::directory(const Entry* entries, std::size_t count) {
  std::string out;
  addVarint(out, count);
  for (std::size_t k = 0; k < count; ++k) addVarint(out, entries[k].id - (k > 0 ? entries[k - 1].id : 0));
  for (std::size_t k = 0; k < count; ++k) addVarint(out, entries[k].run);
  for (std::size_t k = 0; k < count; ++k) addVarint(out, entries[k].length);
  for (std::size_t k = 0; k < count; ++k) {
    const bool follows = k > 0 && entries[k].offset == entries[k - 1].offset + entries[k - 1].length;
    addVarint(out, follows ? 0 : entries[k].offset + 1);
  }
  return packed(out);
}

bool Archive::finish(const About& about) {
  expects(0 <= about.coarsest && about.coarsest <= about.finest && about.finest <= kFinestTileLevel, "levels run from coarse to fine");
  std::string root = directory(entries_.data(), entries_.size()), leaves;
  for (std::size_t most = 4096; kHeaderBytes + root.size() > kRootEnds; most *= 2) {
    std::vector<Entry> all;
    leaves.clear();
    for (std::size_t first = 0; first < entries_.size(); first += most) {
      const std::string leaf = directory(&entries_[first], std::min(most, entries_.size() - first));
      all.push_back({entries_[first].id, leaves.size(), static_cast<std::uint32_t>(leaf.size()), 0});
      leaves += leaf;
    }
    root = directory(all.data(), all.size());
    expects(all.size() > 1 || kHeaderBytes + root.size() <= kRootEnds, "a directory of one entry fits in front of the tiles");
  }
  std::uint64_t contents = 0, end = 0;  // of the tiles that were written
  for (const Entry& e : entries_)
    if (e.offset + e.length > end) ++contents, end = e.offset + e.length;
  const std::string metadata = packed(about.metadata);

  const auto inE7 = [](double degrees) { return static_cast<std::uint32_t>(static_cast<std::int32_t>(std::lround(degrees * 1e7))); };
  std::string header = "PMTiles\x03";
  const std::uint64_t leavesAt = kRootEnds + written_, metadataAt = leavesAt + leaves.size();
  for (const std::uint64_t v :
       {std::uint64_t{kHeaderBytes}, std::uint64_t{root.size()}, metadataAt, std::uint64_t{metadata.size()}, leavesAt,
        std::uint64_t{leaves.size()}, std::uint64_t{kRootEnds}, written_, addressed_, std::uint64_t{entries_.size()}, contents})
    addNumber(header, v, 8);
  constexpr std::uint8_t kIsClustered = 1, kGzip = 2, kAsItIs = 1;
  for (const int v : {int{kIsClustered}, int{kGzip}, int{kAsItIs}, static_cast<int>(about.type), about.coarsest, about.finest})
    header += static_cast<char>(v);
  const auto [west, south, east, north] = about.bounds;
  for (const double v : {west, south, east, north}) addNumber(header, inE7(v), 4);
  header += static_cast<char>(about.finest);
  for (const double v : {(west + east) / 2, (south + north) / 2}) addNumber(header, inE7(v), 4);
  expects(header.size() == kHeaderBytes, "a header has its length");

  out_ << leaves << metadata;
  out_.seekp(0) << header << root;
  return !root.empty() && !metadata.empty() && out_.flush();
}

}  // namespace ridgecast::map
