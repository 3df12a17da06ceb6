#pragma once
// What members were told of the ground, and whether the log on the disk and a replay of it say the same.

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/edits/history.h"
#include "common/edits/operation.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"
#include "server/bus/bus.h"
#include "server/map/sheet.h"

namespace ridgecast::simulation {

class Truth {
 public:
  // Of this session.
  Truth(std::shared_ptr<const terrain::Terrain> terrain, std::string session);

  // What a member hears. `asked`: nothing for a liar's edit, of which only the author is known.
  struct Asked {
    std::string key;
    edits::Operation operation;
  };
  void acknowledged(std::uint64_t number, const std::string& author, const std::optional<Asked>& asked);
  void refused(const std::string& author, const std::string& key);  // an edit that was sent once
  void told(const wire::MadeEdit& made);
  void answered(const wire::Query& query, const wire::Answer& answer);
  void answered(const wire::AskGround& ask, const wire::Ground& ground);
  void answered(const map::Sheet& sheet, std::uint64_t edit, const std::string& etag, std::string file);  // a tile of heights
  void knows(std::uint64_t edit);                                                                         // a mesh or an answer
  // The last edit of which anybody knows, as far as the servers' engine has not lost it.
  std::uint64_t known() const { return shared_ ? std::min<std::uint64_t>(known_, shared_().size()) : known_; }
  void loseEnd() { ++lostEnds_; }  // of the shared log
  std::uint64_t lostEnds() const { return lostEnds_; }

  // While no server runs: reads the log in this folder, as SQLite sees it without the product, and judges all of the above and the log's
  // cached tiles by its edits.
  void judge(const std::filesystem::path& folder);
  // The same where several servers share the log: this is all of it. Nothing else says what the edits are.
  using Shared = std::function<std::vector<bus::Entry>()>;
  void follow(Shared log) { shared_ = std::move(log); }
  void judgeShared();
  // A server's copy in this folder, while it does not run: some of the log, from its beginning.
  void judgeCopy(const std::filesystem::path& folder) const;
  // As of an edit of the shared log; null: the log has it no more, or not yet.
  std::shared_ptr<const edits::Layer> layer(std::uint64_t edit);
  // Of the log when it was judged.
  std::uint64_t last() const { return log_.size(); }
  std::vector<std::uint64_t> counting() const;         // edits that are not undone, and no undos
  std::shared_ptr<const edits::Layer> ground() const;  // from a new history of those alone
  std::uint64_t acknowledgements() const { return acked_.size(); }

 private:
  struct Entry {
    std::string author, key, json;
    edits::Operation operation;
    friend bool operator==(const Entry&, const Entry&) = default;
  };
  struct Answered {
    wire::Query query;
    wire::Answer answer;
  };
  struct Meshed {
    wire::AskGround ask;
    wire::Ground ground;
  };
  struct Mapped {
    map::Sheet sheet;
    std::uint64_t edit = 0;
    std::string file;
  };
  using Tiles = std::map<edits::TileAddress, std::shared_ptr<const edits::Tile>>;
  struct Log {
    std::vector<Entry> edits;
    Tiles tiles;  // of the layer that they make
  };
  Log read(const std::filesystem::path& folder) const;
  void judgeEdits() const;
  void judgeTiles(const Tiles& tiles, std::size_t last) const;
  void add(std::vector<Entry> log);
  void makeNext();
  void judgeAnswers();
  void judgeAnswer(const Answered& answered) const;
  void judgeGround(const Meshed& meshed) const;
  void judgeMap(const Mapped& mapped) const;
  void judgeArea(const wire::MadeEdit& made) const;

  const std::shared_ptr<const terrain::Terrain> terrain_;
  const std::string session_;
  std::map<std::uint64_t, std::pair<std::string, std::optional<Asked>>> acked_;
  std::map<std::string, std::uint64_t> numbers_;  // by author and key
  std::set<std::string> refused_;
  std::map<std::uint64_t, wire::MadeEdit> told_;
  std::vector<Answered> answers_;
  std::vector<Meshed> grounds_;
  std::vector<Mapped> mapped_;
  std::map<std::string, std::string> files_;  // by ETag
  std::uint64_t known_ = 0, lostEnds_ = 0;

  Shared shared_;
  std::vector<Entry> log_;
  edits::History history_;
  std::vector<std::shared_ptr<const edits::Layer>> layers_;  // as of each edit; first the empty one
  std::vector<edits::Posts> changed_;                        // by each edit
};

}  // namespace ridgecast::simulation
