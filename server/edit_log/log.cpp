#include "server/edit_log/log.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/edits/json.h"
#include "common/edits/packed.h"
#include "common/outcome/contract.h"
#include "common/text/text.h"
#include "server/edit_log/database.h"
#include "server/edit_log/entry.h"
#include "server/edit_log/tiles.h"

namespace ridgecast::edit_log {
namespace {

using Json = nlohmann::json;

constexpr std::int64_t kApplicationId = 0x52434544;  // "RCED", in the file's header
constexpr std::int64_t kVersion = 2;

constexpr const char* kEditsTable = R"(
  CREATE TABLE edits(number INTEGER PRIMARY KEY, key TEXT, author TEXT, time INTEGER, edit BLOB,
                     x0 INTEGER, z0 INTEGER, x1 INTEGER, z1 INTEGER, hash INTEGER) STRICT;
  CREATE UNIQUE INDEX edits_by_key ON edits(key) WHERE key <> '')";

constexpr const char* kTables = R"(
  CREATE TABLE meta(terrain TEXT, seed INTEGER, parameters TEXT, content_hash INTEGER,
                    compacted INTEGER, tiles_of INTEGER, tiles_hash INTEGER, base_hash INTEGER, bytes INTEGER) STRICT;
  CREATE TABLE tiles(i INTEGER, j INTEGER, tile BLOB, hash INTEGER, PRIMARY KEY(i, j)) WITHOUT ROWID, STRICT;
  CREATE TABLE base_tiles(i INTEGER, j INTEGER, tile BLOB, hash INTEGER, PRIMARY KEY(i, j)) WITHOUT ROWID, STRICT;
  PRAGMA application_id = 0x52434544; PRAGMA user_version = 2)";

constexpr const char* kAddEdit = "INSERT INTO edits VALUES(?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)";

Bytes bytesOf(std::string_view text) { return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}; }

// `operation`: as the file has it.
std::uint64_t hashOfVersion1(const Applied& edit, std::string_view operation) {
  std::uint64_t hash = lattice::mix(edit.number + lattice::mix(static_cast<std::uint64_t>(edit.time)));
  for (const std::string_view text : {std::string_view(edit.key), std::string_view(edit.author), operation})
    hash = hashOfBytes(bytesOf(text), hash);
  return hash;
}

// In the first logs, whose servers knew their clients by their names alone, a key was the name, a line feed and the client's own key.
bool isOfANameAlone(std::string_view key) {
  return std::ranges::count(key, '\n') == 1 && !key.starts_with("token of ") && !key.starts_with("address ");
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

Error Log::damaged(const std::string& what) const { return {"'" + sql_->database.name() + "' is damaged: " + what + "."}; }

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
  if (std::filesystem::status(log->lock_->log(), unknown).type() == std::filesystem::file_type::not_found) return std::unique_ptr<Log>();
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
    return Error{"'" + log->sql_->database.name() + "' has edits already; the session must be joined again to go on with them."};
  if (auto created = log->makeTables(world); !created) return created.error();
  if (auto loaded = log->load(); !loaded) return loaded.error();
  return log;
}

Outcome<std::unique_ptr<Log>> Log::temporary() {
  std::unique_ptr<Log> log(new Log(nullptr));
  auto database = Database::open({}, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX);
  if (!database) return database.error();
  log->sql_->database = std::move(*database);
  if (auto set = log->sql_->database.run("PRAGMA journal_mode = MEMORY; PRAGMA synchronous = OFF; PRAGMA cache_size = -512"); !set)
    return set.error();
  if (auto created = log->makeTables({}); !created) return created.error();
  if (auto loaded = log->load(); !loaded) return loaded.error();
  return log;
}

Outcome<bool> Log::connect(int flags) {
  expects(lock_ != nullptr, "a log is opened by who holds its lock");
  const std::filesystem::path& file = lock_->log();
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
  if (isThere && (*version < 1 || *version > kVersion))
    return Error{name + " is a log of edits of version " + std::to_string(*version) + "; this program reads versions 1 to " +
                 std::to_string(kVersion) + "."};
  // Only the first write locks out others.
  if (auto set = db.run("PRAGMA journal_mode = WAL; BEGIN EXCLUSIVE; COMMIT"); !set) return set.error();
  if (isThere && *version == 1)
    if (auto done = bringUpToDate(); !done) return done.error();
  return isThere;
}

