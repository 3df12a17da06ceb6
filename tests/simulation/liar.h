#pragma once
// A member that says valid messages at the wrong time, with the wrong numbers, and too many of them. It is refused in a sentence, comes
// back, and disturbs nobody: that the others judge.

#include <cstdint>
#include <memory>
#include <string>

#include "tests/simulation/line.h"
#include "tests/simulation/server.h"
#include "tests/simulation/truth.h"

namespace ridgecast::simulation {

class Liar {
 public:
  // All must outlive it.
  Liar(Server& server, Truth& truth, SimulatedTimer& timer, Random& random, lattice::Point near)
      : server_(server), truth_(truth), timer_(timer), random_(random), near_(near) {}
  ~Liar() { leave(); }

  void lie();    // or connects, where it is not
  void flood();  // with edits that are right
  void leave();

 private:
  wire::ClientMessage message();
  wire::Edit edit();
  std::string operation();
  void take(const wire::EditAnswer& answer);

  Server& server_;
  Truth& truth_;
  SimulatedTimer& timer_;
  Random& random_;
  const lattice::Point near_;
  std::shared_ptr<Line> line_;
  std::string name_;  // that it says
};

}  // namespace ridgecast::simulation
