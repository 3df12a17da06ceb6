#include "server/map/pmtiles.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <cstdlib>
#include <iterator>
#include <map>
#include <random>
#include <set>

namespace ridgecast::map {
namespace {

// Of the format's specification, and what a Hilbert curve is: every tile once, and each beside the one before.
TEST(PmTiles, TilesAreInHilbertsOrder) {
  for (const auto& [id, tile] : std::vector<std::pair<std::uint64_t, TileAddress>>{
           {0, {0, 0, 0}}, {1, {1, 0, 0}}, {2, {1, 0, 1}}, {3, {1, 1, 1}}, {4, {1, 1, 0}}, {5, {2, 0, 0}}, {19078479, {12, 3423, 1763}}})
    EXPECT_EQ(tileId(tile), id);
  std::map<std::uint64_t, TileAddress> all;
  for (std::uint32_t x = 0; x < 64; ++x)
    for (std::uint32_t y = 0; y < 64; ++y) all.emplace(tileId({6, x, y}), TileAddress{6, x, y});
  EXPECT_EQ(all.size(), 64u * 64);
  EXPECT_EQ(all.rbegin()->first - all.begin()->first, 64u * 64 - 1);
  for (auto at = std::next(all.begin()); at != all.end(); ++at) {
    const TileAddress &a = at->second, &b = std::prev(at)->second;
    EXPECT_EQ(std::abs(int(a.x) - int(b.x)) + std::abs(int(a.y) - int(b.y)), 1);
  }
}

std::string unpacked(std::string_view bytes) {
  z_stream stream{};
  EXPECT_EQ(inflateInit2(&stream, 15 + 16), Z_OK);
  std::string out(std::size_t{1} << 20, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  EXPECT_EQ(inflate(&stream, Z_FINISH), Z_STREAM_END);
  out.resize(stream.total_out);
  inflateEnd(&stream);
  return out;
}

struct Reader {
  std::string bytes;
  std::uint64_t number(std::size_t at) const {
    std::uint64_t v = 0;
    for (std::size_t k = 8; k-- > 0;) v = v << 8 | static_cast<std::uint8_t>(bytes[at + k]);
    return v;
  }
  std::string_view part(std::size_t at) const { return std::string_view(bytes).substr(number(at), number(at + 8)); }

  // Tiles by their ids.
  void directory(std::string_view packed, std::map<std::uint64_t, std::string>& out) const {
    const std::string plain = unpacked(packed);
    std::size_t at = 0;
    const auto next = [&] {
      std::uint64_t v = 0;
      for (int shift = 0;; shift += 7) {
        const auto byte = static_cast<std::uint8_t>(plain.at(at++));
        v |= std::uint64_t{byte & 127u} << shift;
        if (byte < 128) return v;
      }
    };
    std::vector<std::array<std::uint64_t, 4>> entries(next());  // id, run, length, offset
    std::uint64_t id = 0;
    for (auto& e : entries) e[0] = id += next();
    for (auto& e : entries) e[1] = next();
    for (auto& e : entries) e[2] = next();
    for (std::size_t k = 0; k < entries.size(); ++k) {
      const std::uint64_t offset = next();
      entries[k][3] = offset > 0 ? offset - 1 : entries[k - 1][3] + entries[k - 1][2];
    }
    EXPECT_EQ(at, plain.size());
    for (const auto& [first, run, length, offset] : entries) {
      if (run == 0) directory(std::string_view(bytes).substr(number(40) + offset, length), out);
      for (std::uint64_t k = 0; k < run; ++k) EXPECT_TRUE(out.emplace(first + k, bytes.substr(number(56) + offset, length)).second);
    }
  }
};

TEST(PmTiles, ManyTilesComeBackThroughLeafDirectories) {
  std::mt19937 random(4);
  for (const std::size_t count : {1, 300, 60'000}) {
    const std::string file = testing::TempDir() + "ridgecast-pmtiles-" + std::to_string(count);
    std::map<std::uint64_t, std::string> tiles;
    std::size_t runs = 0, contents = 0;
    {
      Archive archive(file);
      std::uint64_t id = 0;
      std::string tile;
      for (std::size_t k = 0; k < count; ++k) {
        const std::uint64_t step = 1 + (random() % 3 == 0 ? random() % 1000 : 0);
        const bool again = k > 0 && random() % 4 == 0;
        if (!again) tile = std::to_string(random()) + std::string(random() % 9, 'x'), ++contents;
        runs += !(again && step == 1);
        tiles.emplace(id += step, tile);
        EXPECT_TRUE(archive.add(id, tile));
      }
      EXPECT_TRUE(archive.finish({Archive::Type::kJpeg, 0, 13, {-3.5, -2, 7, 85.05}, R"({"name": "x"})"}));
    }
    std::ifstream in(file, std::ios::binary);
    const Reader reader{{std::istreambuf_iterator<char>(in), {}}};
    std::filesystem::remove(file);
    EXPECT_EQ(reader.bytes.substr(0, 8), "PMTiles\x03");
    EXPECT_EQ(reader.number(8), 127u);
    EXPECT_LE(reader.number(8) + reader.number(16), 16'384u);
    EXPECT_EQ(reader.number(48) > 0, count > 10'000) << "leaf directories";
    EXPECT_EQ(unpacked(reader.part(24)), R"({"name": "x"})");
    EXPECT_EQ(reader.number(72), count);
    EXPECT_EQ(reader.number(80), runs);
    EXPECT_EQ(reader.number(88), contents);
    EXPECT_EQ(reader.bytes.substr(96, 6), std::string("\x01\x02\x01\x03\x00\x0d", 6));
    EXPECT_EQ(static_cast<std::int32_t>(reader.number(102)), -35'000'000);
    EXPECT_EQ(static_cast<std::int32_t>(reader.number(114)), 850'500'000);
    std::map<std::uint64_t, std::string> read;
    reader.directory(reader.part(8), read);
    EXPECT_EQ(read, tiles);
  }
}

TEST(PmTiles, AFullDiskIsNoticed) {
  Archive archive("/dev/full");
  bool isWritten = true;
  for (std::uint64_t id = 1; id < 3000 && isWritten; ++id) isWritten = archive.add(id, std::to_string(id) + std::string(100, 'x'));
  EXPECT_FALSE(isWritten && archive.finish({}));
}

}  // namespace
}  // namespace ridgecast::map
