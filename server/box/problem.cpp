#include "server/box/problem.h"

#include "common/text/text.h"

namespace ridgecast::box {

namespace {

std::string text(double v) { return text::rounded(v, 3); }

}  // namespace

Problem Watch::problem() const {
  if (stop.stop_requested()) return {Problem::Kind::kStopped, "Nobody waits for this snapshot any more."};
  return {Problem::Kind::kTooSlow,
          "This snapshot was not ready after " + text(seconds) +
              " seconds, the most that one may take; ask again when the server has less to do, or for less: a larger "
              "threshold or error, a smaller box."};
}

Problem tooManyTriangles(double error, std::uint32_t most, double fits) {
  return {Problem::Kind::kTooMuch,
          "This box at an error of " + text(error) + " m takes more than " + std::to_string(most) + " triangles, the limit; with " +
              (fits > 0 ? "an error of " + text(fits) + " m" : std::string("a much larger error")) +
              ", or in several smaller boxes, it fits.",
          fits};
}

Problem tooRough(double error, std::uint64_t most) {
  return {Problem::Kind::kTooMuch,
          "This ground is too rough for " + std::to_string(most) + " heights, the limit, to prove an error of " + text(error) +
              " m; with an error of " + text(2 * error) + " m, or in several smaller boxes, they may do.",
          2 * error};
}

Problem tooSteep(double step) {
  return {Problem::Kind::kTooMuch,
          "This ground has a step of " + text(step) + " m that no mesh on the lattice follows more closely; an error of " +
              text(step * 1.05) + " m can be kept.",
          step * 1.05};
}

}  // namespace ridgecast::box
