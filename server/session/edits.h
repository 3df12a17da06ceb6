#pragma once
// What members have done to a session's ground: takes edits in, gives them their numbers, and has the ground that follows from them.
//
//   ask() --> waits (kMostWaiting) --> applied by a task, all that wait together --> kept on disk, if the session has a log
//         --> everybody's ground, done(number), and the cameras are told
//
// An edit is acknowledged by its number, and not before it is on disk and in ground(). A session's edits are made by one task at a time:
// those that come meanwhile share the next write. Any thread, unless said otherwise.

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "common/edits/history.h"
#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "server/edit_log/log.h"
#include "server/scheduling/pool.h"

namespace ridgecast::session {

// The ground as of an edit; 0: the terrain's own.
struct Ground {
  std::shared_ptr<const terrain::Terrain> terrain;
  std::uint64_t edit = 0;
};

struct Edit {
  std::string key;     // of its author; what is asked again with its key is made once. Empty: none
  std::string author;  // for people
  edits::Operation operation;
};

struct MadeEdit {
  std::uint64_t number = 0;
  Edit edit;
  lattice::Area ground;  // that it changed, at most
};

class Edits : public std::enable_shared_from_this<Edits> {
 public:
  static constexpr std::size_t kMostWaiting = 256;
  static constexpr std::size_t kRecent = 4096;  // edits whose areas and keys are remembered
  static constexpr std::size_t kMostAreas = 64;

  // Where edits are kept: a log, or how to make one for the first edit; neither: in memory alone.
  struct Kept {
    std::unique_ptr<edit_log::Log> log;
    std::optional<edits::History> history;  // the log's
    std::function<Outcome<std::unique_ptr<edit_log::Log>>()> makeLog;
  };
  // `changed` is called by the editing task after each change of the ground, `made` by it for each edit that is kept, before anybody has
  // its ground. `executor` as Resources::executor.
  using Made = std::function<void(const MadeEdit&)>;
  Edits(std::shared_ptr<const terrain::Terrain> terrain, scheduling::Executor* executor, std::function<void()> changed, Kept kept,
        Made made = {});

  std::uint64_t compacted() const { return history_.compacted(); }  // never changes
  Ground ground() const;
  // The ground now, and where it differs from that of `edit`: at most kMostAreas.
  struct News {
    Ground ground;
    std::vector<lattice::Area> changed;
  };
  News since(std::uint64_t edit) const;

  // The edit's number, or one sentence: why it was not made; and how many posts that took. Called by the editing task, or at once when too
  // many wait.
  using Done = std::function<void(const Outcome<std::uint64_t>& number, std::uint64_t posts)>;
  void ask(Edit edit, Done done);

  // The edits after a number, in order, at most `most`; called by the editing task.
  using Read = std::function<void(Outcome<std::vector<MadeEdit>> edits)>;
  void read(std::uint64_t after, std::size_t most, Read read);

 private:
  struct Waiting {
    Edit edit;
    Done done;
  };
  struct Reading {
    std::uint64_t after = 0;
    std::size_t most = 0;
    Read read;
  };
  void makeAll();
  void readAll();
  Outcome<std::uint64_t> make(Edit edit);
  Outcome<void> keep(std::uint64_t before, const edits::Layer& layer);  // on disk, what was made after `before`
  Outcome<std::vector<MadeEdit>> list(std::uint64_t after, std::size_t most);

  const std::shared_ptr<const terrain::Terrain> terrain_;
  const std::shared_ptr<scheduling::Pool> pool_;
  const std::function<void()> changed_;
  const Made noted_;

  // Of the editing task.
  Kept kept_;
  edits::History history_;
  std::uint64_t begins_;                                 // the last edit of the log when this began
  std::vector<MadeEdit> made_;                           // since then
  std::vector<edits::Posts> changedPosts_;               // of the edits that are being made
  std::unordered_map<std::string, std::uint64_t> keys_;  // of made_, to the number of the edit

  mutable std::mutex mutex_;
  Ground ground_;
  std::deque<lattice::Area> areas_;  // of the last edits, up to ground_.edit
  std::vector<Waiting> waiting_;
  std::vector<Reading> readings_;
};

}  // namespace ridgecast::session
