#pragma once
// Whether the tests and the programs they start run under the address or the thread sanitizer: what is freed stays resident then, addresses
// are scarce, and everything takes ten times as long.

namespace ridgecast::testing_support {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif

}  // namespace ridgecast::testing_support
