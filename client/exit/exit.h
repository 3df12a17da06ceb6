#pragma once
// How the program's commands end.

#include <cstdio>

#include "common/outcome/outcome.h"

namespace ridgecast {

// Exit codes. kNoGraphics: no OpenGL or display.
inline constexpr int kSuccess = 0, kRuntimeFailure = 1, kBadInput = 2, kNoGraphics = 3;

// Says on stderr what is wrong. Returns `code`.
inline int fail(int code, const Error& error) {
  std::fprintf(stderr, "ridgecast-client: %s\n", error.message.c_str());
  return code;
}

}  // namespace ridgecast
