#pragma once
// The servers of a simulated world: one, or several over one engine. Which of them a line finds, what breaks between them, and whether they
// agree.

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "tests/simulation/event.h"
#include "tests/simulation/server.h"
#include "tests/simulation/truth.h"
#include "tests/support/simulated_bus.h"

namespace ridgecast::simulation {

class Cluster {
 public:
  using Truths = std::map<std::string, Truth>;              // by session
  using Falls = std::function<void(const Server& server)>;  // it is about to
  // All must outlive it.
  Cluster(std::size_t servers, std::shared_ptr<const terrain::Terrain> terrain, const session::Limits& limits,
          const testing_support::SimulatedTimer& timer, std::uint64_t seed, Truths& truths, Random& random, Falls falls);
  ~Cluster();

  bool isShared() const { return engine_ != nullptr; }
  std::size_t size() const { return all_.size(); }
  Server& operator[](std::size_t k) const { return *all_[k]; }
  // Where a new line goes: to any that takes it. The first, if none does.
  Server& next() const;
  // Since when nothing breaks any more: what waits for an engine waits from then on.
  Time calmFrom() const { return calmFrom_; }
  // A camera has come; its number is nobody else's.
  void greeted(std::uint64_t camera);

  bool isCalm() const { return timer_.now() >= calmFrom_; }
  // The engine's clock jumps, or it loses the clock's record: then time and steps may differ between servers for a moment.
  bool losesTime() const { return jumps_ || losesRecords_; }
  // Since then at least it has heard all that the others say; one that cannot goes on by the clock that it knows.
  bool isInTouchSince(Time then, const Server& server) const;
  // How often a session has ended, since nobody was in it: the next one of its name has another clock.
  std::uint64_t endings(const std::string& session) const;

  // ---- of several servers ----

  // An event of theirs. False: it is none.
  bool act(const Event& event);
  void heal();                                         // and nothing breaks any more
  bool isWhole() const;                                // all have started, and the engine has all that any has
  bool hasAll(const session::Session& session) const;  // edits of all servers
  void settle();
  void judge();                                                     // that they agree; after each event
  void judgeRest(const std::string& session, std::size_t members);  // what holds once all is told
  void end();                                                       // all of them, and judges their copies
  void finish();                                                    // none starts again

 private:
  void begin(std::size_t server, std::uint64_t life);  // tries until it is there, or falls
  void fall(std::size_t server, bool withPower);
  void upgrade(std::size_t server);  // and the next ones
  void await(std::size_t server);
  void mend(std::size_t server);
  void halt(bool stops);
  void touches(std::size_t server);  // what it has missed comes
  void away(Duration time);          // something is
  void split(Duration time);         // likewise, and servers may not hear each other
  bool hasTail() const;              // the engine has all that any server has
  bool mayBreak() const;             // after a failover it is brought back before anything else breaks: two faults at once may lose it
  void failOver(const Event& event);
  void visit(Server& server, const Event& event);
  void judgeLogs();
  void look(const std::string& session);

  const testing_support::SimulatedTimer& timer_;
  Truths& truths_;
  Random& random_;
  const Falls falls_;
  const bool jumps_, losesRecords_;
  std::unique_ptr<testing_support::SimulatedEngine> engine_;  // null: one server
  std::unique_ptr<testing_support::ForgetfulDisk> disk_;
  std::vector<std::unique_ptr<Server>> all_;
  std::map<std::size_t, std::uint64_t> lives_;  // of each server: how often it fell
  std::set<std::size_t> cut_;                   // servers, from the engine
  bool isStopped_ = false, breaks_ = true, isUpgrading_ = false, isCutting_ = false, isOver_ = false;
  Time calmFrom_{}, splitUntil_{};
  std::map<std::size_t, Time> inTouchFrom_;  // servers
  struct Lives {
    std::set<std::size_t> at{};  // servers
    std::uint64_t endings = 0;
  };
  std::map<std::string, Lives> sessions_;
  std::map<std::string, std::uint64_t> most_;  // the last edit that any server has had, by session
  std::map<const session::Session*, std::uint64_t> judged_;
  std::set<std::uint64_t> cameras_;
  std::uint64_t judgements_ = 0;
};

}  // namespace ridgecast::simulation
