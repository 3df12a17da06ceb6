#pragma once
// Of a run that fails, as few events as still fail.

#include <cstdint>
#include <string>

#include "tests/simulation/event.h"

namespace ridgecast::simulation {

// Runs this program again and again, each time with fewer of this seed's events: without halves, quarters, ... single ones (Zeller and
// Hildebrandt 2002). A run counts if it fails at the same place. Takes at most about three minutes. What it found, for people; the
// events are then in a file of the working directory.
std::string shorten(std::uint64_t seed, Events events);

}  // namespace ridgecast::simulation
