// A box as 3D Tiles, walked from tileset.json by the URIs alone: every file is there and wanted, every tile keeps its error where the
// tileset puts it, and each level covers the box.
#include "server/snapshot/tiles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "common/terrain/raster.h"
#include "server/directory/directory.h"
#include "tests/support/edit.h"
#include "tests/support/glb_file.h"

namespace ridgecast::snapshot {
namespace {

using testing::HasSubstr;
using Json = nlohmann::json;
using Files = std::map<std::string, std::string>;

// Hills of samples 30 m apart, 150 x 90 of them, whose corner lies at no round place.
class Hills final : public terrain::Terrain, public terrain::Raster {
 public:
  explicit Hills(double pitch = 7680)
      : shape_{{-576'123, terrain::pitchOf(pitch)}, {-346'001, terrain::pitchOf(pitch)}, 150, 90, -30'000, 30'000, 7} {}
  std::string_view name() const override { return "hills"; }
  std::string_view source() const override { return ""; }
  std::uint32_t seed() const override { return 1; }
  const terrain::Raster* raster() const override { return this; }
  const terrain::RasterShape& shape() const override { return shape_; }
  void tile(terrain::TileAddress at, terrain::Tile& out) const override {
    for (std::int64_t k = 0; k < static_cast<std::int64_t>(out.size()); ++k)
      out[static_cast<std::size_t>(k)] =
          sample(at.i * terrain::kTileSide + k % terrain::kTileSide, at.j * terrain::kTileSide + k / terrain::kTileSide);
  }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    for (std::size_t k = 0; k < out.size(); ++k) {
      const auto bx = shape_.x.at(x[k]), bz = shape_.z.at(z[k]);
      std::array<std::int32_t, 16> around;
      for (std::int64_t j = 0; j < 4; ++j)
        for (std::int64_t i = 0; i < 4; ++i) around[static_cast<std::size_t>(4 * j + i)] = sample(bx.sample - 1 + i, bz.sample - 1 + j);
      out[k] = terrain::cubicHeight(around, bx.steps(), bz.steps(), shape_.x.inverse(), shape_.z.inverse());
    }
  }

