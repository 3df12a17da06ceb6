#pragma once
// A broken contract inside the program: prints what should hold and where it did not, and ends the program, in Release too, because
// whatever followed would be wrong. Mistakes of a person, a file or a socket are an Outcome instead. `assert` remains for checks that cost
// more than the work they guard: Debug and the tests have it.

#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace ridgecast {

[[noreturn, gnu::cold, gnu::noinline]] inline void breakContract(const char* sentence, const char* file, int line) {
#ifndef __wasm__
  const char* const name = std::strrchr(file, '/');
  std::fprintf(stderr, "ridgecast: a contract is broken: %s (%s, line %d); please report it\n", sentence, name ? name + 1 : file, line);
  std::abort();
#else
  (void)sentence, (void)file, (void)line;
  __builtin_trap();
#endif
}

// `sentence`: what holds, such as "a range begins before it ends".
inline void expects(bool holds, const char* sentence, const char* file = __builtin_FILE(), int line = __builtin_LINE()) {
  if (!holds) [[unlikely]]
    breakContract(sentence, file, line);
}

}  // namespace ridgecast
