#include "server/edit_log/log.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/edits/json.h"
#include "common/text/text.h"
#include "server/edit_log/database.h"
#include "server/edit_log/tiles.h"

namespace ridgecast::edit_log {
namespace {

using Json = nlohmann::json;

constexpr std::int64_t kApplicationId = 0x52434544;  // "RCED", in the file's header
constexpr std::int64_t kVersion = 1;

constexpr const char* kTables = R"(
  CREATE TABLE meta(terrain TEXT, seed INTEGER, parameters TEXT, content_hash INTEGER,
                    compacted INTEGER, tiles_of INTEGER, tiles_hash INTEGER, base_hash INTEGER) STRICT;
  CREATE TABLE edits(number INTEGER PRIMARY KEY, key TEXT, author TEXT, time INTEGER, edit TEXT, hash INTEGER) STRICT;
  CREATE UNIQUE INDEX edits_by_key ON edits(key) WHERE key <> '';
  CREATE TABLE tiles(i INTEGER, j INTEGER, tile BLOB, hash INTEGER, PRIMARY KEY(i, j)) WITHOUT ROWID, STRICT;
  CREATE TABLE base_tiles(i INTEGER, j INTEGER, tile BLOB, hash INTEGER, PRIMARY KEY(i, j)) WITHOUT ROWID, STRICT;
  PRAGMA application_id = 0x52434544; PRAGMA user_version = 1)";

std::uint64_t hashOfEdit(const Edit& edit, std::string_view operation) {
  std::uint64_t hash = lattice::mix(edit.number + lattice::mix(static_cast<std::uint64_t>(edit.time)));
  for (const std::string_view text : {std::string_view(edit.key), std::string_view(edit.author), operation})
    hash = hashOfBytes({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}, hash);
  return hash;
}

// Tiles that may differ: those of these posts, each once, ascending.
std::vector<edits::TileAddress> tilesOf(std::span<const edits::Posts> changed) {
  std::vector<edits::TileAddress> out;
  for (const edits::Posts& p : changed) {
    if (p.empty()) continue;
    for (std::int64_t i = p.x0 >> edits::kTileBits; i <= (p.x1 - 1) >> edits::kTileBits; ++i)
      for (std::int64_t j = p.z0 >> edits::kTileBits; j <= (p.z1 - 1) >> edits::kTileBits; ++j) out.push_back({i, j});
  }
  std::ranges::sort(out);
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

// Tiles that are all 0 are not kept: Layer::with() puts them where they are needed.
const edits::Tile* keptTile(const edits::Layer& layer, edits::TileAddress at) {
  const edits::Tile* const tile = layer.tile(at);
  return tile && !tile->isZero() ? tile : nullptr;
}

}  // namespace

struct Log::Statements {
  Database database;
  Statement addEdit, readEdits, numberOf, hashOfTile, putTile, removeTile, readTiles, readBase, putMeta;
  std::vector<std::uint8_t> bytes;  // of the tile at hand
};

Log::Log(std::shared_ptr<const Lock> lock) : lock_(std::move(lock)), sql_(std::make_unique<Statements>()) {}
Log::~Log() = default;

Error Log::damaged(const std::string& what) const { return {"'" + file().filename().string() + "' is damaged: " + what + "."}; }

Outcome<std::unique_ptr<Log>> Log::open(const std::filesystem::path& file) {
  auto lock = Lock::take(file);
  return lock ? open(std::move(*lock)) : lock.error();
}

Outcome<std::unique_ptr<Log>> Log::create(const std::filesystem::path& file, const World& world) {
  auto lock = Lock::take(file);
  return lock ? create(std::move(*lock), world) : lock.error();
}

Outcome<std::unique_ptr<Log>> Log::open(std::shared_ptr<const Lock> lock) {
  std::unique_ptr<Log> log(new Log(std::move(lock)));
  std::error_code unknown;
  if (std::filesystem::status(log->file(), unknown).type() == std::filesystem::file_type::not_found) return std::unique_ptr<Log>();
  const auto isThere = log->connect(SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX);
  if (!isThere) return isThere.error();
  if (!*isThere) return std::unique_ptr<Log>();
  if (auto loaded = log->load(); !loaded) return loaded.error();
  return log;
}

Outcome<std::unique_ptr<Log>> Log::create(std::shared_ptr<const Lock> lock, const World& world) {
  std::unique_ptr<Log> log(new Log(std::move(lock)));
  const auto isThere = log->connect(SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX);
  if (!isThere) return isThere.error();
  if (*isThere)
    return Error{"'" + log->file().filename().string() + "' has edits already; the session must be joined again to go on with them."};
  if (auto created = log->makeTables(world); !created) return created.error();
  if (auto loaded = log->load(); !loaded) return loaded.error();
  return log;
}

Outcome<bool> Log::connect(int flags) {
  const std::filesystem::path& file = this->file();
  const std::string name = "'" + file.filename().string() + "'";
  // To SQLite a file of one byte is an empty one, and it would begin again.
  std::error_code unknown;
  if (std::filesystem::file_size(file, unknown) == 1 && !unknown) return Error{name + " is not a log of edits."};
  auto database = Database::open(file, flags);
  if (!database) return database.error();
  Database& db = sql_->database = std::move(*database);
  // EXTRA also syncs the folder when a journal goes. One that came back after a power cut would undo what followed it.
  if (auto set =
          db.run("PRAGMA locking_mode = EXCLUSIVE; PRAGMA synchronous = EXTRA; PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON");
      !set)
    return set.error();
  const auto id = db.integer("PRAGMA application_id"), version = db.integer("PRAGMA user_version"),
             tables = db.integer("SELECT count(*) FROM sqlite_schema");
  for (const auto* read : {&id, &version, &tables})
    if (!*read) return read->error();
  const bool isThere = *id != 0 || *version != 0 || *tables != 0;
  if (isThere && *id != kApplicationId) return Error{name + " is not a log of edits."};
  if (isThere && *version != kVersion)
    return Error{name + " is a log of edits of version " + std::to_string(*version) + "; this program reads version " +
                 std::to_string(kVersion) + "."};
  // Only the first write locks out others.
  if (auto set = db.run("PRAGMA journal_mode = WAL; BEGIN EXCLUSIVE; COMMIT"); !set) return set.error();
  return isThere;
}

Outcome<void> Log::makeTables(const World& world) {
  Database& db = sql_->database;
  Transaction transaction(db);
  if (auto begun = transaction.begin(); !begun) return begun.error();
  if (auto made = db.run(kTables); !made) return made.error();
  auto insert = db.prepare("INSERT INTO meta VALUES(?1, ?2, ?3, ?4, 0, 0, 0, 0)");
  if (!insert) return insert.error();
  Json parameters = Json::object();
  for (const auto& [name, value] : world.parameters) parameters[name] = value;
  const std::string text = parameters.dump();
  if (auto put = insert->run(std::string_view(world.terrain), std::int64_t{world.seed}, std::string_view(text), world.contentHash); !put)
    return put.error();
  return transaction.commit();
}

Outcome<void> Log::load() {
  Statements& s = *sql_;
  const std::pair<Statement*, const char*> all[] = {
      {&s.addEdit, "INSERT INTO edits VALUES(?1, ?2, ?3, ?4, ?5, ?6)"},
      {&s.readEdits, "SELECT number, key, author, time, edit, hash FROM edits WHERE number > ?1 ORDER BY number LIMIT ?2"},
      {&s.numberOf, "SELECT number FROM edits WHERE key = ?1 AND key <> ''"},
      {&s.hashOfTile, "SELECT hash FROM tiles WHERE i = ?1 AND j = ?2"},
      {&s.putTile, "INSERT OR REPLACE INTO tiles VALUES(?1, ?2, ?3, ?4)"},
      {&s.removeTile, "DELETE FROM tiles WHERE i = ?1 AND j = ?2"},
      {&s.readTiles, "SELECT i, j, tile, hash FROM tiles ORDER BY i, j"},
      {&s.readBase, "SELECT i, j, tile, hash FROM base_tiles ORDER BY i, j"},
      {&s.putMeta, "UPDATE meta SET compacted = ?1, tiles_of = ?2, tiles_hash = ?3, base_hash = ?4"}};
  for (const auto& [statement, sql] : all) {
    auto prepared = s.database.prepare(sql);
    if (!prepared) return prepared.error();
    *statement = std::move(*prepared);
  }
  auto meta = s.database.prepare("SELECT terrain, seed, parameters, content_hash, compacted, tiles_of, tiles_hash, base_hash FROM meta");
  if (!meta) return meta.error();
  Statement::Rows rows(*meta);
  const auto row = rows.next();
  if (!row) return row.error();
  const Json parameters = *row ? Json::parse(rows.text(2), nullptr, false) : Json();
  if (!parameters.is_object()) return damaged("it does not say of which world it is");
  world_ = {std::string(rows.text(0)), static_cast<std::uint32_t>(rows.integer(1)), {}, rows.number(3)};
  for (const auto& [name, value] : parameters.items())
    if (value.is_number()) world_.parameters.emplace_back(name, value.get<double>());
  compacted_ = rows.number(4);
  tilesOf_ = rows.number(5);
  tilesHash_ = rows.number(6);
  baseHash_ = rows.number(7);
  const auto first = s.database.integer("SELECT min(number) FROM edits"), last = s.database.integer("SELECT max(number) FROM edits");
  if (!first) return first.error();
  if (!last) return last.error();
  last_ = *last == 0 ? compacted_ : static_cast<std::uint64_t>(*last);
  if (*last != 0 && static_cast<std::uint64_t>(*first) != compacted_ + 1)
    return damaged("its edits begin with " + std::to_string(*first) + " instead of " + std::to_string(compacted_ + 1));
  return {};
}

Outcome<std::shared_ptr<const edits::Layer>> Log::layerIn(bool base) {
  Statement::Rows rows(base ? sql_->readBase : sql_->readTiles);
  std::vector<edits::Layer::Change> tiles;
  std::uint64_t sum = 0;
  for (;;) {
    const auto row = rows.next();
    if (!row) return row.error();
    if (!*row) break;
    const edits::TileAddress at{rows.integer(0), rows.integer(1)};
    const Bytes bytes = rows.bytes(2);
    const std::uint64_t hash = hashOf(at, bytes);
    auto tile = hash == rows.number(3) ? decodeTile(bytes) : nullptr;
    if (!tile)
      return damaged("the tile at post " + std::to_string(at.posts().x0) + ", " + std::to_string(at.posts().z0) + " has another hash");
    sum += hash;
    tiles.push_back({at, std::move(tile)});
  }
  if (sum != (base ? baseHash_ : tilesHash_)) return damaged("tiles are missing, or older than others");
  return edits::Layer().with(tiles);
}

Outcome<std::shared_ptr<const edits::Layer>> Log::layer() {
  if (tilesOf_ == last_) return layerIn(false);
  return damaged("its tiles are those of edit " + std::to_string(tilesOf_) + ", the last is " + std::to_string(last_));
}

Outcome<std::vector<Edit>> Log::read(std::uint64_t after, std::size_t most) {
  after = std::max(after, compacted_);
  Statement::Rows rows(sql_->readEdits, after, std::int64_t(most));
  std::vector<Edit> out;
  for (;;) {
    const auto row = rows.next();
    if (!row) return row.error();
    if (!*row) break;
    Edit edit{rows.number(0), std::string(rows.text(1)), std::string(rows.text(2)), rows.integer(3), {}};
    const std::uint64_t wanted = after + out.size() + 1;
    if (edit.number != wanted) return damaged("edit " + std::to_string(wanted) + " is missing");
    const std::string_view text = rows.text(4);
    if (hashOfEdit(edit, text) != rows.number(5)) return damaged("edit " + std::to_string(wanted) + " has another hash");
    auto operation = edits::fromJson(text);
    if (!operation) return damaged("edit " + std::to_string(wanted) + " cannot be read: " + operation.error().message);
    edit.operation = std::move(*operation);
    out.push_back(std::move(edit));
  }
  return out;
}

Outcome<edits::History::Past> Log::past(std::uint64_t after, std::uint64_t last) {
  edits::History::Past out;
  if (after == compacted_) {
    auto base = layerIn(true);
    if (!base) return base.error();
    out.base = std::move(*base);
  }
  constexpr std::uint64_t kAtATime = 64;  // so that the widest stamps take 16 MiB
  auto some = read(after, std::min(last - after, kAtATime));
  if (!some) return some.error();
  if (some->empty() && after < last) return damaged("edit " + std::to_string(after + 1) + " is missing");
  for (Edit& e : *some) out.operations.push_back(std::move(e.operation));
  return out;
}

std::optional<std::uint64_t> Log::numberOf(const std::string& key) {
  Statement::Rows rows(sql_->numberOf, std::string_view(key));
  const auto row = rows.next();
  return row && *row ? std::optional(rows.number(0)) : std::nullopt;
}

Outcome<void> Log::put(const Edit& edit) {
  const std::string text = edits::toJson(edit.operation);
  return sql_->addEdit.run(edit.number, std::string_view(edit.key), std::string_view(edit.author), edit.time, std::string_view(text),
                           hashOfEdit(edit, text));
}

Outcome<void> Log::put(edits::TileAddress at, const edits::Tile* tile, std::uint64_t& sum) {
  {
    Statement::Rows old(sql_->hashOfTile, at.i, at.j);
    const auto row = old.next();
    if (!row) return row.error();
    if (*row) sum -= old.number(0);
  }
  if (!tile) return sql_->removeTile.run(at.i, at.j);
  encodeTile(tile->posts(), sql_->bytes);
  const std::uint64_t hash = hashOf(at, sql_->bytes);
  sum += hash;
  return sql_->putTile.run(at.i, at.j, Bytes(sql_->bytes), hash);
}

Outcome<void> Log::putMeta(std::uint64_t tilesOf, std::uint64_t tilesHash) {
  return sql_->putMeta.run(compacted_, tilesOf, tilesHash, baseHash_);
}

Outcome<void> Log::append(std::span<const Edit> edits, const edits::Layer& before, const edits::Layer& after,
                          std::span<const edits::Posts> changed) {
  Transaction transaction(sql_->database);
  if (auto begun = transaction.begin(); !begun) return begun.error();
  std::uint64_t next = last_, sum = tilesHash_;
  for (const Edit& edit : edits) {
    if (edit.number != ++next)
      return Error{"Edit " + std::to_string(edit.number) + " does not follow edit " + std::to_string(next - 1) + "."};
    if (auto added = put(edit); !added) return added.error();
  }
  const bool isCached = tilesOf_ == last_;  // old tiles stay old, so that layer() notices
  if (isCached) {
    for (const edits::TileAddress at : tilesOf(changed)) {
      if (before.tile(at) == after.tile(at)) continue;
      const edits::Tile *const was = keptTile(before, at), *const is = keptTile(after, at);
      if (was == is || (was && is && *was == *is)) continue;
      if (auto done = put(at, is, sum); !done) return done.error();
    }
    if (auto done = putMeta(next, sum); !done) return done.error();
  }
  if (auto committed = transaction.commit(); !committed) return committed.error();
  last_ = next;
  if (isCached) tilesOf_ = next, tilesHash_ = sum;
  return {};
}

Outcome<void> Log::cache(const edits::Layer& layer) {
  Transaction transaction(sql_->database);
  if (auto begun = transaction.begin(); !begun) return begun.error();
  if (auto removed = sql_->database.run("DELETE FROM tiles"); !removed) return removed.error();
  std::uint64_t sum = 0;
  for (const edits::TileAddress at : layer.addresses())
    if (const edits::Tile* const tile = keptTile(layer, at))
      if (auto done = put(at, tile, sum); !done) return done.error();
  if (auto done = putMeta(last_, sum); !done) return done.error();
  if (auto committed = transaction.commit(); !committed) return committed.error();
  tilesOf_ = last_, tilesHash_ = sum;
  return {};
}

Outcome<void> Log::compact() {
  if (auto checked = layer(); !checked) return checked.error();
  Database& db = sql_->database;
  Transaction transaction(db);
  if (auto begun = transaction.begin(); !begun) return begun.error();
  if (auto moved = db.run("DELETE FROM base_tiles; INSERT INTO base_tiles SELECT * FROM tiles; DELETE FROM edits;"
                          "UPDATE meta SET compacted = tiles_of, base_hash = tiles_hash");
      !moved)
    return moved.error();
  if (auto committed = transaction.commit(); !committed) return committed.error();
  compacted_ = last_, baseHash_ = tilesHash_;
  return db.run("VACUUM; PRAGMA wal_checkpoint(TRUNCATE)");
}

Outcome<void> Log::backUp(const std::filesystem::path& to) {
  std::error_code failed;
  if (std::filesystem::exists(to, failed) || failed)
    return Error{"'" + to.string() + "' exists already, or its folder cannot be read; name a new file."};
  const std::filesystem::path unfinished = to.string() + ".new";
  std::filesystem::remove(unfinished, failed);
  {
    auto copy = Database::open(unfinished, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX);
    if (!copy) return copy.error();
    sqlite3_backup* const backup = sqlite3_backup_init(copy->handle(), "main", sql_->database.handle(), "main");
    if (!backup) return copy->error();
    sqlite3_backup_step(backup, -1);
    if (sqlite3_backup_finish(backup) != SQLITE_OK) return copy->error();
  }
  std::filesystem::rename(unfinished, to, failed);
  if (failed) return Error{"Cannot write '" + to.string() + "': " + failed.message() + "."};
  return {};
}

Outcome<void> Log::check() {
  auto statement = sql_->database.prepare("PRAGMA integrity_check(1)");
  if (!statement) return statement.error();
  Statement::Rows rows(*statement);
  const auto row = rows.next();
  if (!row) return row.error();
  if (!*row || rows.text(0) != "ok") return damaged(*row ? std::string(rows.text(0)) : "SQLite cannot check it");
  return {};
}

Outcome<void> checkTerrain(const Log& log, const terrain::Terrain& terrain) {
  const std::uint64_t hash = terrain::contentHash(terrain);
  if (hash == log.world().contentHash) return {};
  return Error{"The edits were made on terrain " + log.world().terrain + " with content hash " +
               text::hexadecimal(log.world().contentHash) + ", but this is " + std::string(terrain.name()) + " with " +
               text::hexadecimal(hash) + ": put the old terrain back, or begin a new log."};
}

Outcome<edits::History> historyOf(Log& log, std::shared_ptr<const terrain::Terrain> terrain, std::size_t mostBytes) {
  if (auto checked = checkTerrain(log, *terrain); !checked) return checked.error();
  edits::History history(std::move(terrain), mostBytes);
  auto cached = log.layer();
  history.restore(log.compacted(), log.last(), cached ? *cached : nullptr,
                  [&log, last = log.last()](std::uint64_t after) { return log.past(after, last); });
  if (cached) return history;
  if (auto replayed = history.replay(); !replayed) return replayed.error();
  if (auto repaired = log.cache(*history.layer()); !repaired) return repaired.error();
  return history;
}

}  // namespace ridgecast::edit_log
