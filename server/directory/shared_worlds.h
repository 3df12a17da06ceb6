#pragma once
// Which name is which world on all servers: records in the bus, so that a session is never two worlds.
//
//   world/NAME/     a session that lives on at least one server. Whoever makes one writes the record first; the first writer's world is the
//                   session's, and others make that one or refuse. Every server that has it renews the record, so that it outlives them by
//                   `life`: members of a server that crashed find the same world on another.
//   kept/NAME/      a session that has edits: for good, as its log. Only a session of the same world may take the name again.
//   ended/NAME/ID/  a session that an operator has ended. As long as a world's record could live: a server that was away ends it too.
//
// A record that the engine has lost is written again by the next renewal. If two servers made two worlds meanwhile, the one whose record
// does not stand learns it from its renewal and ends its session; members connect again and are in the other.
//
// Any thread; no call waits (bus/bus.h). With bus::Alone nothing is found, and every claim stands.

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "common/outcome/outcome.h"
#include "server/bus/bus.h"
#include "server/directory/records.h"

namespace ridgecast::directory {

inline constexpr std::chrono::milliseconds kGrace{10'000};  // of a record that nobody renews

class SharedWorlds {
 public:
  // `life`: of a record after its last renewal; at least kGrace.
  SharedWorlds(std::shared_ptr<bus::Bus> bus, std::chrono::milliseconds life);

  // Error: one sentence; the engine is away, or a record is unreadable. So below.
  // The world that has a name, and the epoch of its record, for renewals.
  struct Standing {
    World world;
    std::uint64_t epoch = 0;
  };
  struct Found {
    std::optional<Standing> live;
    std::optional<World> kept;  // looked for if none lives
  };
  void find(const std::string& name, std::function<void(Outcome<Found>)> done) const;

  // Gives the name to this world, if none has it. The record lives for kGrace: renew it once the session is there.
  void claim(const std::string& name, const World& world, std::function<void(Outcome<Standing>)> done) const;
  // `epoch`: of the last Standing; 0: none. `isBrief`: the name is free after kGrace if nobody renews it, as where the session ends here.
  void renew(const std::string& name, const World& world, std::uint64_t epoch, bool isBrief,
             std::function<void(Outcome<Standing>)> done) const;
  // Gives the name to this world for good, unless another has it: the world that has it. To be called, and answered, before the first edit
  // is appended to the session's log.
  void keep(const std::string& name, const World& world, std::function<void(Outcome<World>)> done) const;

  // Ends this session on all servers that call listEnded(). Its name is free at once, unless it is kept.
  void end(const std::string& name, const std::string& id, std::uint64_t epoch) const;
  // What operators have ended lately: name and id.
  using Ended = std::set<std::pair<std::string, std::string>, std::less<>>;
  void listEnded(std::function<void(Outcome<Ended>)> done) const;

  std::string newId() { return std::to_string(bus_->server()) + "." + std::to_string(++lastId_); }  // for a session that is made here

 private:
  const std::shared_ptr<bus::Bus> bus_;
  const std::chrono::milliseconds life_;
  std::atomic<std::uint64_t> lastId_{0};
};

}  // namespace ridgecast::directory
