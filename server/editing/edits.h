#pragma once
// What members have done to a session's ground: takes edits in, numbers them, and has the resulting ground.
//
//   ask() --> waits (kMaxWaiting, until it is answered) --> its key is looked up (disk) --> paid for and made, in turns
//         --> kept, with those made before it in one write (disk) --> everybody's ground, done(number), and the cameras are told
//
// An edit is acknowledged by its number, once it is stored and in ground(). Edits that arrive while a group is in progress form the next
// group. Edits wait their turn as all work does, and only the disk's thread waits for the disk. An edit repeated with its key is neither
// paid for nor made again: it has the number that it had, or joins the one that waits. Any thread, unless said otherwise.
//
// With other servers of the same session, their order (edit_order.h) decides: a group that is made is appended to the log that they share
// before it is kept. If others came first, it is taken back, their edits are applied, and its keys are looked up and it is made again on
// that ground. Others' edits are applied, kept and published as own ones, a page at a time, while no group is under way. An edit that
// cannot be made is refused for that only where the log ends. While the engine is away, edits are refused for now, and the ground stays.

#include <chrono>
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
#include "server/edit_store/store.h"
#include "server/editing/edit_copy.h"
#include "server/editing/edit_order.h"
#include "server/editing/edit_space.h"
#include "server/editing/ground_check.h"
#include "server/scheduling/pool.h"
#include "server/scheduling/timer.h"

namespace ridgecast::editing {

// The ground as of an edit; 0: the terrain's own.
struct Ground {
  std::shared_ptr<const terrain::Terrain> terrain;
  std::uint64_t edit = 0;
  std::uint64_t identity = 0;  // of that edit (edit_log::identityOf), the same on all servers; 0: there is one server, or it was compacted
};

struct Edit {
  std::string key;     // of its author, without line feeds; an edit repeated with its key is made once. Empty: none
  std::string author;  // edits::toText
  edits::Operation operation;
};

using edit_store::Applied;  // its key: the author's text, a line feed, and the author's key

class Edits : public std::enable_shared_from_this<Edits> {
 public:
  static constexpr std::size_t kMaxWaiting = 256, kMaxWaitingOfOne = kMaxWaiting / 2;  // of one client that pays
  static constexpr std::size_t kRecent = 4096;                                         // edits whose areas are remembered
  static constexpr std::size_t kMaxAreas = 64;
  static constexpr int kGroupTurns = 25;  // of making, before a group is stored

  // Where edits are kept: a store, or how to make one for the first edit, which this client made.
  struct Kept {
    std::shared_ptr<const void> held;  // released when the store is closed
    std::unique_ptr<edit_store::Store> store;
    std::optional<edits::History> history;  // the store's
    std::function<Outcome<std::unique_ptr<edit_store::Store>>(std::string_view client)> makeStore = [](std::string_view) {
      return edit_log::Log::temporary();
    };
    std::string folder;  // for the operator
    // Renames the store's file, after it is closed: its edits are not those that the other servers have.
    std::function<void()> setAside = [] {};
    // The session cannot go on on this server, and has ended; called once, by a task.
    std::function<void()> left = [] {};
  };
  // `changed` is called after each change of the ground, `made` for each edit that is kept, before anybody has its ground. `disk`
  // does what waits for the disk. `turn`: of work, before others have theirs.
  using Made = std::function<void(const Applied&)>;
  Edits(std::shared_ptr<const terrain::Terrain> terrain, scheduling::Executor& executor, scheduling::Executor& disk,
        std::shared_ptr<EditSpace> space, std::function<void()> changed, Kept kept, Made made = {},
        std::chrono::milliseconds turn = scheduling::kTurn, EditOrder::Shared shared = {});
  ~Edits();
  // With other servers: follows their edits from now on. Once, before anything is asked.
  void begin();
  Edits(const Edits&) = delete;
  Edits& operator=(const Edits&) = delete;

  std::uint64_t compacted() const { return compacted_; }
  Ground ground() const;
  // The ground has been that of all servers' edits, or they cannot be reached.
  bool isCurrent() const;
  // How many edits of other servers this one has yet to apply, as far as it has heard.
  std::uint64_t behind() const { return order_->behind(); }
  // The ground now, and where it differs from that of `edit`: at most kMaxAreas.
  struct News {
    Ground ground;
    std::vector<lattice::Area> changed;
  };
  News since(std::uint64_t edit) const;

  // The edit's number, or one sentence: why it was not made.
  struct Answer : Outcome<std::uint64_t> {
    using Outcome<std::uint64_t>::result;
    // Of a refusal. Early: too much waits, it is not paid for yet, or the other servers cannot be reached; retry later. Full: there is no
    // room for edits in this session, in all, in memory or on the disk, or that has failed. Over: the session has ended.
    enum class Why { kWrong, kEarly, kFull, kOver } why = Why::kWrong;
  };
  static Answer refusal(Answer::Why why, std::string sentence);
  // `posts`: how many the edit took; 0 if it was made before. Called by a task, or at once if it is refused before it waits.
  using Done = std::function<void(const Answer& number, std::uint64_t posts)>;
  // Error: it is too early. Called by a task when it is this edit's turn; none: it costs nothing.
  using Pay = std::function<Outcome<void>(const edits::Operation& operation, std::size_t bytes)>;
  // An edit has one `done` for each request for it meanwhile; callers bound their number.
  void ask(Edit edit, Done done, Pay pay = {});

