#pragma once
// What members have done to a session's ground: takes edits in, gives them their numbers, and has the ground that follows from them.
//
//   ask() --> waits (kMostWaiting) --> paid for and applied by a task, all that wait together --> kept on disk, if the session has a log
//         --> everybody's ground, done(number), and the cameras are told
//
// An edit is acknowledged by its number, and not before it is on disk and in ground(). A session's edits are made by one task at a time:
// those that come meanwhile share the next write. An edit that is asked for again with its key is neither paid for nor made again: it has
// the number that it had, or joins the one that waits. Any thread, unless said otherwise.

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
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
  std::string key;     // of its author, without line feeds; what is asked again with its key is made once. Empty: none
  std::string author;  // edits::toText
  edits::Operation operation;
};

struct MadeEdit {
  std::uint64_t number = 0;
  Edit edit;
  lattice::Area ground;  // that it changed, at most
};

class Edits : public std::enable_shared_from_this<Edits> {
 public:
  static constexpr std::size_t kMostWaiting = 256, kMostWaitingOfOne = kMostWaiting / 2;  // of one client that pays
  static constexpr std::size_t kRecent = 4096;                                            // edits whose areas and keys are remembered
  static constexpr std::size_t kMostAreas = 64;

  // Where edits are kept: a log, or how to make one for the first edit; neither: in memory alone.
  struct Kept {
    std::shared_ptr<const void> held;  // let go of when the log is closed
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

  // The edit's number, or one sentence: why it was not made.
  struct Answer : Outcome<std::uint64_t> {
    using Outcome<std::uint64_t>::result;
    bool isForNow = false;  // refused because too much waits, or is not paid for yet: the same may be asked again
  };
  // `posts`: how many that took; 0 of an edit that was made before. Called by the editing task, or at once when too many wait or the key
  // says all.
  using Done = std::function<void(const Answer& number, std::uint64_t posts)>;
  // Error: it is too early. Called by the editing task when it is this edit's turn; none: it costs nothing.
  using Pay = std::function<Outcome<void>(const edits::Operation& operation)>;
  // One edit has as many `done` as it was asked for meanwhile; whoever asks bounds that.
  void ask(Edit edit, Done done, Pay pay = {});

  // The edits after a number, in order, at most `most`; called by the editing task.
  using Read = std::function<void(Outcome<std::vector<MadeEdit>> edits)>;
  void read(std::uint64_t after, std::size_t most, Read read);

  // The session is over: what has not begun is refused, and what comes later. The editing task closes the log.
  void end();
  bool isOver() const;

 private:
  struct Waiting {
    Waiting(Edit e, Pay p) : edit(std::move(e)), pay(std::move(p)) {}
    const Edit edit;  // with the whole key: the author's text, a line feed, and the author's key
    const Pay pay;
    std::vector<Done> done;  // of the same edit
    // Of the editing task.
    Answer answer{0};
    std::uint64_t posts = 0;
  };
  struct Reading {
    std::uint64_t after = 0;
    std::size_t most = 0;
    Read read;
  };
  void makeAll();
  void readAll();
  std::optional<Answer> atOnce(const Edit& edit, bool pays, Done& done);  // under the lock; takes `done` where it joins
  std::optional<Answer> known(const Edit& edit);                          // from the log
  Answer make(const Waiting& waiting, std::vector<MadeEdit>& made);
  Outcome<void> keep(const std::vector<MadeEdit>& made, const edits::Layer& before);  // on disk
  Error told(Error e);  // to the operator, once while the same is wrong, with the folder, of which clients do not hear
  Outcome<std::vector<MadeEdit>> list(std::uint64_t after, std::size_t most);

  const std::shared_ptr<const terrain::Terrain> terrain_;
  const std::shared_ptr<scheduling::Pool> pool_;
  const std::function<void()> changed_;
  const Made noted_;

  // Of the editing task.
  Kept kept_;
  edits::History history_;
  const std::uint64_t begins_;              // the last edit of the log when this began
  std::string trouble_;                     // of the log, since an edit was last kept
  std::vector<edits::Posts> changedPosts_;  // of the edits that are being made

  mutable std::mutex mutex_;
  Ground ground_;
  std::deque<lattice::Area> areas_;                      // of the last edits, up to ground_.edit
  std::vector<MadeEdit> made_;                           // after begins_, up to ground_.edit; the editing task alone adds to it
  std::unordered_map<std::string, std::uint64_t> keys_;  // of made_, to the number of the edit
  std::vector<std::shared_ptr<Waiting>> waiting_;
  std::unordered_map<std::string, std::shared_ptr<Waiting>> open_;  // those with a key that wait or are being made
  std::vector<Reading> readings_;
  bool isOver_ = false;
};

}  // namespace ridgecast::session
