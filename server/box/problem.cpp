#include "server/box/problem.h"

#include <cstdio>

namespace ridgecast::box {

namespace {

std::string text(double v) {
  char out[32];
  std::snprintf(out, sizeof out, "%.3g", v);
  return out;
}

}  // namespace

Problem Watch::problem() const {
  if (stop.stop_requested()) return {Problem::Kind::kStopped, "Nobody waits for this snapshot any more."};
  return {Problem::Kind::kTooSlow,
          "This snapshot was not ready after " + text(seconds) +
              " seconds, the most that one may take; ask again when the server has less to do, or for less: a larger "
              "threshold or error, a smaller box."};
}

}  // namespace ridgecast::box
