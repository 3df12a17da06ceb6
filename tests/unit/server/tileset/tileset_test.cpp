// The laws of a tileset, over all built-in terrains and far from the origin.
#include "server/tileset/tileset.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <proj.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "server/earth/earth.h"
#include "server/tileset/tile.h"

namespace ridgecast::tileset {
namespace {

using lattice::LeafAddress;
using lattice::metres;
using Json = nlohmann::json;

constexpr double kDegree = std::numbers::pi / 180;

// An axis-parallel box of a tile in the root's axes: metres, x east, y north, z up.
struct Box {
  double low[3], high[3];
  bool contains(const Box& other, double tolerance = 1e-6) const {
    for (int k = 0; k < 3; ++k)
      if (other.low[k] < low[k] - tolerance || other.high[k] > high[k] + tolerance) return false;
    return true;
  }
  double area() const { return (high[0] - low[0]) * (high[1] - low[1]); }
};

struct Place3 {
  double x = 0, y = 0, z = 0;
};

Place3 moved(const Json& tile, Place3 by) {
  if (const auto t = tile.find("transform"); t != tile.end()) return {by.x + (*t)[12].get<double>(), by.y + (*t)[13].get<double>(), by.z};
  return by;
}

Box boxOf(const Json& tile, Place3 by) {
  const auto b = tile["boundingVolume"]["box"].get<std::vector<double>>();
  EXPECT_EQ(b.size(), 12u);
  for (int k = 3; k < 12; ++k) EXPECT_TRUE(k % 4 == 3 || b[static_cast<std::size_t>(k)] == 0);
  const double c[3] = {b[0] + by.x, b[1] + by.y, b[2] + by.z}, half[3] = {b[3], b[7], b[11]};
  Box out;
  for (int k = 0; k < 3; ++k) {
    EXPECT_GT(half[k], 0);
    out.low[k] = c[k] - half[k];
    out.high[k] = c[k] + half[k];
  }
  return out;
}

LeafAddress squareOf(const std::string& uri) {
  std::string path = uri.substr(0, uri.find('?'));
  while (path.starts_with("../")) path.erase(0, 3);
  std::istringstream in(path);
  LeafAddress out;
  char slash;
  in >> out.level >> slash >> out.i >> slash >> out.j;
  return out;
}

// A tile and what is below it in this tileset.
void check(const Json& tile, const Json* parent, const Box* around, Place3 by, const std::string& query, std::vector<LeafAddress>& refers,
           std::set<LeafAddress>& squares) {
  by = moved(tile, by);
  const Box box = boxOf(tile, by);
  if (parent) {
    EXPECT_LT(tile["geometricError"].get<double>(), (*parent)["geometricError"].get<double>());
    EXPECT_TRUE(around->contains(box)) << tile["content"];
  }
  if (tile.contains("content")) {
    const std::string uri = tile["content"]["uri"];
    EXPECT_EQ(uri.substr(uri.find('?') + 1), query);
    const LeafAddress square = squareOf(uri);
    EXPECT_TRUE(isTile(square)) << uri;
    EXPECT_EQ(tile["geometricError"], errorOf(square.level));
    EXPECT_TRUE(squares.insert(square).second) << uri;
    if (uri.find(".json") != std::string::npos) {
      refers.push_back(square);
      EXPECT_FALSE(tile.contains("children"));
    }
  }
  if (!tile.contains("children")) return;
  double area = 0;
  for (const Json& child : tile["children"]) {
    check(child, &tile, &box, by, query, refers, squares);
    area += boxOf(child, moved(child, by)).area();
  }
  EXPECT_NEAR(area / box.area(), 1, 1e-9);  // inside, and no two the same: they cover it
}

std::shared_ptr<const terrain::Terrain> alpine() { return terrain::create("alpine", 3).value(); }

TEST(Tileset, KeepsTheLawsDownToTheFinestTiles) {
  std::mt19937 random(1);
  for (const terrain::Description& description : terrain::builtIn()) {
    const auto terrain = terrain::create(description.name, 7).value();
    for (const lattice::Step far : {lattice::Step{0}, lattice::Step{256'000'000'000}, lattice::Step{-1'024'000'000'000'001}}) {
      Question question;
      question.middle = {far, -far / 3};
      Json set = Json::parse(rootTileset(*terrain, question, "q=1"));
      std::vector<LeafAddress> refers;
      std::set<LeafAddress> squares;
      EXPECT_EQ(set["asset"]["version"], "1.1");
      check(set["root"], nullptr, nullptr, {}, "q=1", refers, squares);
      const Box all = boxOf(set["root"], {});
      for (int k = 0; k < 2; ++k) {
        EXPECT_LE(all.low[k], -200'000);
        EXPECT_GE(all.high[k], 200'000);
      }
      const Json* tile = nullptr;
      while (!refers.empty()) {
        const LeafAddress next = refers[random() % refers.size()];
        std::vector<const Json*> open{&set["root"]};
        for (tile = nullptr; !open.empty() && !tile;) {
          const Json* at = open.back();
          open.pop_back();
          if (at->contains("content") && squareOf((*at)["content"]["uri"]) == next) tile = at;
          if (at->contains("children"))
            for (const Json& child : (*at)["children"]) open.push_back(&child);
        }
        ASSERT_TRUE(tile);
        Json below = Json::parse(tilesetOf(*terrain, {}, next, "q=1"));
        EXPECT_TRUE(boxOf(*tile, {}).contains(boxOf(below["root"], {})))
            << description.name << " " << next.level << (*tile).dump() << below["root"]["boundingVolume"];
        EXPECT_EQ(below["root"]["geometricError"], (*tile)["geometricError"]);
        EXPECT_EQ(below["root"]["refine"], "REPLACE");
        refers.clear();
        squares.clear();
        check(below["root"], nullptr, nullptr, {}, "q=1", refers, squares);
        set = std::move(below);
      }
      EXPECT_EQ(squares.begin()->level, 0);
    }
  }
}

// Each tile lies in its box, keeps its error, has its frame's place, and shares sides with its neighbour.
TEST(Tileset, TilesLieInTheirBoxesAndShareTheirSides) {
  scheduling::Executor executor(2);
  const auto pool = executor.makePool(2);
  std::mt19937_64 random(5);
  for (const terrain::Description& description : terrain::builtIn()) {
    const auto terrain = terrain::create(description.name, 7).value();
    for (int level = 0; level <= kCoarsest; ++level) {
      const auto reach = (lattice::Step{256'000'000'000} >> (lattice::kFinestSideBits + level)) + 1;  // 10^9 m
      const LeafAddress here{level, reach, -static_cast<std::int64_t>(random() % 1000)}, east{level, here.i + 1, here.j};
      const box::Watch watch{{}, std::chrono::steady_clock::now() + std::chrono::minutes(5), 300};
      const auto a = meshTile(*terrain, whole(here), 2'000'000, *pool, watch), b = meshTile(*terrain, whole(east), 2'000'000, *pool, watch);
      ASSERT_TRUE(a && b) << description.name << " " << level << ": " << (a ? b : a).error().message;
      EXPECT_LE(a->error, errorOf(level));
      const Json set = Json::parse(tilesetOf(*terrain, {}, here, ""));
      const Box box = boxOf(set["root"], {});
      const lattice::Point frame = frameOf(here);
      std::map<lattice::Step, std::int32_t> sideOfA, sideOfB;
      const auto side = static_cast<std::int32_t>(here.side());
      for (const mesh::LeafMesh* mesh : {&a->surface, &a->skirt})
        for (const mesh::LocalVertex& v : mesh->vertices) {
          const double x = static_cast<double>(here.x() + v.x - frame.x) / 256, y = -static_cast<double>(here.z() + v.z - frame.z) / 256;
          const Box point{{x, y, v.y / 256.0}, {x, y, v.y / 256.0}};
          EXPECT_TRUE(box.contains(point)) << description.name << " " << level;
          if (mesh == &a->surface && v.x == side) sideOfA[v.z] = v.y;
        }
      for (const mesh::LocalVertex& v : b->surface.vertices)
        if (v.x == 0) sideOfB[v.z] = v.y;
      EXPECT_EQ(sideOfA, sideOfB);
      EXPECT_GE(sideOfA.size(), 2u);
    }
  }
}

TEST(Tileset, SkirtsHangBelowEverySide) {
  scheduling::Executor executor(1);
  const auto pool = executor.makePool(1);
  const LeafAddress square{3, -5, 2};
  const auto tile =
      meshTile(*alpine(), whole(square), 100'000, *pool, {{}, std::chrono::steady_clock::now() + std::chrono::minutes(5), 300});
  ASSERT_TRUE(tile);
  const auto side = static_cast<std::int32_t>(square.side());
  const auto& v = tile->skirt.vertices;
  std::size_t border = 0;
  for (const mesh::LocalVertex& p : tile->surface.vertices) border += p.x == 0 || p.z == 0 || p.x == side || p.z == side;
  ASSERT_EQ(v.size(), 2 * border);
  ASSERT_EQ(tile->skirt.triangles.size(), 2 * border);
  double length = 0;
  for (std::size_t k = 0; k < v.size(); k += 2) {
    EXPECT_EQ(v[k].y - v[k + 1].y, static_cast<std::int32_t>(skirtOf(errorOf(3)) * 256));
    const mesh::LocalVertex& next = v[(k + 2) % v.size()];
    length += std::abs(next.x - v[k].x) + std::abs(next.z - v[k].z);
  }
  EXPECT_EQ(length, 4.0 * side);
  for (const mesh::Triangle& t : tile->skirt.triangles) {  // they face outwards
    const auto &a = v[t[0]], &b = v[t[1]], &c = v[t[2]];
    const double nx = double(b.y - a.y) * (c.z - a.z) - double(b.z - a.z) * (c.y - a.y);
    const double nz = double(b.x - a.x) * (c.y - a.y) - double(b.y - a.y) * (c.x - a.x);
    EXPECT_GT(nx * (a.x + b.x + c.x - 1.5 * side) + nz * (a.z + b.z + c.z - 1.5 * side), 0);
  }
}

// Ground with steps that no mesh follows.
class Cliffs final : public terrain::Terrain {
 public:
  enum Kind { kWall, kTerraces, kTowers };
  explicit Cliffs(Kind kind) : kind_(kind) {}
  std::string_view name() const override { return "cliffs"; }
  std::string_view source() const override { return ""; }
  std::uint32_t seed() const override { return 1; }
  // Its level parts, and gentle hills.
  std::pair<double, double> partsOf(double x, double z) const {
    const double hills = 8 * std::sin(x / 150) * std::cos(z / 170);
    if (kind_ == kWall) return {std::llround(std::floor((x + 1.3 * z) / 311)) % 2 == 0 ? 35 : 0, hills};
    if (kind_ == kTowers) return {std::hypot(std::remainder(x, 1000), std::remainder(z, 1000)) < 137 ? 900 : 0, hills};
    return {20 * std::floor(15 * std::sin(x / 997) * std::cos(z / 1203) + 3 * std::sin(x / 91 + z / 133)), hills};
  }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    for (std::size_t k = 0; k < out.size(); ++k) {
      const auto [level, hills] = partsOf(static_cast<double>(x[k]) / 256, static_cast<double>(z[k]) / 256);
      out[k] = static_cast<float>(level + hills);
    }
  }

 private:
  Kind kind_;
};

// The surface above a place of the square, metres.
double heightOf(const mesh::LeafMesh& mesh, double x, double z) {
  for (const mesh::Triangle& t : mesh.triangles) {
    const auto &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    const double twice = (double(b.z) - a.z) * (double(c.x) - a.x) - (double(b.x) - a.x) * (double(c.z) - a.z);
    const double wb = ((z - a.z) * (double(c.x) - a.x) - (x - a.x) * (double(c.z) - a.z)) / twice;
    const double wc = ((x - a.x) * (double(b.z) - a.z) - (z - a.z) * (double(b.x) - a.x)) / twice;
    if (wb >= 0 && wc >= 0 && wb + wc <= 1) return (a.y + wb * (double(b.y) - a.y) + wc * (double(c.y) - a.y)) / 256;
  }
  return std::numeric_limits<double>::quiet_NaN();
}

TEST(Tileset, CliffsBecomeRampsAndTheGroundBesideThemKeepsItsError) {
  scheduling::Executor executor(2);
  const auto pool = executor.makePool(2);
  std::mt19937_64 random(4);
  const box::Watch watch{{}, std::chrono::steady_clock::now() + std::chrono::minutes(20), 1200};
  const std::vector<int> levels{0, 1, 2, 4, 6};
  for (const Cliffs::Kind kind : {Cliffs::kWall, Cliffs::kTerraces, Cliffs::kTowers}) {
    const Cliffs terrain(kind);
    int ramps = 0;
    for (const int level : levels) {
      const LeafAddress square = lattice::leafAt({136 * 256, 30 * 256}, level);
      const auto tile = meshTile(terrain, whole(square), 2'000'000, *pool, watch);
      ASSERT_TRUE(tile) << kind << " " << level << ": " << tile.error().message;
      ramps += tile->ramp > 0;
      EXPECT_EQ(tile->error > errorOf(level), tile->ramp > 0);
      const auto side = static_cast<std::uint64_t>(square.side());
      int beside = 0;
      for (int k = 0; k < 300; ++k) {
        const lattice::Point at{square.x() + static_cast<lattice::Step>(random() % side),
                                square.z() + static_cast<lattice::Step>(random() % side)};
        const double x = static_cast<double>(at.x) / 256, z = static_cast<double>(at.z) / 256;
        const double off = std::abs(
            heightOf(tile->surface, static_cast<double>(at.x - square.x()), static_cast<double>(at.z - square.z())) - terrain.height(at));
        EXPECT_LE(off, std::max(tile->error, errorOf(level))) << kind << " " << level << " at " << x << ", " << z;
        bool isLevel = true;
        for (int i = -4; i <= 4; ++i)
          for (int j = -4; j <= 4; ++j)
            isLevel = isLevel && terrain.partsOf(x + i * tile->ramp / 4, z + j * tile->ramp / 4).first == terrain.partsOf(x, z).first;
        if (!isLevel) continue;
        EXPECT_LE(off, errorOf(level)) << kind << " " << level << " at " << x << ", " << z << ", beside the step";
        ++beside;
      }
      EXPECT_GT(beside, 20) << kind << " " << level;
      const Box box = boxOf(Json::parse(tilesetOf(terrain, {}, square, ""))["root"], {});
      for (const mesh::LocalVertex& v : tile->skirt.vertices) {
        EXPECT_GE(v.y / 256.0, box.low[2]) << kind << " " << level;
        EXPECT_LE(v.y / 256.0, box.high[2]) << kind << " " << level;
      }
    }
    EXPECT_GE(ramps, 3) << kind;
  }
}

TEST(Tileset, ReachDecidesWhatIsCovered) {
  for (const double reach : {kMinReach, 3'000.0, kUsualReach, kMaxReach}) {
    Question question{.middle = {12'345, -67'890}, .where = {earth::Place{}, earth::Heights::kEllipsoid}, .reach = reach};
    const Json set = Json::parse(rootTileset(*alpine(), question, ""));
    const Box box = boxOf(set["root"], {});
    for (int k = 0; k < 2; ++k) {
      EXPECT_LE(box.low[k], -reach);
      EXPECT_GE(box.high[k], reach);
      EXPECT_LE(box.high[k] - box.low[k], 4 * reach);
    }
    const auto wanted = earth::eastNorthUp({});
    for (std::size_t k = 0; k < 16; ++k) EXPECT_NEAR(set["root"]["transform"][k].get<double>(), wanted[k], 1e-6);
    EXPECT_LE(set["root"]["children"].size(), 300u);
  }
}

// A map without end that says where it lies.
class Placed final : public terrain::Terrain, public terrain::Raster {
 public:
  Placed(std::string crs, double easting, double northing) {
    origin_.crs = std::move(crs);
    origin_.easting = easting;
    origin_.northing = northing;
  }
  std::string_view name() const override { return "placed"; }
  std::string_view source() const override { return ""; }
  std::uint32_t seed() const override { return 1; }
  const terrain::Raster* raster() const override { return this; }
  const terrain::RasterShape& shape() const override { return shape_; }
  terrain::RasterOrigin origin() const override { return origin_; }
  void tile(terrain::TileAddress, terrain::Tile& out) const override { out.fill(0); }
  void heights(std::span<const lattice::Step>, std::span<const lattice::Step>, std::span<float> out) const override {
    std::ranges::fill(out, 0.0f);
  }

 private:
  terrain::RasterShape shape_{{-256'000, terrain::pitchOf(2560)}, {-256'000, terrain::pitchOf(2560)}, 201, 201, 0, 0, 7};  // around 0, 0
  terrain::RasterOrigin origin_;
};

// The oracle: PROJ's longitude and latitude, and the textbook's Earth-centred coordinates.
class Oracle {
 public:
  Oracle(const std::string& crs, double easting, double northing) {
    PJ* const plain = proj_create_crs_to_crs(context_, crs.c_str(), "EPSG:4326", nullptr);
    way_ = proj_normalize_for_visualization(context_, plain);
    proj_destroy(plain);
    // The way to WGS84 that is best in the map's middle, for all of it.
    proj_trans(way_, PJ_FWD, proj_coord(easting, northing, 0, HUGE_VAL));
    if (PJ* const best = proj_trans_get_last_used_operation(way_)) {
      proj_destroy(way_);
      way_ = best;
    }
  }
  Oracle(const Oracle&) = delete;
  Oracle& operator=(const Oracle&) = delete;
  ~Oracle() {
    proj_destroy(way_);
    proj_context_destroy(context_);
  }
  std::array<double, 3> at(double easting, double northing, double height) const {
    const PJ_COORD c = proj_trans(way_, PJ_FWD, proj_coord(easting, northing, 0, HUGE_VAL));
    const double l = c.xy.x * kDegree, p = c.xy.y * kDegree, e2 = 0.0066943799901413165;
    const double n = 6'378'137 / std::sqrt(1 - e2 * std::sin(p) * std::sin(p));
    return {(n + height) * std::cos(p) * std::cos(l), (n + height) * std::cos(p) * std::sin(l), (n * (1 - e2) + height) * std::sin(p)};
  }

 private:
  PJ_CONTEXT* const context_ = proj_context_create();
  PJ* way_ = nullptr;
};

// 100,000 vertices out to 300 km: on one plane they were up to 7 km above the ground at the rim. And boxes hold what is below them.
TEST(Tileset, VerticesOfAPlacedMapLieWhereProjHasThem) {
  struct Case {
    const char* crs;
    double easting, northing, unit = 1;
  };
  std::mt19937_64 random(8);
  const auto uniform = [&](double from, double to) { return std::uniform_real_distribution<double>(from, to)(random); };
  std::size_t vertices = 0;
  for (const Case& c :
       {Case{"EPSG:32632", 680'000, 5'240'000}, Case{"EPSG:25833", 400'000, 6'000'000}, Case{"EPSG:32756", 334'786, 6'252'080},
        Case{"EPSG:2056", 2'600'000, 1'200'000}, Case{"EPSG:27700", 400'000, 300'000}, Case{"EPSG:31287", 400'000, 400'000},
        Case{"EPSG:3035", 4'321'000, 3'210'000}, Case{"EPSG:28992", 155'000, 463'000}, Case{"EPSG:2154", 700'000, 6'600'000},
        Case{"EPSG:2263", 1'000'000, 200'000, 12 / 39.37}, Case{"EPSG:26910", 500'000, 5'400'000},
        Case{"EPSG:3031", 1'000'000, -1'500'000}}) {
    const Placed terrain(c.crs, c.easting * c.unit, c.northing * c.unit);
    const Oracle oracle(c.crs, c.easting, c.northing);
    const Question question{.middle = {}, .where = {{}, earth::Heights::kEllipsoid}, .isPrivate = false, .reach = 300'000};
    const Json root = Json::parse(rootTileset(terrain, question, ""))["root"];
    ASSERT_TRUE(root.contains("transform")) << c.crs;
    double worst = 0;  // of a tile's error
    for (int walk = 0; walk < 40; ++walk) {
      earth::Matrix world = root["transform"].get<earth::Matrix>();
      const double x = uniform(-300'000, 300'000), y = uniform(-300'000, 300'000);
      Json parent = root;
      std::vector<Json> children = root["children"];
      for (bool isLast = false; !isLast;) {
        const auto holds = [&](const Json& tile) {
          const LeafAddress s = squareOf(tile["content"]["uri"]);
          return x * 256 >= static_cast<double>(s.x()) && x * 256 < static_cast<double>(s.x() + s.side()) &&
                 -y * 256 >= static_cast<double>(s.z()) && -y * 256 < static_cast<double>(s.z() + s.side());
        };
        const auto found = std::ranges::find_if(children, holds);
        ASSERT_NE(found, children.end()) << c.crs;
        const Json tile = *found;
        const LeafAddress square = squareOf(tile["content"]["uri"]);
        const auto local = tile["transform"].get<earth::Matrix>();
        world = earth::product(world, local);
        const lattice::Point frame = frameOf(square);
        const auto box = parent["boundingVolume"]["box"].get<std::vector<double>>(),
                   own = tile["boundingVolume"]["box"].get<std::vector<double>>();
        for (int corner = 0; corner < 8; ++corner)  // of its box, within its parent's
          for (std::size_t k = 0; k < 3; ++k) {
            const double at[3] = {own[0] + (corner & 1 ? 1 : -1) * own[3], own[1] + (corner & 2 ? 1 : -1) * own[7],
                                  own[2] + (corner & 4 ? 1 : -1) * own[11]};
            const double v = local[k] * at[0] + local[4 + k] * at[1] + local[8 + k] * at[2] + local[12 + k];
            EXPECT_LE(std::abs(v - box[k]), box[3 + 4 * k] + 2e-3 * metres(square.side())) << c.crs << " " << square.level << " " << k;
          }
        const double side = lattice::metres(square.side()), west = lattice::metres(square.x()), north = -lattice::metres(square.z());
        for (int k = 0; k < 20; ++k, ++vertices) {
          const double e = west + uniform(0, side), n = north - uniform(0, side), h = uniform(-100, 4000);
          const double at[3] = {e - lattice::metres(frame.x), n + lattice::metres(frame.z), h};
          const auto right = oracle.at(c.easting + e / c.unit, c.northing + n / c.unit, h);
          double off = 0;
          for (std::size_t axis = 0; axis < 3; ++axis) {
            const double v = world[axis] * at[0] + world[4 + axis] * at[1] + world[8 + axis] * at[2] + world[12 + axis];
            off += (v - right[axis]) * (v - right[axis]);
          }
          off = std::sqrt(off);
          ASSERT_LE(off, errorOf(square.level) + 0.02) << c.crs << " level " << square.level;
          worst = std::max(worst, off / errorOf(square.level));
        }
        parent = tile;
        if (tile.contains("children")) {
          children = tile["children"].get<std::vector<Json>>();
        } else if (std::string(tile["content"]["uri"]).find(".json") != std::string::npos) {
          const Json below = Json::parse(tilesetOf(terrain, question, square, ""))["root"];
          EXPECT_FALSE(below.contains("transform"));
          children = below["children"].get<std::vector<Json>>();
        } else {
          isLast = true;
        }
      }
    }
    EXPECT_LT(worst, 0.6) << c.crs;
  }
  EXPECT_GT(vertices, 90'000u);
}

TEST(Tileset, TilesAreOnTheLatticeAlone) {
  EXPECT_TRUE(isTile({0, 0, 0}));
  EXPECT_TRUE(isTile({kCoarsest, -(std::int64_t{1} << 25), 0}));
  EXPECT_FALSE(isTile({kCoarsest, -(std::int64_t{1} << 25) - 1, 0}));
  EXPECT_FALSE(isTile({kCoarsest, 0, std::int64_t{1} << 25}));
  EXPECT_FALSE(isTile({-1, 0, 0}));
  EXPECT_FALSE(isTile({kCoarsest + 1, 0, 0}));
}

}  // namespace
}  // namespace ridgecast::tileset
