#pragma once
// Which Ridgecast this is.

#include <string>
#include <string_view>

namespace ridgecast::version {

std::string_view product();  // "0.2.0"
std::string_view commit();   // twelve hexadecimal digits, with "+" behind them when the tree had other changes; "unknown" without git
// "ridgecast-server 0.2.0, protocol 1, commit 0123456789ab"
std::string describe(std::string_view program, unsigned protocol);

}  // namespace ridgecast::version
