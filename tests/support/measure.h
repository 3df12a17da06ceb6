#pragma once
// Times are the machine's: tests assert them only when MEASURE is set in the environment, on a machine that does nothing else.

#include <cstdlib>

namespace ridgecast::testing_support {

inline bool measures() { return std::getenv("MEASURE") != nullptr; }

}  // namespace ridgecast::testing_support
