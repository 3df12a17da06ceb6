#pragma once
// Whether the tests and the programs they start run under a sanitizer: what is freed stays resident then, addresses are scarce, and
// everything takes ten times as long.

namespace ridgecast::testing_support {

#ifdef RIDGECAST_SANITIZED
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif

// Of a test that repeats itself at random: fewer under a sanitizer, which wants each way gone once.
constexpr int rounds(int usual) { return kSanitized && usual > 1 ? 1 + usual / 8 : usual; }

}  // namespace ridgecast::testing_support
