#pragma once
// What the servers of a world tell each other, through an engine beside them: logs in one order, messages, and records that expire.
//
//   server A --append(log, after N)--> engine --watch--> servers A, B, C: read(log, N)
//   server A --tell(channel)---------> engine --hear---> servers B, C
//   server A --hold(key, epoch)------> engine: one holder at a time, who renews it; an earlier one's writes are refused
//
// Meshes, queries and tiles need none of it and go on while the engine is away. An entry that was appended is on the engine's disk, under
// its number, whichever server appended it. Messages may get lost, and records be as old as their time to live.
//
// Implementations: Alone (one server, no engine) and Redis (redis.h). Rules for all of them: tests/unit/server/bus/laws.h.
//
// Any thread; no call waits. Handlers are called one at a time, by the bus's thread or by the call itself before it returns, so callers
// hold no lock that their handler takes. They are brief and may call the bus. Each `done` is called once, while the bus lives.

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"

namespace ridgecast::bus {

struct Entry {
  std::uint64_t number = 0;  // from 1, without gaps
  std::string bytes;         // empty: the engine has lost it, and has later ones
  friend bool operator==(const Entry&, const Entry&) = default;
};

struct Appended {
  enum class Kind {
    kDone,     // all of them
    kBehind,   // none: the log ends with `last`
    kAway,     // none: the engine cannot be reached, or has just come back; later
    kFull,     // none: it has no room
    kUnknown,  // the engine went away before it answered: the log decides, once it can be read
  } kind = Kind::kDone;
  std::uint64_t last = 0;  // of the log; not with kAway and kUnknown
  std::string why{};       // kAway, kFull: one sentence
};

struct Record {
  std::string value;
  std::uint64_t epoch = 0;  // counts this key's holders, from 1
  friend bool operator==(const Record&, const Record&) = default;
};

// Ends what it stands for when the last copy goes; a handler that runs then may still end.
using Subscription = std::shared_ptr<const void>;

class Bus {
 public:
  virtual ~Bus() = default;
  Bus(const Bus&) = delete;
  Bus& operator=(const Bus&) = delete;

  // This server's number: no other that the engine has known has it. Less than 2^20; 0: it is alone.
  virtual std::uint32_t server() const = 0;
  virtual bool isAway() const = 0;  // as soon as a call has no answer
  // The engine's clock, microseconds since 1970; while it is away, as it would have gone on.
  virtual std::int64_t now() const = 0;

  // ---- logs ----

  // kKept: entries that this log had before and may have lost, as when an engine's replica takes over without its end. For a while after
  // that, others are refused (kAway), so that every server can bring back what it has.
  enum class Origin { kNew, kKept };
  // Appends them after number `after`, which must be the last, all or none.
  virtual void append(const std::string& log, std::uint64_t after, std::vector<std::string> entries, Origin origin,
                      std::function<void(Appended)> done) = 0;
  // Those numbered above `after`, in order: as many as fit in `most` bytes, at least one; none: no more are left. Error: one sentence.
  virtual void read(const std::string& log, std::uint64_t after, std::size_t most,
                    std::function<void(Outcome<std::vector<Entry>>)> done) = 0;
  // `changed(last)`: soon, after entries came, and when the engine is back. Less than before: the log has lost its end.
  virtual Subscription watch(const std::string& log, std::function<void(std::uint64_t last)> changed) = 0;

  // ---- messages ----

  // To all other servers that hear this channel now. Those of one server arrive in their order, whatever their channels, and before what
  // another tells after it has heard one of them.
  virtual void tell(const std::string& channel, std::string message) = 0;
  virtual Subscription hear(const std::string& channel, std::function<void(const std::string& message)> heard) = 0;

  // ---- records ----

  struct Held {
    bool isYours = false;
    Record record;  // that stands now
  };
  // Writes the record, which then lives for `life` (0: for good), if there is none or `epoch` is its own. Whoever knows its epoch may write
  // it; 0: a new holder, who succeeds only if there is none. Error: one sentence; the engine is away.
  virtual void hold(const std::string& key, std::string value, std::uint64_t epoch, std::chrono::milliseconds life,
                    std::function<void(Outcome<Held>)> done) = 0;
  // Makes the caller the next holder of the record if `epoch` is its own: value and life stay, and earlier holders' writes are refused, so
  // that nothing written is lost in between. Not yours: another took it, or it has ended (then its epoch is 0). Error: as hold().
  virtual void take(const std::string& key, std::uint64_t epoch, std::function<void(Outcome<Held>)> done) = 0;
  // Ends the record, if it has this epoch.
  virtual void drop(const std::string& key, std::uint64_t epoch) = 0;
  // All whose key begins with this. Error: as hold().
  virtual void list(const std::string& prefix, std::function<void(Outcome<std::map<std::string, Record>>)> done) = 0;

 protected:
  Bus() = default;
};

// One server: nobody else appends, hears or holds. What it keeps are its own files.
class Alone final : public Bus {
 public:
  std::uint32_t server() const override { return 0; }
  bool isAway() const override { return false; }
  std::int64_t now() const override {
    using namespace std::chrono;
    return duration_cast<microseconds>(system_clock::now().time_since_epoch()).count();
  }
  void append(const std::string&, std::uint64_t after, std::vector<std::string> entries, Origin,
              std::function<void(Appended)> done) override {
    done({Appended::Kind::kDone, after + entries.size()});
  }
  void read(const std::string&, std::uint64_t, std::size_t, std::function<void(Outcome<std::vector<Entry>>)> done) override {
    done(std::vector<Entry>());
  }
  Subscription watch(const std::string&, std::function<void(std::uint64_t)>) override { return {}; }
  void tell(const std::string&, std::string) override {}
  Subscription hear(const std::string&, std::function<void(const std::string&)>) override { return {}; }
  void hold(const std::string&, std::string value, std::uint64_t, std::chrono::milliseconds,
            std::function<void(Outcome<Held>)> done) override {
    done(Held{true, {std::move(value), 1}});
  }
  void take(const std::string&, std::uint64_t, std::function<void(Outcome<Held>)> done) override { done(Held{}); }
  void drop(const std::string&, std::uint64_t) override {}
  void list(const std::string&, std::function<void(Outcome<std::map<std::string, Record>>)> done) override {
    done(std::map<std::string, Record>());
  }
};

}  // namespace ridgecast::bus
