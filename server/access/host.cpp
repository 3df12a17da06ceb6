#include "server/access/host.h"

#include <algorithm>

#include "common/text/text.h"
#include "server/access/network.h"

namespace ridgecast::access {

namespace {

constexpr std::size_t kLongest = 253;  // of a name (RFC 1035)

char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

bool isDigit(char c) { return c >= '0' && c <= '9'; }

}  // namespace

bool sameIgnoringCase(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](char x, char y) { return lower(x) == lower(y); });
}

Outcome<std::string> parseHostName(std::string_view text) {
  const bool isName = !text.empty() && text.size() <= kLongest && text::hasOnly(text, "-_.") && text.front() != '.' &&
                      text.find("..") == std::string_view::npos;
  if (text != "*" && !isName && !(text.size() <= kLongest && hostName(text) == text && parseAddress(text)))
    return Error{
        "'" + std::string(text.substr(0, 60)) +
        "' is not a host name: --allowed-host takes one without scheme, port and path, such as terrain.example.org, or * for any."};
  return Outcome<std::string>(boost::system::in_place_value, text.ends_with('.') ? text.substr(0, text.size() - 1) : text);
}

std::string_view hostName(std::string_view header) {
  std::string_view name = header;
  if (header.starts_with('[')) {
    const auto close = header.find(']');
    if (close == std::string_view::npos) return header;
    name = header.substr(0, close + 1);
  } else {
    name = header.substr(0, std::min(header.find(':'), header.size()));
  }
  const std::string_view port = header.substr(name.size());
  if (!port.empty() && (port.front() != ':' || !std::all_of(port.begin() + 1, port.end(), isDigit))) return header;
  if (name.size() > 1 && name.ends_with('.')) name.remove_suffix(1);
  return name;
}

bool answersTo(std::string_view header, std::string_view listening, const std::vector<std::string>& allowed) {
  if (header.empty()) return true;
  const std::string_view name = hostName(header);
  constexpr std::string_view below = ".localhost";
  if (sameIgnoringCase(name, below.substr(1)) || sameIgnoringCase(name, listening) || parseAddress(name)) return true;
  if (name.size() > below.size() && sameIgnoringCase(name.substr(name.size() - below.size()), below)) return true;
  return std::any_of(allowed.begin(), allowed.end(), [&](const std::string& one) { return one == "*" || sameIgnoringCase(name, one); });
}

}  // namespace ridgecast::access
