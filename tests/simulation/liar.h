#pragma once
// A member that says valid messages at the wrong time, with the wrong numbers, and too many of them. It is refused in a sentence, comes
// back, and disturbs nobody: that the others judge.

#include <cstdint>
#include <memory>

#include "server/session/session.h"
#include "tests/simulation/line.h"
#include "tests/simulation/member.h"

namespace ridgecast::simulation {

class Liar {
 public:
  // All must outlive it.
  Liar(session::Directory& directory, SimulatedTimer& timer, Random& random) : directory_(directory), timer_(timer), random_(random) {}
  ~Liar() { leave(); }

  void lie();  // or connects, where it is not
  void leave();

 private:
  wire::ClientMessage message();

  session::Directory& directory_;
  SimulatedTimer& timer_;
  Random& random_;
  std::shared_ptr<Line> line_;
};

}  // namespace ridgecast::simulation
