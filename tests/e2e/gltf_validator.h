#pragma once
// Khronos' gltf-validator, where it is: ./run test installs it.

#include <gtest/gtest.h>

#include <cstdlib>
#include <string>
#include <vector>

#include "tests/support/process.h"

namespace ridgecast::testing_support {

// Skips the test where it is not there: to be called last.
inline void validateGltf(const std::vector<std::string>& files) {
  if (!std::getenv("TESTS_NODE_TOOLS") || !programExists("node"))
    GTEST_SKIP() << "no node, or TESTS_NODE_TOOLS names no folder with gltf-validator (./run test installs it where there is npm): "
                    "it judged no file";
  std::vector<std::string> command{"node", RIDGECAST_TOOLS "/validate-gltf.mjs"};
  command.insert(command.end(), files.begin(), files.end());
  const Finished validated = runProgram(command);
  EXPECT_EQ(validated.code, 0) << validated.output;
}

}  // namespace ridgecast::testing_support