Outcome<void> Log::makeTables(const World& world) {
  Database& db = sql_->database;
  Transaction transaction(db);
  if (auto begun = transaction.begin(); !begun) return begun.error();
  for (const char* const tables : {kEditsTable, kTables})
    if (auto made = db.run(tables); !made) return made.error();
  auto insert = db.prepare("INSERT INTO meta VALUES(?1, ?2, ?3, ?4, 0, 0, 0, 0, 0)");
  if (!insert) return insert.error();
  Json parameters = Json::object();
  for (const auto& [name, value] : world.parameters) parameters[name] = value;
  const std::string text = parameters.dump();
  if (auto put = insert->run(std::string_view(world.terrain), std::int64_t{world.seed}, std::string_view(text), world.contentHash); !put)
    return put.error();
  return transaction.commit();
}

Outcome<void> Log::bringUpToDate() {
  Database& db = sql_->database;
  Transaction transaction(db);
  if (auto begun = transaction.begin(); !begun) return begun.error();
  for (const char* const change : {"DROP INDEX edits_by_key; ALTER TABLE edits RENAME TO edits_of_version_1;"
                                   "ALTER TABLE meta ADD COLUMN bytes INTEGER NOT NULL DEFAULT 0",
                                   kEditsTable})
    if (auto made = db.run(change); !made) return made.error();
  std::uint64_t sum = 0;
  {
    auto select = db.prepare("SELECT number, key, author, time, edit, hash FROM edits_of_version_1 ORDER BY number");
    if (!select) return select.error();
    auto insert = db.prepare(kAddEdit);
    if (!insert) return insert.error();
    sql_->addEdit = std::move(*insert);
    Statement::Rows rows(*select);
    for (;;) {
      const auto row = rows.next();
      if (!row) return row.error();
      if (!*row) break;
      Applied edit{rows.number(0), std::string(rows.text(1)), std::string(rows.text(2)), rows.integer(3), {}, {}};
      const std::string which = "edit " + std::to_string(edit.number);
      if (hashOfVersion1(edit, rows.text(4)) != rows.number(5)) return damaged(which + " has another hash");
      const auto operation = edits::fromJson(rows.text(4));
      if (!operation) return damaged(which + " cannot be read: " + operation.error().message);
      edit.operation = edits::pack(*operation);
      if (isOfANameAlone(edit.key)) edit.key = '\n' + edit.key;
      const edits::Posts posts = edits::areaOf(*operation);
      edit.ground = posts.empty() ? edit_store::kEverywhere : edits::groundOf(posts);  // of an undo nobody knows
      sum += edit.bytes();
      if (auto added = put(edit); !added) return added.error();
    }
  }
  sql_->addEdit = Statement();
  if (auto dropped =
          db.run(("DROP TABLE edits_of_version_1; UPDATE meta SET bytes = " + std::to_string(sum) + "; PRAGMA user_version = 2").c_str());
      !dropped)
    return dropped.error();
  return transaction.commit();
}

Outcome<void> Log::load() {
  Statements& s = *sql_;
  const std::pair<Statement*, const char*> all[] = {
      {&s.addEdit, kAddEdit},
      {&s.readEdits, "SELECT * FROM edits WHERE number > ?1 ORDER BY number"},
      {&s.numberOf, "SELECT number FROM edits WHERE key = ?1 AND key <> ''"},
      {&s.hashOfTile, "SELECT hash FROM tiles WHERE i = ?1 AND j = ?2"},
      {&s.putTile, "INSERT OR REPLACE INTO tiles VALUES(?1, ?2, ?3, ?4)"},
      {&s.removeTile, "DELETE FROM tiles WHERE i = ?1 AND j = ?2"},
      {&s.readTiles, "SELECT i, j, tile, hash FROM tiles ORDER BY i, j"},
      {&s.readBase, "SELECT i, j, tile, hash FROM base_tiles ORDER BY i, j"},
      {&s.putMeta, "UPDATE meta SET compacted = ?1, tiles_of = ?2, tiles_hash = ?3, base_hash = ?4, bytes = ?5"}};
  for (const auto& [statement, sql] : all) {
    auto prepared = s.database.prepare(sql);
    if (!prepared) return prepared.error();
    *statement = std::move(*prepared);
  }
  auto meta =
      s.database.prepare("SELECT terrain, seed, parameters, content_hash, compacted, tiles_of, tiles_hash, base_hash, bytes FROM meta");
  if (!meta) return meta.error();
  Statement::Rows rows(*meta);
  const auto row = rows.next();
  if (!row) return row.error();
  const Json parameters = *row ? Json::parse(rows.text(2), nullptr, false) : Json();
  if (!parameters.is_object()) return damaged("it does not say of which world it is");
  world_ = {std::string(rows.text(0)), static_cast<std::uint32_t>(rows.integer(1)), {}, rows.number(3)};
  for (const auto& [name, value] : parameters.items())
    if (value.is_number()) world_.parameters.emplace_back(name, value.get<double>());
  meta_ = {rows.number(4), rows.number(5), rows.number(6), rows.number(7), rows.number(8)};
  const auto first = s.database.integer("SELECT min(number) FROM edits"), last = s.database.integer("SELECT max(number) FROM edits");
  if (!first) return first.error();
  if (!last) return last.error();
  last_ = *last == 0 ? meta_.compacted : static_cast<std::uint64_t>(*last);
  if (*last != 0 && static_cast<std::uint64_t>(*first) != meta_.compacted + 1)
    return damaged("its edits begin with " + std::to_string(*first) + " instead of " + std::to_string(meta_.compacted + 1));
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
  if (sum != (base ? meta_.baseHash : meta_.tilesHash)) return damaged("tiles are missing, or older than others");
  return edits::Layer().with(tiles);
}