 private:
  static std::int32_t sample(std::int64_t x, std::int64_t z) {
    return static_cast<std::int32_t>(std::lround(30'000 * std::sin(static_cast<double>(x) * 0.3) * std::cos(static_cast<double>(z) * 0.2)));
  }
  terrain::RasterShape shape_;
};

class TilesTest : public testing::Test {
 protected:
  TilesTest() { resources_->executor = &executor_; }

  Result<std::uint32_t> make(std::shared_ptr<const terrain::Terrain> terrain, const std::string& query, unsigned threads = 2) {
    terrain_ = std::move(terrain);
    directory_ = std::make_shared<directory::Directory>(resources_, terrain_);
    session_ = directory_->find("default");
    const auto question = parse(query, limits_, terrain_->raster(), Format::kTiles);
    EXPECT_TRUE(question) << question.error().message;
    files_.clear();
    std::mutex mutex;
    const Put put = [&](const std::string& name, std::string_view bytes) {
      const std::lock_guard lock(mutex);
      if (files_.size() >= room_) return false;
      EXPECT_FALSE(files_.contains("tileset.json")) << name << " comes after the end";
      if (files_.empty() && edits_) testing_support::makeCrater(*session_, 300, 300, 100, 30);
      return files_.emplace(name, bytes).second;
    };
    return makeTiles(snapshots_, *session_, *question, threads, put, {}, &progress_);
  }

  // A tile, in the root's axes: x east, y north, z up, from `origin_`.
  struct Bounds {
    double low[3], high[3];
  };
  static Bounds boundsOf(const Json& tile, double east, double north) {
    const auto b = tile["boundingVolume"]["box"].get<std::vector<double>>();
    return {{east + b[0] - b[3], north + b[1] - b[7], b[2] - b[11]}, {east + b[0] + b[3], north + b[1] + b[7], b[2] + b[11]}};
  }
  static void expectWithin(const Bounds& inner, const Bounds& outer, const std::string& name) {
    for (int k = 0; k < 3; ++k) {
      EXPECT_GE(inner.low[k], outer.low[k] - 1e-6) << name;
      EXPECT_LE(inner.high[k], outer.high[k] + 1e-6) << name;
    }
  }

  void walkAll() {
    const Json set = open("tileset.json");
    origin_ = set["asset"]["extras"]["origin"];
    const Bounds all = boundsOf(set["root"], 0, 0);
    for (const Json& child : set["root"]["children"]) walk(child, "", set["root"]["geometricError"], all, 0, 0);
    EXPECT_EQ(seen_.size(), files_.size()) << "files that no tileset names";
    EXPECT_EQ(tiles_, set["asset"]["extras"]["tiles"]);
  }
  Json open(const std::string& name) {
    EXPECT_TRUE(files_.contains(name)) << name;
    EXPECT_TRUE(seen_.insert(name).second) << name << " is named twice";
    return name.ends_with(".json") ? Json::parse(files_.at(name)) : Json();
  }
  // Of its content, from the root's folder.
  static std::string uriOf(const Json& tile, std::string folder) {
    std::string uri = tile["content"]["uri"];
    for (; uri.starts_with("../"); uri.erase(0, 3)) folder.erase(folder.rfind('/', folder.size() - 2) + 1);
    return folder + uri;
  }
  void walk(const Json& tile, const std::string& folder, double above, const Bounds& around, double east, double north) {
    if (const auto t = tile.find("transform"); t != tile.end()) {
      east += (*t)[12].get<double>();
      north += (*t)[13].get<double>();
    }
    const std::string uri = uriOf(tile, folder);
    const Json set = open(uri);
    const double error = tile["geometricError"];
    EXPECT_LE(error, above);
    const Bounds bounds = boundsOf(tile, east, north);
    expectWithin(bounds, around, uri);
    if (!set.is_null()) {
      EXPECT_EQ(set["root"]["geometricError"], error);
      return walk(set["root"], uri.substr(0, uri.rfind('/') + 1), error, bounds, east, north);
    }
    ++tiles_;
    judge(testing_support::readGlb(files_.at(uri)), uri, error, bounds, east, north);
    if (tile.contains("children"))
      for (const Json& child : tile["children"]) walk(child, folder, error, bounds, east, north);
  }
  // Heights of the surface on a grid, by plain barycentric arithmetic, against the terrain's.
  void judge(const testing_support::GlbFile& file, const std::string& uri, double error, const Bounds& bounds, double east, double north) {
    ASSERT_EQ(file.leaves.size(), 2u) << uri;
    EXPECT_LE(file.json["asset"]["extras"]["error"]["kept"].get<double>(), error) << uri;
    for (const auto& leaf : file.leaves) {
      const auto& address = leaf.mesh.address;
      EXPECT_NEAR(east + leaf.translation[0] + origin_["x"].get<double>(), static_cast<double>(address.x()) / 256, 1e-6) << uri;
      EXPECT_NEAR(-north + leaf.translation[2] + origin_["z"].get<double>(), static_cast<double>(address.z()) / 256, 1e-6) << uri;
      for (const mesh::LocalVertex& v : leaf.mesh.vertices) {
        const double x = east + leaf.translation[0] + v.x / 256.0, y = north - leaf.translation[2] - v.z / 256.0, z = v.y / 256.0;
        expectWithin({{x, y, z}, {x, y, z}}, bounds, uri);
      }
    }
    const mesh::LeafMesh& mesh = file.leaves[0].mesh;
    std::vector<lattice::Step> xs, zs;
    std::vector<double> found;
    double area = 0;
    for (const mesh::Triangle& t : mesh.triangles) {
      const auto &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
      const double twice = (double(b.z) - a.z) * (double(c.x) - a.x) - (double(b.x) - a.x) * (double(c.z) - a.z);
      area += twice / 2;
      for (int i = 1; i < 6; ++i)
        for (int j = 1; i + j < 6; ++j) {
          const double x = std::round((a.x * i + b.x * j + double(c.x) * (6 - i - j)) / 6),
                       z = std::round((a.z * i + b.z * j + double(c.z) * (6 - i - j)) / 6);
          const double wb = ((z - a.z) * (double(c.x) - a.x) - (x - a.x) * (double(c.z) - a.z)) / twice;
          const double wc = ((x - a.x) * (double(b.z) - a.z) - (z - a.z) * (double(b.x) - a.x)) / twice;
          if (wb < 0 || wc < 0 || wb + wc > 1) continue;
          xs.push_back(mesh.address.x() + static_cast<lattice::Step>(x));
          zs.push_back(mesh.address.z() + static_cast<lattice::Step>(z));
          found.push_back((a.y + wb * (double(b.y) - a.y) + wc * (double(c.y) - a.y)) / 256);
        }
    }
    area_[mesh.address.level] += area;
    std::vector<float> heights(xs.size());
    terrain_->heights(xs, zs, heights);
    double worst = 0;
    for (std::size_t k = 0; k < xs.size(); ++k) worst = std::max(worst, std::abs(found[k] - heights[k]));
    EXPECT_LE(worst, error) << uri;
    judged_ += xs.size();
  }

  scheduling::Executor executor_{1};
  const Limits limits_;
  Snapshots snapshots_{{}, 1};
  std::shared_ptr<session::Resources> resources_ = std::make_shared<session::Resources>();
  std::shared_ptr<const terrain::Terrain> terrain_;
  std::shared_ptr<directory::Directory> directory_;
  std::shared_ptr<session::Session> session_;
  TilesProgress progress_;
  Files files_;
  bool edits_ = false;  // once the first file is there
  std::size_t room_ = 100'000;
  Json origin_;
  std::set<std::string> seen_;
  std::map<int, double> area_;  // square steps covered, by level
  std::size_t tiles_ = 0, judged_ = 0;
};

TEST_F(TilesTest, OfABoxKeepTheirErrorAndCoverIt) {
  const auto made = make(terrain::create("alpine", 3).value(), "x0=-1000.5&z0=2000&x1=1100&z1=3333&error=1.6&compression=draco");
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_EQ(progress_.text(), "meshing, tile " + std::to_string(*made) + " of " + std::to_string(*made));
  walkAll();
  EXPECT_EQ(tiles_, *made);
  EXPECT_GT(judged_, 100'000u);
  const double box = 2100.5 * 1333 * 65536;
  EXPECT_EQ(area_.size(), 5u);  // 128 m to 2 km
  for (const auto& [level, area] : area_) {
    EXPECT_GE(area / box, 1) << level;
    EXPECT_LE(area / box, 1 + 0.5 * tileset::errorOf(level) * 3433.5 * 65536 / box) << level << ": widened by a quarter of the error";
  }
  const Json extras = Json::parse(files_["tileset.json"])["asset"]["extras"];
  EXPECT_EQ(extras["of"], "tiles");
  EXPECT_EQ(extras["box"], (Json{{"x0", -1000.5}, {"z0", 2000.0}, {"x1", 1100.0}, {"z1", 3333.0}}));
  EXPECT_EQ(extras["error"], (Json{{"unit", "metres"}, {"asked", 1.6}}));
  EXPECT_EQ(extras["terrain"], "alpine");
  EXPECT_FALSE(Json::parse(files_["tileset.json"])["root"].contains("transform"));
}

TEST_F(TilesTest, AreThoseOfAServerWhereTheBoxDoesNotCutThem) {
  ASSERT_TRUE(make(terrain::create("canyon", 3).value(), "x0=0&z0=0&x1=1100&z1=600&error=3.2"));
  const Files files = files_;
  for (const lattice::LeafAddress square : {lattice::LeafAddress{3, 3, 1}, {4, 0, 0}}) {
    Question question;
    question.of = tileset::whole(square);
    const auto tile = snapshots_.take(*session_, session_->ground(), question, false, {});
    ASSERT_TRUE(tile);
    EXPECT_EQ(files.at(std::to_string(square.level) + "/" + std::to_string(square.i) + "/" + std::to_string(square.j) + ".glb"),
              tile->file);
  }
  ASSERT_TRUE(make(terrain_, "x0=0&z0=0&x1=1100&z1=600&error=3.2", 5));
  EXPECT_EQ(files_, files) << "threads change nothing";
}

TEST_F(TilesTest, AreOfOneGroundWhateverIsEditedMeanwhile) {
  const auto alpine = terrain::create("alpine", 3).value();
  const std::string box = "x0=0&z0=0&x1=600&z1=600&error=1.6";
  ASSERT_TRUE(make(alpine, box));
  const Files files = files_;
  edits_ = true;
  ASSERT_TRUE(make(alpine, box));
  EXPECT_EQ(session_->ground().edit, 1u);
  EXPECT_TRUE(files_ == files);
}

TEST_F(TilesTest, OfAMapAreAtLeast64SamplesWideAndEndWithIt) {
  const auto made = make(std::make_shared<Hills>(), "box=all&error=2.5");
  ASSERT_TRUE(made) << made.error().message;
  walkAll();
  EXPECT_EQ(area_.begin()->first, 6) << "2,048 m";
  for (const auto& [level, area] : area_) EXPECT_NEAR(area / (149 * 89 * 7680.0 * 7680), 1, 0.01) << level;
  EXPECT_LT(*made, 30u);
}

TEST_F(TilesTest, LieOnTheEarthWhereTheQuestionSays) {
  ASSERT_TRUE(make(terrain::create("archipelago", 3).value(), "x0=1000000&z0=0&x1=1000500&z1=300&error=6&at=10,50,20"));
  const Json root = Json::parse(files_["tileset.json"])["root"];
  const auto wanted = earth::eastNorthUp(*earth::placeOf("10,50,20"));
  for (std::size_t k = 0; k < 16; ++k) EXPECT_NEAR(root["transform"][k].get<double>(), wanted[k], 1e-6);
  const Bounds all = boundsOf(root, 0, 0);  // around the box's middle
  EXPECT_NEAR(all.low[0], -250, 4);
  EXPECT_NEAR(all.high[1], 150, 4);
}

// Bowring's, good to a micrometre near the ground.
double heightAboveWgs84(double x, double y, double z) {
  const double a = 6'378'137, b = 6'356'752.314245179, e2 = 1 - b * b / (a * a), p = std::hypot(x, y);
  const double beta = std::atan2(a * z, b * p);
  const double phi = std::atan2(z + (a * a / (b * b) - 1) * b * std::pow(std::sin(beta), 3), p - e2 * a * std::pow(std::cos(beta), 3));
  return p * std::cos(phi) + z * std::sin(phi) - a * std::sqrt(1 - e2 * std::sin(phi) * std::sin(phi));
}

// Where a map's samples are far apart, 64 of them are wider than the Earth is flat: one of 2.4 km a sample was 168 m off at an error of 20.
TEST_F(TilesTest, OnTheGlobeAreWithinTheirErrorOfTheEarth) {
  ASSERT_TRUE(make(std::make_shared<Hills>(51'200), "box=all&error=5&at=10,47,0"));
  std::map<int, double> worst;
  const auto judgeAll = [&](const auto& self, const Json& tile, const std::string& folder, earth::Matrix world) -> void {
    if (tile.contains("transform")) world = earth::product(world, tile["transform"].get<earth::Matrix>());
    for (const Json& child : tile.value("children", Json::array())) self(self, child, folder, world);
    if (!tile.contains("content")) return;
    const std::string uri = uriOf(tile, folder);
    if (uri.ends_with(".json")) return self(self, Json::parse(files_.at(uri))["root"], uri.substr(0, uri.rfind('/') + 1), world);
    const auto surface = testing_support::readGlb(files_.at(uri)).leaves[0];
    for (const mesh::LocalVertex& v : surface.mesh.vertices) {
      const double at[3] = {surface.translation[0] + v.x / 256.0, -surface.translation[2] - v.z / 256.0, v.y / 256.0};
      double there[3];
      for (std::size_t k = 0; k < 3; ++k) there[k] = world[k] * at[0] + world[4 + k] * at[1] + world[8 + k] * at[2] + world[12 + k];
      const double off = std::abs(heightAboveWgs84(there[0], there[1], there[2]) - at[2]);
      EXPECT_LE(off, tile["geometricError"].get<double>()) << uri;
      double& most = worst[surface.mesh.address.level];
      most = std::max(most, off);
    }
  };
  judgeAll(judgeAll, Json::parse(files_["tileset.json"])["root"], "", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1});
  EXPECT_EQ(worst.begin()->first, 7) << "4 km, not 16";
  EXPECT_LE(worst.begin()->second, 0.4 * 5);
  EXPECT_GT(worst.begin()->second, 0.2);
}

TEST_F(TilesTest, TooManyNameTheErrorThatFits) {
  const auto alpine = terrain::create("alpine", 3).value();
  const auto refused = make(alpine, "x0=0&z0=0&x1=30000&z1=30000&error=0.4");
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().message,
            "This box at an error of 0.4 m takes 1173644 tiles, more than 250000, the limit; at an error of 1.6 m it takes 73839.");
  EXPECT_TRUE(files_.empty());
}

TEST_F(TilesTest, WithoutRoomThereIsNoTileset) {
  room_ = 4;
  const auto failed = make(terrain::create("alpine", 3).value(), "x0=0&z0=0&x1=500&z1=500&error=3.2");
  ASSERT_FALSE(failed);
  EXPECT_THAT(failed.error().message, HasSubstr("is there room"));
  EXPECT_FALSE(files_.contains("tileset.json"));
}

TEST(TilesQuestion, HaveNoTextureAndArePartOfABox) {
  const auto complaint = [](const char* query) {
    const auto question = parse(query, {}, nullptr, Format::kTiles);
    return question ? "" : question.error().message;
  };
  const std::string box = "x0=0&z0=0&x1=100&z1=100&error=1";
  EXPECT_EQ(complaint(box.c_str()), "");
  EXPECT_THAT(complaint((box + "&texture=64").c_str()), HasSubstr("neither a texture"));
  EXPECT_THAT(complaint((box + "&origin=world").c_str()), HasSubstr("neither a texture nor an origin"));
  EXPECT_THAT(complaint((box + "&at=1").c_str()), HasSubstr("must be LON,LAT"));
  EXPECT_THAT(complaint("x=0&z=0&altitude=3&yaw=0&pitch=0"), HasSubstr("Tiles are of a box"));
  EXPECT_THAT(complaint("camera=3"), HasSubstr("Tiles are of a box"));
  EXPECT_THAT(parse(box + "&at=1,2", {}).error().message, HasSubstr("'at'"));
}

}  // namespace
}  // namespace ridgecast::snapshot
