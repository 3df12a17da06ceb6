#pragma once
// An engine beside the servers of a world (server/bus/bus.h), in memory, with the faults that a real one and its network have. Its time is
// a SimulatedTimer's, which makes all calls: the same seed and calls give the same course.
//
//     SimulatedTimer timer;
//     SimulatedEngine engine(timer);
//     const auto a = engine.connect(), b = engine.connect();  // two servers
//     a->append("log", 0, {"entry"}, bus::Bus::Origin::kNew, ...);
//     timer.advance(0s);  // everything that is due happens
//
// What was on its way when a connection breaks: the first of it, by the seed, still reaches the engine, now and then after the server has
// come back, as behind a proxy; nothing reaches the server.

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "server/bus/bus.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::testing_support {

// Any thread. Buses live as long as anyone holds them, and need the timer.
class SimulatedEngine {
 public:
  using Duration = scheduling::Timer::Time::duration;
  static constexpr std::chrono::seconds kGrace{2};  // after loseEnd(), without new entries

  explicit SimulatedEngine(const SimulatedTimer& timer, std::uint64_t seed = 1);
  ~SimulatedEngine();
  SimulatedEngine(const SimulatedEngine&) = delete;
  SimulatedEngine& operator=(const SimulatedEngine&) = delete;

  // For one more server, under the next number from 1. A bus that goes breaks its connection.
  std::shared_ptr<bus::Bus> connect();

  // ---- faults; all begin at once ----

  void slow(Duration delay, Duration jitter = {});  // one way, of all that is sent from now on, at least; order is kept
  void notice(Duration after);                      // how long servers take a broken connection for a slow one; 0 at first
  void cut(const bus::Bus& server);                 // nothing passes between it and the engine until mend()
  void mend(const bus::Bus& server);
  void end(const bus::Bus& server);  // as cut(), noticed at once, and for good: its program ends
  void stop();                       // as cut() for all; the engine's data stays
  void start();
  // Another takes over without the last `entries` of a log: all connections break and are mended at once.
  void loseEnd(const std::string& log, std::size_t entries);
  void loseRecords();  // as loseEnd(), of all records
  void fill();         // no room: appends are kFull, hold() is an error
  void empty();
  void setClock(std::chrono::microseconds ahead);  // of where it would be

  // ---- for judges ----

  std::vector<bus::Entry> log(const std::string& name) const;
  std::uint64_t last(const std::string& log) const;  // its number
  struct Traffic {
    std::uint64_t appends = 0, entries = 0, reads = 0, tells = 0, toldBytes = 0, holds = 0;  // that reached the engine
    std::uint64_t heard = 0;                                                                 // messages that servers received
  };
  Traffic traffic() const;

 private:
  struct State;
  class Connection;
  std::shared_ptr<State> state_;
};

}  // namespace ridgecast::testing_support