std::uint64_t Log::last() const {
  const std::lock_guard lock(mutex_);
  return last_;
}

std::uint64_t Log::compacted() const {
  const std::lock_guard lock(mutex_);
  return meta_.compacted;
}

std::uint64_t Log::bytes() const {
  const std::lock_guard lock(mutex_);
  return meta_.bytes;
}

Outcome<std::shared_ptr<const edits::Layer>> Log::layer() {
  const std::lock_guard lock(mutex_);
  if (meta_.tilesOf == last_) return layerIn(false);
  return damaged("its tiles are those of edit " + std::to_string(meta_.tilesOf) + ", the last is " + std::to_string(last_));
}

Outcome<std::vector<Applied>> Log::read(std::uint64_t after, std::size_t most) {
  const std::lock_guard lock(mutex_);
  return readNow(after, most);
}

Outcome<std::vector<Applied>> Log::readNow(std::uint64_t after, std::size_t most) {
  after = std::max(after, meta_.compacted);
  Statement::Rows rows(sql_->readEdits, after);
  std::vector<Applied> out;
  for (std::size_t bytes = 0;;) {
    const auto row = rows.next();
    if (!row) return row.error();
    if (!*row) break;
    Applied edit{rows.number(0),  std::string(rows.text(1)), std::string(rows.text(2)),
                 rows.integer(3), std::string(rows.text(4)), {rows.integer(5), rows.integer(6), rows.integer(7), rows.integer(8)}};
    bytes += edit.bytes();
    if (bytes > most && !out.empty()) break;
    const std::uint64_t wanted = after + out.size() + 1;
    if (edit.number != wanted) return damaged("edit " + std::to_string(wanted) + " is missing");
    if (identityOf(edit) != rows.number(9)) return damaged("edit " + std::to_string(wanted) + " has another hash");
    out.push_back(std::move(edit));
  }
  return out;
}

Outcome<edits::History::Past> Log::past(std::uint64_t after, std::uint64_t last) {
  expects(after <= last, "what is past has been");
  const std::lock_guard lock(mutex_);
  edits::History::Past out;
  if (after == meta_.compacted) {
    auto base = layerIn(true);
    if (!base) return base.error();
    out.base = std::move(*base);
  }
  constexpr std::size_t kAtATime = 64;  // so that the widest stamps take 16 MiB
  const auto some = readNow(after, 64u << 10);
  if (!some) return some.error();
  if (some->empty() && after < last) return damaged("edit " + std::to_string(after + 1) + " is missing");
  for (const Applied& edit : *some) {
    if (edit.number > last || out.operations.size() == kAtATime) break;
    auto operation = edits::unpack(edit.operation);
    if (!operation) return damaged("edit " + std::to_string(edit.number) + " cannot be read: " + operation.error().message);
    out.operations.push_back(std::move(*operation));
  }
  return out;
}

Outcome<std::optional<std::uint64_t>> Log::numberOf(const std::string& key) {
  const std::lock_guard lock(mutex_);
  Statement::Rows rows(sql_->numberOf, std::string_view(key));
  const auto row = rows.next();
  if (!row) return row.error();
  return *row ? std::optional(rows.number(0)) : std::nullopt;
}

