#pragma once
// The error on screen from random poses: nothing can be tuned to them.
//
//   ridgecast-bench error --poses N [--seed S] [--terrain NAME|FILE.glsl|MAP] [--raster NAME=VALUE] [--altitude LOW,HIGH] [--threshold P]
//                         [--speed METRES_PER_SECOND] [--out DIR] [--json]
//
// Places within 1e6 m (of a height map: on it and half its width around it), altitudes spread evenly in their logarithm (default 1.5 to
// 3,000 m), any yaw, pitch from -80 to 30 degrees, 1280 x 720. At rest each pose is settled; with --speed it flies three seconds, ten
// iterations a second, and is measured then, against the threshold in force. --terrain also takes `dunes`, `terraces` and `wall`, a height
// map whose edge falls to 0. --out gets the worst poses as path files.

#include "tests/bench/bench.h"

namespace ridgecast::bench {

Report errorOfRandomPoses(const Options& options);

}  // namespace ridgecast::bench
