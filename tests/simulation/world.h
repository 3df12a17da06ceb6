#pragma once
// A server with its disk, its sessions and members in one thread and simulated time; or several servers, over an engine. What a seed and
// events make of it is always the same.

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/terrain/terrain.h"
#include "tests/simulation/cluster.h"
#include "tests/simulation/event.h"
#include "tests/simulation/liar.h"
#include "tests/simulation/member.h"
#include "tests/simulation/server.h"
#include "tests/simulation/truth.h"

namespace ridgecast::simulation {

// What all worlds together have met.
struct Met {
  Duration time{};  // without that in which nobody is there, or nothing but a step waits
  std::uint64_t edits = 0, acknowledgements = 0, falls = 0, storms = 0, undone = 0, lostWrites = 0, posted = 0, starved = 0, old = 0,
                handedOver = 0;
  std::uint64_t upgrades = 0, failovers = 0, judged = 0, visits = 0, behind = 0,
                movedMeshes = 0;  // of several servers; iterations that were judged
};
extern Met met;

// Judges by GoogleTest; stops at the first failure.
class World {
 public:
  explicit World(std::uint64_t seed);
  ~World();
  static constexpr std::uint64_t kSeveral = 1'000'000;  // seeds from this on have 2 to 4 servers
  static std::size_t serversOf(std::uint64_t seed) { return seed < kSeveral ? 1 : 2 + seed % 3; }
  static bool hasLiar(std::uint64_t seed) { return seed < kSeveral && seed / 4 % 2 == 0; }

  void live(const Events& events);  // the laws are judged after each
  // The liar goes, nothing breaks any more, everybody else comes back, stays where it is and gets what is missing; then once more what
  // it asks for.
  void calm();
  // Everybody loses the line, and nothing is left. The server stops, and nothing but the log says what the ground is.
  void judgeEnd();
  bool canUndoAll() const;  // in a moment
  // One member of the default session after the other undoes an edit, until nothing is left of any.
  void undoAll();

  std::uint64_t history() const;  // a hash of what members have seen

 private:
  Duration between(int least, int most);            // seconds
  bool hasAll(const Member& member) const;          // of its own
  bool knowsAll(const Member& member) const;        // and of the others
  std::string stateOf(const Member& member) const;  // for a person
  bool rests(const Member& member) const;           // and no step waits
  void admit(std::uint64_t number, lattice::Point site);
  Server& server() const { return (*cluster_)[0]; }  // where there is one
  void endShared();

  void act(const Event& event);
  void storm(Server& server, std::uint64_t edits);
  void fall(bool withPower);
  void start();
  void rest();
  void judge();
  void judgeShared();
  void judgeEmptiness();

  void run(Duration time);
  void settle();

  Random random_;
  testing_support::SimulatedTimer timer_;
  std::shared_ptr<const terrain::Terrain> terrain_;
  std::map<std::string, Truth> truths_;  // by session
  std::optional<Cluster> cluster_;
  std::vector<std::unique_ptr<Member>> members_;
  std::unique_ptr<Liar> liar_;
  const bool hasOther_;  // server beside it
  bool breaks_ = true, fell_ = false;
  Time fellAt_{};
  std::uint64_t step_ = 0;
  Time stepSeen_{};
};

}  // namespace ridgecast::simulation
