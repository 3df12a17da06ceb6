#pragma once
// The one order of a session's edits over all servers: a log that they share (bus/bus.h), of which each server applies all, its own too.
//
//   append() --> done: the edits have their numbers, and are on the engine's disk
//            --> lost: other servers came first; next() has their edits, on which those that lost are made again
//   next()   --> entries to apply, or that this server must bring back what the log has lost, or that its copy differs
//
// Why an edit is made once. A server appends after N only where it has applied everything up to N, and only if the log ends with N. So
// when it has looked a key up at N and found nothing, no entry has that key. An append without an answer is decided by the log: the batch's
// own tag is in its entries. Until that is known it is sent again as it is, which the log takes at most once, for N is then behind it.
//
// Why this server's edits and the log's agree. Each read begins with this server's last edit, and compares. If the log ends before it, the
// engine has lost its end: what this server has is brought back. If the log has another edit under its number, this server must leave.
//
// Why every server gets its turn. A server that is behind kMaxLosses times in a row while edits wait, by no more than kNear, claims the
// turn; those that hear it begin no batch until they see one of its edits, or hear no more for kHold. Of several claims the one with most
// losses counts, then the lowest server. So each other server can win against it once more at most, with a batch that it had begun. A
// message that is lost costs another loss.
//
// With bus::Alone, everything is done at once. Any thread; callers hold no lock while they call append(), next() and look(), whose handlers
// may run before the call returns.

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "server/bus/bus.h"
#include "server/edit_log/entry.h"
#include "server/edit_store/store.h"
#include "server/scheduling/timer.h"

namespace ridgecast::editing {

using scheduling::Timer;

class EditOrder : public std::enable_shared_from_this<EditOrder> {
 public:
  static constexpr std::size_t kPageBytes = 1u << 20;  // of entries that are read, or brought back, at a time
  static constexpr int kMaxLosses = 2;                 // in a row, before the turn is claimed
  static constexpr std::uint64_t kNear = 1000;         // edits: a server that has just begun claims nothing
  static constexpr std::chrono::milliseconds kClaim{40}, kHold{150};
  static constexpr std::chrono::milliseconds kRetry{100};  // after the engine failed to answer
  static constexpr std::chrono::seconds kLongestClaim{5};  // an undo takes up to two

  struct Shared {
    std::shared_ptr<bus::Bus> bus = std::make_shared<bus::Alone>();
    std::string log;                     // the session's name
    std::shared_ptr<const Timer> timer;  // not with bus::Alone
  };
  // This server has the edits up to `last`, of which the last has this identity (edit_log::identityOf); none: it was compacted, or there is
  // none.
  EditOrder(Shared shared, std::uint64_t last, std::optional<std::uint64_t> identity);
  // Of this server's edits: number `after`, unless it is 0 or compacted, and as many of those that follow as fit into kPageBytes, at least
  // one. Error: one sentence, without its full stop.
  using ReadOwn = std::function<void(std::uint64_t after, std::function<void(Outcome<std::vector<edit_store::Applied>>)> done)>;
  // `wake` is called when what isBehind(), isHeldBack() or isAway() says may have changed. Once.
  void begin(std::function<void()> wake, ReadOwn readOwn);
  void end();  // nothing is followed any more; an append without an answer is given up

  bool isShared() const { return shared_.bus->server() != 0; }
  bool isAway() const { return shared_.bus->isAway(); }
  bool isBehind() const;    // next() is due
  bool isHeldBack() const;  // another server has the turn, or it is not known yet how far the log goes
  bool isCurrent() const;   // it has been where the log ended when following it began, or the engine cannot be reached
  std::uint64_t own() const;
  // Edits that the log had when it was last heard of, and this server has not; 0 without other servers.
  std::uint64_t behind() const;

  struct Decided {
    enum class Kind {
      kDone,
      kLost,     // only the first `there` are in the log, which goes on with others' edits; all must be applied as next() says
      kAway,     // none is; the engine cannot be reached
      kFull,     // none is; it has no room
      kUnknown,  // end() came before that was known
    } kind = Kind::kDone;
    std::size_t there = 0;
    std::string why{};  // for the operator
  };
  // Appends them after own(). One call at a time.
  void append(std::span<const edit_store::Applied> edits, std::function<void(Decided)> done);
  // Others came first, and edits wait to be made.
  void lose();
  // Nothing waits to be made.
  void rest();

  struct Next {
    enum class Kind {
      kNothing,
      kEntries,  // apply these
      kAway,     // later; isBehind() says when
      kDiffers,  // this server's edits are not the log's
      kUnreadable,
    } kind = Kind::kNothing;
    std::vector<edit_store::Applied> entries{};
    std::string why{};
  };
  // What the log has after own(); first brings back what it has lost. One call at a time, and not while one is appended.
  void next(std::function<void(Next)> done);
  // As next(), which is due even where nothing is known to be new.
  void look(std::function<void(Next)> done);
  // This server has the edits up to this one.
  void applied(const edit_store::Applied& last);
  // next() is not due for a while.
  void pause(std::chrono::milliseconds time);

 private:
  struct Open {  // an append
    edit_log::Batch batch;
    std::uint64_t after = 0;
    std::vector<std::string> entries;
    std::vector<std::uint64_t> identities;
    std::size_t there = 0;  // of them, in the log
    bool isUnsure = false;
    std::function<void(Decided)> done;
  };
  void changed(std::uint64_t last);
  void heard(const std::string& message);
  void send();
  void answered(bus::Appended answer);
  void resolveAt(std::uint64_t last);
  void resolve(std::optional<std::string> full);
  void resolved(Outcome<std::vector<bus::Entry>> entries, const std::optional<std::string>& full);
  void retry();
  void decide(Decided decided);
  Next readNext(Outcome<std::vector<bus::Entry>> entries, std::uint64_t after, std::uint64_t told);
  // The log ends with `after`, before own(). kNothing: go on.
  void bringBack(std::uint64_t after, std::function<void(Next)> done);
  void bringBack(std::uint64_t after, const std::vector<edit_store::Applied>& edits, const std::function<void(Next)>& done);
  void broughtBack(std::uint64_t after, std::size_t count, const bus::Appended& answer, const std::function<void(Next)>& done);
  Next differs(std::uint64_t number, std::uint64_t theirs, std::uint64_t ours) const;
  void claim();  // again and again
  void wakeAt(Timer::Time when) const;
  std::string channel() const { return "turn/" + shared_.log; }

  const Shared shared_;
  const std::uint64_t firstTag_;
  // Constant from begin() on.
  std::function<void()> wake_;
  ReadOwn readOwn_;
  bus::Subscription watching_, hearing_;

  mutable std::mutex mutex_;
  std::uint64_t own_ = 0;
  std::optional<std::uint64_t> identity_;  // of that one
  std::optional<std::uint64_t> last_;      // of the log, as far as known
  std::optional<std::uint64_t> aim_;       // that, when own_ was first compared with it and was behind
  std::uint64_t told_ = 0;                 // by the bus, last
  bool mustLook_ = true;                   // the log may have lost its end, and gained another, since own_ was compared
  bool isCurrent_ = false, hasEnded_ = false;
  Timer::Time pausedUntil_{}, heldUntil_{}, claimsUntil_{};
  std::uint32_t holder_ = 0;  // of the turn, while held back
  int losses_ = 0;            // in a row
  bool isClaiming_ = false;
  std::uint64_t batches_ = 0;
  std::optional<Open> open_;
};

}  // namespace ridgecast::editing