Outcome<void> Log::put(const Applied& edit) {
  return sql_->addEdit.run(edit.number, std::string_view(edit.key), std::string_view(edit.author), edit.time, bytesOf(edit.operation),
                           edit.ground.x0, edit.ground.z0, edit.ground.x1, edit.ground.z1, identityOf(edit));
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

Outcome<void> Log::putMeta(const Meta& meta) {
  return sql_->putMeta.run(meta.compacted, meta.tilesOf, meta.tilesHash, meta.baseHash, meta.bytes);
}

Outcome<void> Log::append(std::span<const Applied> edits, const Change& change) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(sql_->database);
  if (auto begun = transaction.begin(); !begun) return begun.error();
  std::uint64_t next = last_;
  Meta meta = meta_;
  for (const Applied& edit : edits) {
    if (edit.number != ++next)
      return Error{"Edit " + std::to_string(edit.number) + " does not follow edit " + std::to_string(next - 1) + "."};
    if (auto added = put(edit); !added) return added.error();
    meta.bytes += edit.bytes();
  }
  if (lock_ && meta_.tilesOf == last_) {  // otherwise old tiles stay old, so that layer() notices
    meta.tilesOf = next;
    for (const edits::TileAddress at : tilesOf(change.posts)) {
      if (change.before.tile(at) == change.after.tile(at)) continue;
      const edits::Tile *const was = keptTile(change.before, at), *const is = keptTile(change.after, at);
      if (was == is || (was && is && *was == *is)) continue;
      if (auto done = put(at, is, meta.tilesHash); !done) return done.error();
    }
  }
  if (auto done = putMeta(meta); !done) return done.error();
  if (auto committed = transaction.commit(); !committed) return committed.error();
  last_ = next;
  meta_ = meta;
  return {};
}

Outcome<void> Log::cache(const edits::Layer& layer) {
  expects(lock_ != nullptr, "a temporary log keeps no tiles");
  const std::lock_guard lock(mutex_);
  Transaction transaction(sql_->database);
  if (auto begun = transaction.begin(); !begun) return begun.error();
  if (auto removed = sql_->database.run("DELETE FROM tiles"); !removed) return removed.error();
  Meta meta = meta_;
  meta.tilesOf = last_, meta.tilesHash = 0;
  for (const edits::TileAddress at : layer.addresses())
    if (const edits::Tile* const tile = keptTile(layer, at))
      if (auto done = put(at, tile, meta.tilesHash); !done) return done.error();
  if (auto done = putMeta(meta); !done) return done.error();
  if (auto committed = transaction.commit(); !committed) return committed.error();
  meta_ = meta;
  return {};
}

Outcome<void> Log::compact() {
  if (auto checked = layer(); !checked) return checked.error();
  const std::lock_guard lock(mutex_);
  Database& db = sql_->database;
  Transaction transaction(db);
  if (auto begun = transaction.begin(); !begun) return begun.error();
  if (auto moved = db.run("DELETE FROM base_tiles; INSERT INTO base_tiles SELECT * FROM tiles; DELETE FROM edits;"
                          "UPDATE meta SET compacted = tiles_of, base_hash = tiles_hash, bytes = 0");
      !moved)
    return moved.error();
  if (auto committed = transaction.commit(); !committed) return committed.error();
  meta_.compacted = last_, meta_.baseHash = meta_.tilesHash, meta_.bytes = 0;
  return db.run("VACUUM; PRAGMA wal_checkpoint(TRUNCATE)");
}

Outcome<void> Log::backUp(const std::filesystem::path& to) {
  std::error_code failed;
  if (std::filesystem::exists(to, failed) || failed)
    return Error{"'" + to.string() + "' exists already, or its folder cannot be read; name a new file."};
  const std::filesystem::path unfinished = to.string() + ".new";
  std::filesystem::remove(unfinished, failed);
  {
    const std::lock_guard lock(mutex_);
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

Outcome<std::string> Log::copy(std::size_t most) {
  if (!lock_) return Error{"The edits of this session are kept in no file."};
  const std::lock_guard lock(mutex_);
  Database& db = sql_->database;
  const auto pages = db.integer("PRAGMA page_count"), page = db.integer("PRAGMA page_size");
  if (!pages || !page) return db.error();
  if (static_cast<std::uint64_t>(*pages) > most / static_cast<std::uint64_t>(*page))
    return Error{"'" + db.name() + "' has more than " + std::to_string(most >> 20) + " MiB; stop the server, and copy it then."};
  sqlite3_int64 size = 0;
  const std::unique_ptr<unsigned char, void (*)(void*)> bytes(sqlite3_serialize(db.handle(), "main", &size, 0), sqlite3_free);
  if (!bytes) return db.error();
  return Outcome<std::string>(boost::system::in_place_value, reinterpret_cast<const char*>(bytes.get()), static_cast<std::size_t>(size));
}

Outcome<void> Log::check() {
  const std::lock_guard lock(mutex_);
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
