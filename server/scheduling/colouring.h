#pragma once
// Which tasks may run at the same time when each may write several places.

#include <cstdint>
#include <span>
#include <vector>

#include "server/scheduling/pool.h"

namespace ridgecast::scheduling {

struct Colouring {
  std::vector<std::uint32_t>
      tasks;    // by (colour, number): running them in parallel gives the result of running them one by one in this order
  Order order;  // for Pool::forEachOrdered, by place in `tasks`
};

// Tasks of one colour write nothing in common. Each task gets the least colour of 64 that is free (the last one, if none is), and waits for
// the last task before it that may write a place that it may write. writeSets[k]: the places that task k may write, each below `places`.
Colouring colour(std::span<const std::span<const std::uint32_t>> writeSets, std::size_t places);

}  // namespace ridgecast::scheduling
