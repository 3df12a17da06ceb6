#include "tests/simulation/truth.h"

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <span>
#include <utility>

#include "common/codec/codec.h"
#include "common/edits/author.h"
#include "common/edits/edited_terrain.h"
#include "common/edits/json.h"
#include "common/edits/packed.h"
#include "common/ground/ground.h"
#include "server/edit_log/entry.h"
#include "server/edit_log/log.h"
#include "server/edit_log/tiles.h"
#include "server/map/mercator.h"
#include "server/map/picture.h"
#include "tests/support/process.h"

namespace ridgecast::simulation {
namespace {

std::string nameOf(const std::string& author, const std::string& key) { return key.empty() ? key : author + '\n' + key; }

// Roads get stations and heights when they are made.
bool isWhatWasAsked(const edits::Operation& asked, const edits::Operation& made) {
  const auto* road = std::get_if<edits::Road>(&asked.what);
  if (!road || road->surveyed) return asked == made;
  const auto* surveyed = std::get_if<edits::Road>(&made.what);
  const auto sameEnd = [](const lattice::Vertex& a, const lattice::Vertex& b) { return a.x == b.x && a.z == b.z; };
  return surveyed && asked.material == made.material && surveyed->width == road->width && surveyed->surveyed &&
         sameEnd(surveyed->line.front(), road->line.front()) && sameEnd(surveyed->line.back(), road->line.back());
}

edits::Posts changedPosts(const edits::Layer& a, const edits::Layer& b) {
  edits::Posts out;
  static const edits::Tile kNone;
  for (const edits::Layer* layer : {&a, &b})
    for (const edits::TileAddress at : layer->addresses()) {
      const edits::Tile *const before = a.tile(at), *const after = b.tile(at);
      if (before == after) continue;
      const edits::TilePosts was = (before ? *before : kNone).posts(), is = (after ? *after : kNone).posts();
      for (std::int64_t k = 0; k < edits::kTileSide * edits::kTileSide; ++k) {
        const auto n = static_cast<std::size_t>(k);
        if (was.rise[n] == is.rise[n] && was.material[n] == is.material[n]) continue;
        const std::int64_t x = at.posts().x0 + k % edits::kTileSide, z = at.posts().z0 + k / edits::kTileSide;
        out.add({x, z, x + 1, z + 1});
      }
    }
  return out;
}

}  // namespace

Truth::Truth(std::shared_ptr<const terrain::Terrain> terrain, std::string session)
    : terrain_(std::move(terrain)), session_(std::move(session)), history_(terrain_), layers_{history_.layer()} {}

void Truth::acknowledged(std::uint64_t number, const std::string& author, const std::optional<Asked>& asked) {
  knows(number);
  const auto [known, isNew] = acked_.emplace(number, std::pair(author, asked));
  const std::string name = asked ? nameOf(author, asked->key) : "";
  if (!isNew && asked) {
    EXPECT_EQ(nameOf(known->second.first, known->second.second ? known->second.second->key : ""), name) << "edit " << number << " is two";
    EXPECT_FALSE(name.empty()) << "edit " << number << " is two";
    EXPECT_TRUE(!known->second.second || known->second.second->operation == asked->operation) << "edit " << number << " is two";
  }
  if (!name.empty()) {
    EXPECT_EQ(numbers_.emplace(name, number).first->second, number) << name << " was made twice";
  }
}

void Truth::refused(const std::string& author, const std::string& key) {
  if (!key.empty()) refused_.insert(nameOf(author, key));
}

void Truth::told(const wire::MadeEdit& made) {
  knows(made.number);
  const auto [known, isNew] = told_.emplace(made.number, made);
  if (isNew) return;
  EXPECT_EQ(known->second.author, made.author) << "edit " << made.number << " is not everybody's";
  EXPECT_EQ(known->second.name, made.name) << "edit " << made.number << " is not everybody's";
  EXPECT_EQ(known->second.operation, made.operation) << "edit " << made.number << " is not everybody's";
  lattice::Area& least = known->second.ground;  // of all that were told
  least = {std::max(least.x0, made.ground.x0), std::max(least.z0, made.ground.z0), std::min(least.x1, made.ground.x1),
           std::min(least.z1, made.ground.z1)};
}

void Truth::answered(const wire::Query& query, const wire::Answer& answer) {
  knows(answer.edit);
  answers_.push_back({query, answer});
}

void Truth::answered(const wire::AskGround& ask, const wire::Ground& ground) {
  knows(ground.edit);
  grounds_.push_back({ask, ground});
}

void Truth::answered(const map::Sheet& sheet, std::uint64_t edit, const std::string& etag, std::string file) {
  knows(edit);
  EXPECT_EQ(files_.emplace(etag, file).first->second, file) << "two files have one ETag";
  mapped_.push_back({sheet, edit, std::move(file)});
}

void Truth::knows(std::uint64_t edit) { known_ = std::max(known_, edit); }

Truth::Log Truth::read(const std::filesystem::path& folder) const {
  // A copy, which SQLite may repair; the server shall find what the fall has left.
  const testing_support::ScratchFolder copy;
  std::filesystem::copy(folder, copy / "state");
  const std::string file = copy / "state" / (session_ + ".edits");
  Log out;
  if (!std::filesystem::exists(file)) return out;
  sqlite3* database = nullptr;
  EXPECT_EQ(sqlite3_open_v2(file.c_str(), &database, SQLITE_OPEN_READWRITE, "unix"), SQLITE_OK);
  const auto forEachRow = [&](const char* columns, const char* table, const char* order, const std::function<void(sqlite3_stmt*)>& f) {
    const std::string create = std::string("CREATE TABLE IF NOT EXISTS ") + table + "(" + columns + ")";
    EXPECT_EQ(sqlite3_exec(database, create.c_str(), nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(database);
    const std::string select = std::string("SELECT ") + columns + " FROM " + table + " ORDER BY " + order;
    sqlite3_stmt* rows = nullptr;
    EXPECT_EQ(sqlite3_prepare_v2(database, select.c_str(), -1, &rows, nullptr), SQLITE_OK) << sqlite3_errmsg(database);
    while (sqlite3_step(rows) == SQLITE_ROW) f(rows);
    sqlite3_finalize(rows);
  };
  forEachRow("number, key, author, edit", "edits", "number", [&](sqlite3_stmt* row) {
    const auto text = [&](int column) { return std::string(reinterpret_cast<const char*>(sqlite3_column_text(row, column))); };
    EXPECT_EQ(static_cast<std::uint64_t>(sqlite3_column_int64(row, 0)), out.edits.size() + 1) << "the log's numbers";
    auto operation =
        edits::unpack({static_cast<const char*>(sqlite3_column_blob(row, 3)), static_cast<std::size_t>(sqlite3_column_bytes(row, 3))});
    ASSERT_TRUE(operation) << operation.error().message;
    std::string json = edits::toJson(*operation);
    out.edits.push_back({text(2), text(1), std::move(json), std::move(*operation)});
  });
  forEachRow("i, j, tile", "tiles", "i, j", [&](sqlite3_stmt* row) {
    const edits::TileAddress at{sqlite3_column_int64(row, 0), sqlite3_column_int64(row, 1)};
    out.tiles[at] = edit_log::decodeTile(
        {static_cast<const std::uint8_t*>(sqlite3_column_blob(row, 2)), static_cast<std::size_t>(sqlite3_column_bytes(row, 2))});
  });
  sqlite3_close(database);
  if (out.edits.empty()) return out;
  const auto log = edit_log::Log::open(file);
  EXPECT_TRUE(log && *log && (*log)->layer()) << "a server would have to make all edits again";
  return out;
}

void Truth::judge(const std::filesystem::path& folder) {
  Log log = read(folder);
  add(std::move(log.edits));
  if (testing::Test::HasFailure()) return;
  judgeEdits();
  judgeTiles(log.tiles, log_.size());
  judgeAnswers();
}

void Truth::judgeShared() {
  std::vector<Entry> log;
  for (const bus::Entry& e : shared_()) {
    const auto entry = edit_log::unpackEntry(e.bytes);
    ASSERT_TRUE(entry) << entry.error().message;
    ASSERT_EQ(entry->edit.number, log.size() + 1) << "the shared log's numbers";
    auto operation = edits::unpack(entry->edit.operation).value();
    std::string json = edits::toJson(operation);
    log.push_back({entry->edit.author, entry->edit.key, std::move(json), std::move(operation)});
  }
  add(std::move(log));
  if (testing::Test::HasFailure()) return;
  judgeEdits();
  judgeAnswers();
}

void Truth::judgeCopy(const std::filesystem::path& folder) const {
  const Log log = read(folder);
  ASSERT_LE(log.edits.size(), log_.size()) << "a server has edits that the shared log has not";
  EXPECT_TRUE(std::equal(log.edits.begin(), log.edits.end(), log_.begin())) << "a server has other edits than the shared log";
  judgeTiles(log.tiles, log.edits.size());
}

std::shared_ptr<const edits::Layer> Truth::layer(std::uint64_t edit) {
  if (edit >= layers_.size()) {
    const auto log = shared_();
    for (; history_.last() < std::min<std::uint64_t>(edit, log.size()); makeNext()) {
      const auto entry = edit_log::unpackEntry(log[history_.last()].bytes);
      auto operation = edits::unpack(entry.value().edit.operation).value();
      std::string json = edits::toJson(operation);
      log_.push_back({entry->edit.author, entry->edit.key, std::move(json), std::move(operation)});
    }
  }
  return edit < layers_.size() ? layers_[edit] : nullptr;
}

void Truth::makeNext() {
  ASSERT_TRUE(history_.add(log_[history_.last()].operation)) << "edit " << history_.last() + 1;
  changed_.push_back(changedPosts(*layers_.back(), *history_.layer()));
  layers_.push_back(history_.layer());
}

// The log, which goes on with that of before.
void Truth::add(std::vector<Entry> log) {
  const auto before = std::exchange(log_, std::move(log));
  ASSERT_GE(log_.size(), before.size()) << "the log has lost edits that a server began with";
  EXPECT_TRUE(std::equal(before.begin(), before.end(), log_.begin())) << "the log has changed edits";
  ASSERT_GE(log_.size(), known_) << "the log has lost edits that members know of";
  while (history_.last() < log_.size() && !testing::Test::HasFailure()) makeNext();
}

void Truth::judgeAnswers() {
  for (const Answered& answered : std::exchange(answers_, {})) judgeAnswer(answered);
  for (const Meshed& meshed : std::exchange(grounds_, {})) judgeGround(meshed);
  for (const Mapped& mapped : std::exchange(mapped_, {})) judgeMap(mapped);
}

// Triangles with their middles in the circle are no farther from the true ground than was asked, or there is a reason.
void Truth::judgeGround(const Meshed& meshed) const {
  const auto& [ask, ground] = meshed;
  EXPECT_LE(ground.error, ask.error);
  std::vector<lattice::Step> x, z;  // where the triangles have their middles
  std::vector<double> y;
  for (const wire::LeafWhole& whole : ground.leaves) {
    const auto leaf = codec::decodeLeaf(whole.payload, whole.address, whole.vertices, whole.triangles);
    ASSERT_TRUE(leaf) << leaf.error().message;
    for (const mesh::Triangle& t : leaf->triangles) {
      std::array<lattice::Step, 3> sum{};
      for (const std::uint32_t v : t) {
        sum[0] += leaf->vertices[v].x;
        sum[1] += leaf->vertices[v].y;
        sum[2] += leaf->vertices[v].z;
      }
      // Rounded down: the middle lies between this place and the next along x and z.
      const auto third = [](lattice::Step v) { return (v - ((v % 3) + 3) % 3) / 3; };
      const lattice::Step middleX = whole.address.x() + third(sum[0]), middleZ = whole.address.z() + third(sum[2]);
      if (std::hypot(middleX - ask.at.x, middleZ - ask.at.z) > ask.radius * lattice::kStepsPerMetre) continue;
      for (const auto& [dx, dz] : {std::pair{0, 0}, {1, 0}, {0, 1}, {1, 1}}) {  // a wall is high within a step
        x.push_back(middleX + dx);
        z.push_back(middleZ + dz);
      }
      y.push_back(static_cast<double>(sum[1]) / 3 * lattice::kMetresPerStep);
    }
  }
  std::vector<float> heights(x.size());
  edits::EditedTerrain(terrain_, layers_[ground.edit]).heights(x, z, heights);
  for (std::size_t k = 0; k < y.size(); ++k) {
    const auto [low, high] = std::ranges::minmax(std::span(heights).subspan(4 * k, 4));
    ASSERT_GE(y[k], static_cast<double>(low) - ask.error - 0.05) << "a ground as of edit " << ground.edit;
    ASSERT_LE(y[k], static_cast<double>(high) + ask.error + 0.05) << "a ground as of edit " << ground.edit;
  }
}

void Truth::judgeMap(const Mapped& mapped) const {
  const std::vector<float> heights = map::heights(edits::EditedTerrain(terrain_, layers_[mapped.edit]), mapped.sheet);
  std::vector<std::uint8_t> rgb(3 * heights.size());
  for (std::size_t k = 0; k < heights.size(); ++k) map::terrarium(heights[k], &rgb[3 * k]);
  EXPECT_EQ(mapped.file, map::png(rgb, mapped.sheet.columns, mapped.sheet.rows)) << "a tile of heights as of edit " << mapped.edit;
}

void Truth::judgeAnswer(const Answered& answered) const {
  const auto& [query, answer] = answered;
  const edits::EditedTerrain edited(terrain_, layers_[answer.edit]);
  std::vector<float> heights, normals;
  std::vector<double> distances;
  if (query.kind == wire::QueryKind::kHeights) {
    heights.resize(query.x.size());
    edited.heights(query.x, query.z, heights);
  } else if (query.kind == wire::QueryKind::kNormals) {
    normals.resize(3 * query.x.size());
    terrain::normals(edited, query.x, query.z, terrain::kDefaultSpacing, normals);
  }
  for (const wire::Ray& ray : query.rays) distances.push_back(ground::cast(edited, ray));
  EXPECT_EQ(answer.heights, heights) << "an answer as of edit " << answer.edit;
  EXPECT_EQ(answer.normals, normals) << "an answer as of edit " << answer.edit;
  EXPECT_EQ(answer.distances, distances) << "an answer as of edit " << answer.edit;
}

void Truth::judgeEdits() const {
  std::set<std::string> keys, withoutKey;
  for (const Entry& entry : log_) {
    if (shared_ && entry.key.empty() && !std::holds_alternative<edits::Undo>(entry.operation.what)) {
      EXPECT_TRUE(withoutKey.insert(entry.author + '\n' + entry.json).second)
          << entry.author << "'s edit is in the log twice: " << entry.json;
    }
    if (entry.key.empty()) continue;
    EXPECT_TRUE(keys.insert(entry.key).second) << entry.key << " is in the log twice";
    EXPECT_FALSE(refused_.contains(entry.key)) << entry.key << " was refused, and is in the log";
  }
  for (const auto& [number, said] : acked_) {
    const Entry& entry = log_[number - 1];
    EXPECT_EQ(entry.author, said.first) << "edit " << number;
    if (!said.second) continue;
    EXPECT_EQ(entry.key, nameOf(said.first, said.second->key)) << "edit " << number;
    EXPECT_TRUE(isWhatWasAsked(said.second->operation, entry.operation)) << "edit " << number << " is " << entry.json;
  }
  for (const auto& [number, made] : told_) {
    EXPECT_EQ(edits::toText({made.author, made.name}), log_[number - 1].author) << "edit " << number;
    EXPECT_EQ(made.operation, log_[number - 1].json) << "edit " << number;
    judgeArea(made);
  }
}

// A server starts from them.
void Truth::judgeTiles(const Tiles& tiles, std::size_t last) const {
  const edits::Layer& layer = *layers_[last];
  std::size_t kept = 0;
  for (const edits::TileAddress at : layer.addresses()) kept += !layer.tile(at)->isZero();
  EXPECT_EQ(tiles.size(), kept) << "cached tiles of " << last << " edits";
  for (const auto& [at, tile] : tiles) {
    const edits::Tile* const made = layer.tile(at);
    ASSERT_TRUE(tile && made && *tile == *made) << "the cached tile " << at.i << ", " << at.j << " is not what the edits make";
  }
}

void Truth::judgeArea(const wire::MadeEdit& made) const {
  const edits::Posts& posts = changed_[made.number - 1];
  if (posts.empty()) return;
  // A post is one of the four around a place along each axis, so it counts up to two posts away.
  constexpr lattice::Step kPost = 128, kReach = 2 * kPost - 1;
  const lattice::Area& said = made.ground;
  EXPECT_TRUE(said.holds({posts.x0 * kPost - kReach, posts.z0 * kPost - kReach}) &&
              said.holds({(posts.x1 - 1) * kPost + kReach, (posts.z1 - 1) * kPost + kReach}))
      << "edit " << made.number << " changes more than its area";
}

std::vector<std::uint64_t> Truth::counting() const {
  std::vector<bool> counts(log_.size() + 1, true);
  std::vector<std::uint64_t> out;
  for (std::uint64_t n = log_.size(); n > 0; --n) {
    const auto* undo = std::get_if<edits::Undo>(&log_[n - 1].operation.what);
    if (undo && counts[n]) counts[undo->edit] = false;
    if (!undo && counts[n]) out.push_back(n);
  }
  return out;
}

std::shared_ptr<const edits::Layer> Truth::ground() const {
  edits::History anew(terrain_);
  const auto numbers = counting();
  for (auto n = numbers.rbegin(); n != numbers.rend(); ++n) EXPECT_TRUE(anew.add(log_[*n - 1].operation));
  return anew.layer();
}

}  // namespace ridgecast::simulation
