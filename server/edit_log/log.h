#pragma once
// A session's edits on disk: an SQLite file with all edits in order, which are authoritative, and a cache of the layer that they make, tile
// by tile. Once append() has returned, its edits survive a power loss; an edit whose append() was interrupted is there whole or not at all.
//
// Any thread. One program at a time has a file (lock.h). Only SQLite opens it: closing any other descriptor of it would
// release SQLite's own locks. Edits and tiles carry hashes, so that damage is detected.
//
// Tables: meta (one row: the world, the last compacted edit, the edit up to which the tiles are made, the sums of the tiles' hashes, the
// bytes of all edits), edits (as edit_store::Applied), tiles, and base_tiles: what compacted edits have made. In files of version 1, edits
// are JSON and do not say what ground they changed; opening such a file makes it one of version 2, in one transaction. Keys that belonged
// to a name, whose client is unknown, then begin with a line feed.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/edits/history.h"
#include "common/edits/layer.h"
#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "server/edit_log/lock.h"
#include "server/edit_store/store.h"

namespace ridgecast::edit_log {

// What the edits are made on: terrain and parameters by name, and terrain::contentHash of it all.
struct World {
  std::string terrain;
  std::uint32_t seed = 1;
  std::vector<std::pair<std::string, double>> parameters;  // those that differ from the terrain's defaults
  std::uint64_t contentHash = 0;
  friend bool operator==(const World&, const World&) = default;
};

using edit_store::Applied;
using edit_store::Change;

class Log final : public edit_store::Store {
 public:
  // Null: there is no file, or its creation was interrupted and it is empty. Error: one sentence, which names no folder: not a log, another
  // version, damaged, in use, cannot be written.
  static Outcome<std::unique_ptr<Log>> open(std::shared_ptr<const Lock> lock);
  static Outcome<std::unique_ptr<Log>> open(const std::filesystem::path& file);  // takes the lock too
  // A new log. Error: also if there is one.
  static Outcome<std::unique_ptr<Log>> create(std::shared_ptr<const Lock> lock, const World& world);
  static Outcome<std::unique_ptr<Log>> create(const std::filesystem::path& file, const World& world);
  // A new one without a name or a world, deleted with this object. It keeps no tiles. SQLite holds half a MiB of it in memory, and the rest
  // in a file in SQLITE_TMPDIR, TMPDIR, /var/tmp, /usr/tmp or /tmp, whichever is writable.
  static Outcome<std::unique_ptr<Log>> temporary();
  ~Log() override;

  const World& world() const { return world_; }  // the file's own
  std::uint64_t last() const override;
  std::uint64_t compacted() const override;  // of the last edit that compact() took; 0: none
  std::uint64_t bytes() const override;

  // One transaction, on disk when it returns: these edits, and the tiles in which the change differs. Error: nothing of it is kept.
  Outcome<void> append(std::span<const Applied> edits, const Change& change) override;
  // Error: one is damaged or missing.
  Outcome<std::vector<Applied>> read(std::uint64_t after, std::size_t most) override;
  Outcome<std::optional<std::uint64_t>> numberOf(const std::string& key) override;

  // The layer as of last(), from its cached tiles. Error: one is missing or damaged, or they are older than last(); then replay.
  Outcome<std::shared_ptr<const edits::Layer>> layer();
  // Some edits from after `after` up to `last`; with those after compacted() the base.
  Outcome<edits::History::Past> past(std::uint64_t after, std::uint64_t last);

  // Rewrites the tiles from the layer as of last().
  Outcome<void> cache(const edits::Layer& layer);
  // Makes the layer the base; the edits that made it are deleted, and numbers continue. Error: as of layer().
  Outcome<void> compact();
  Outcome<std::string> copy(std::size_t most) override;
  // A copy in one piece, while the log stays open. Error: `to` exists, or cannot be written.
  Outcome<void> backUp(const std::filesystem::path& to);
  // Error: SQLite's own check of the file found something.
  Outcome<void> check();

 private:
  struct Statements;
  struct Meta {
    std::uint64_t compacted = 0;
    std::uint64_t tilesOf = 0;                  // the edit up to which the tiles are made
    std::uint64_t tilesHash = 0, baseHash = 0;  // sums
    std::uint64_t bytes = 0;
  };
  explicit Log(std::shared_ptr<const Lock> lock);
  Outcome<bool> connect(int flags);  // whether anything is in it
  Outcome<void> makeTables(const World& world);
  Outcome<void> bringUpToDate();
  Outcome<void> load();
  Outcome<std::vector<Applied>> readNow(std::uint64_t after, std::size_t most);  // under the lock, as all below
  Outcome<std::shared_ptr<const edits::Layer>> layerIn(bool base);
  Outcome<void> put(const Applied& edit);
  Outcome<void> put(edits::TileAddress address, const edits::Tile* tile, std::uint64_t& sum);
  Outcome<void> putMeta(const Meta& meta);
  Error damaged(const std::string& what) const;

  const std::shared_ptr<const Lock> lock_;  // until SQLite has closed the file; null: a temporary one
  mutable std::mutex mutex_;
  std::unique_ptr<Statements> sql_;
  World world_;
  std::uint64_t last_ = 0;
  Meta meta_;
};

// The log's history on this terrain, from the cached tiles or, if they are unusable, from the edits; then the cache is repaired. The log
// must outlive it. Error: one sentence; the terrain is not the log's.
Outcome<edits::History> historyOf(Log& log, std::shared_ptr<const terrain::Terrain> terrain, std::size_t mostBytes = edits::kMaxLayerBytes);
// Error: a terrain with another contentHash; the sentence says both.
Outcome<void> checkTerrain(const Log& log, const terrain::Terrain& terrain);

}  // namespace ridgecast::edit_log
