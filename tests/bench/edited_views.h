#pragma once
// The error on screen and the pictures of ground that was edited, against the same views before.

#include "tests/bench/bench.h"

namespace ridgecast::bench {

Report errorOfEditedViews(const Options& options);

}  // namespace ridgecast::bench
