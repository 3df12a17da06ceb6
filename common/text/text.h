#pragma once
// Reading and writing small texts: parts of lists, numbers, URLs. Pure; any thread.

#include <charconv>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>

namespace ridgecast::text {

// Without spaces, tabs and carriage returns at its ends.
std::string_view trimmed(std::string_view text);

// Whether all are ASCII letters, digits or among `others`.
bool hasOnly(std::string_view text, std::string_view others);

std::string lower(std::string_view text);  // ASCII letters

// Takes the first part of a list, with its separator, off the front of `rest`.
std::string_view takePart(std::string_view& rest, char separator);

// The whole text as one number, which is finite. Nothing: any other text.
template <class Number>
std::optional<Number> number(std::string_view text) {
  Number value{};
  const char* const end = text.data() + text.size();
  const auto [stopped, failed] = std::from_chars(text.data(), end, value);
  if (failed != std::errc() || stopped != end) return std::nullopt;
  if constexpr (std::is_floating_point_v<Number>)
    if (!std::isfinite(value)) return std::nullopt;
  return value;
}

// As %g prints it. 9 digits tell all floats apart, 17 all doubles.
std::string rounded(double value, int digits);
std::string hexadecimal(std::uint64_t value);  // 16 digits

// Of a URL: %41 -> A. Nothing: a % without two hexadecimal digits after it.
std::optional<std::string> percentDecoded(std::string_view text);

// The first 300 bytes of a text from elsewhere, fit for one line of a terminal.
std::string oneLine(std::string_view text);

// A sentence with each absolute path cut down to its last name, so that it hides where a machine has its files.
std::string withoutFolders(std::string_view sentence);

}  // namespace ridgecast::text