  // Of the edits that ground() has, as edit_store::Store::read. `read` is called by the disk's thread; callers bound the number of calls.
  using Read = std::function<void(Outcome<std::vector<Applied>> edits)>;
  void read(std::uint64_t after, std::size_t most, Read read);
  // The log's file, as edit_store::Store::copy, while others wait for the disk. As read().
  void copy(std::size_t most, std::function<void(Outcome<std::string> file)> take);

  // Ends the session: edits that are not being made or stored yet are refused, as are later ones. Then the store is closed.
  void end();
  bool isOver() const;

 private:
  static constexpr char kCannotFollow[] = "The session takes no edits on this server, which cannot follow the others; connect to another.";
  static Answer away();
  static Answer over();

  struct Waiting {
    const Applied asked;  // with the whole key; its number, time and ground are not known yet
    const Pay pay;
    std::vector<Done> done;  // of the same edit; under the lock while others may join
    // Of the group's task.
    bool isPaid = false;
    std::optional<Answer> answer{};
    std::uint64_t posts = 0;
  };
  struct Reading {
    std::uint64_t after = 0;
    std::size_t most = 0;
    Read read;
  };
  // The steps of a group, one task at a time; those with the disk are by its thread.
  void lookUp();
  void make();
  void confirm();
  void append();
  void appended(EditOrder::Decided decided);
  void keep();
  void publish();
  void goOn();
  void proceed();  // under the lock
  // Those of following (edits_following.cpp).
  void wake();
  void follow();
  void followed(EditOrder::Next next);
  void apply();
  Outcome<void> applyNext();
  Outcome<std::vector<Applied>> readOwn(std::uint64_t after);  // as EditOrder::ReadOwn
  void notAppended(const EditOrder::Decided& decided);
  void confirmed(EditOrder::Next next);
  void makeAgain();
  void stop(const std::string& why);
  void leave(const std::string& why, bool setsAside);

  void readAll();                                                             // edits_reading.cpp
  std::optional<Answer> atOnce(const Applied& asked, bool pays, Done& done);  // under the lock; takes `done` where it joins
  std::optional<Answer> known(const Applied& asked);
  std::optional<Answer> keptWith(const std::string& key, const Applied& asked);  // none: the key is unused
  bool step(Waiting& waiting);  // some more of it; whether it has its answer, or will once it is kept
  std::optional<Answer> begin(Waiting& waiting);
  Answer finish(Waiting& waiting);
  Outcome<void> store();
  void takeBack();
  void refuseMade(const Answer& why);
  void count(const Applied& made);
  Error told(Error e);  // to the operator, once while the same error lasts, with the folder, which clients are not told

  const std::shared_ptr<scheduling::Pool> pool_, disk_;
  const std::shared_ptr<EditSpace> space_;
  const std::function<void()> changed_;
  const Made noted_;
  const std::chrono::milliseconds turn_;

  const std::function<void()> left_;

  // Of the disk's thread.
  Kept kept_;
  EditCopy* copy_ = nullptr;  // the store, with other servers
  std::string trouble_;       // of the store, since an edit was last kept

  // Of the group's task.
  edits::History history_;
  const std::uint64_t compacted_;
  std::deque<std::shared_ptr<Waiting>> group_;  // looked up: the first of waiting_
  struct Making {
    edits::History::Making making;
    std::shared_ptr<const edits::Layer> before;
    std::uint64_t last = 0, looked = 0;  // of the history before it
  };
  std::deque<Applied> followed_;  // others' edits that are to be applied
  struct Batch {
    std::size_t done = 0;  // of group_, that have their answers, or will once they are kept
    std::chrono::nanoseconds worked{};
    std::unique_ptr<Making> making;  // group_[done]
    std::vector<Applied> made;
    std::vector<edits::Posts> changed;                                                 // by those
    std::shared_ptr<const edits::Layer> before;                                        // those
    Ground next;                                                                       // with those
    std::vector<std::pair<std::size_t, std::shared_ptr<const edits::Layer>>> checked;  // after which of those; for check_
    Outcome<void> isKept;
  } batch_;                  // for one write
  std::uint64_t bytes_ = 0;  // of all edits, with the batch's; taken from the space

  const std::shared_ptr<EditOrder> order_;
  const std::shared_ptr<GroundCheck> check_;  // null without other servers

  mutable std::mutex mutex_;
  Ground ground_;
  std::deque<lattice::Area> areas_;                                 // of the last edits, up to ground_.edit
  std::deque<std::shared_ptr<Waiting>> waiting_;                    // for their answers, in order
  std::unordered_map<std::string, std::shared_ptr<Waiting>> open_;  // those with a key
  std::vector<Reading> readings_;
  enum class State { kRests, kBusy, kOver } state_ = State::kRests;  // busy: a group, or others' edits, are under way
  std::string stopped_;                                              // why it takes no edits; empty: it does
  std::string differs_;                                              // why it must leave; empty: it need not
  bool setsAside_ = false;
};

}  // namespace ridgecast::editing
