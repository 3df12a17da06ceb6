#include "common/text/text.h"

#include <algorithm>
#include <array>
#include <cstdio>

#include "common/outcome/contract.h"

namespace ridgecast::text {

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r";
  text.remove_prefix(std::min(text.find_first_not_of(kBlank), text.size()));
  return text.substr(0, text.find_last_not_of(kBlank) + 1);
}

bool hasOnly(std::string_view text, std::string_view others) {
  return std::ranges::all_of(text, [others](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || others.find(c) != std::string_view::npos;
  });
}

std::string lower(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c + ('a' - 'A'));
  return out;
}

std::string_view takePart(std::string_view& rest, char separator) {
  const std::string_view part = rest.substr(0, rest.find(separator));
  rest.remove_prefix(std::min(part.size() + 1, rest.size()));
  return part;
}

std::string rounded(double value, int digits) {
  expects(digits > 0 && digits <= 17, "a double has 17 digits");
  char out[40];
  std::snprintf(out, sizeof out, "%.*g", digits, value);
  return out;
}

std::string hexadecimal(std::uint64_t value) {
  char out[17];
  std::snprintf(out, sizeof out, "%016llx", static_cast<unsigned long long>(value));
  return out;
}

std::optional<std::string> percentDecoded(std::string_view text) {
  std::string out;
  while (!text.empty()) {
    const std::size_t length = text.front() == '%' ? 3 : 1;
    unsigned char byte = static_cast<unsigned char>(text.front());
    if (length == 3) {
      const char* const digits = text.data() + 1;
      if (text.size() < length || std::from_chars(digits, digits + 2, byte, 16).ptr != digits + 2) return std::nullopt;
    }
    out += static_cast<char>(byte);
    text.remove_prefix(length);
  }
  return out;
}

std::string oneLine(std::string_view text) {
  std::string out(text.substr(0, std::min<std::size_t>(text.size(), 300)));
  for (char& c : out)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  while (!out.empty() && out.back() == ' ') out.pop_back();
  return out;
}

std::string withoutFolders(std::string_view sentence) {
  constexpr std::string_view kBefore = " \t\n'\"([=", kAfter = " \t\n'\"),;:]";
  std::string out;
  while (!sentence.empty()) {
    const bool begins = sentence.front() == '/' && (out.empty() || kBefore.find(out.back()) != std::string_view::npos);
    const std::string_view word = sentence.substr(0, begins ? sentence.find_first_of(kAfter) : 1);
    const auto last = word.find_last_of('/');
    out += begins && last > 0 && last + 1 < word.size() ? word.substr(last + 1) : word;
    sentence.remove_prefix(word.size());
  }
  return out;
}

}  // namespace ridgecast::text
