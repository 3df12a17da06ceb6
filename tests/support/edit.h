#pragma once
// Edits of a session's ground, made at once.

#include <gtest/gtest.h>

#include <future>

#include "common/edits/operation.h"
#include "server/session/session.h"
#include "tests/support/crater.h"

namespace ridgecast::testing_support {

// A crater, metres; returns its number once everybody has its ground.
inline std::uint64_t makeCrater(session::Session& session, double x, double z, double radius, double depth) {
  std::promise<Outcome<std::uint64_t>> made;
  session.edits().ask({"", "ann", craterAt(x, z, radius, depth)},
                      [&](const Outcome<std::uint64_t>& number, std::uint64_t) { made.set_value(number); });
  const auto number = made.get_future().get();
  EXPECT_TRUE(number) << number.error().message;
  return number ? *number : 0;
}

}  // namespace ridgecast::testing_support
