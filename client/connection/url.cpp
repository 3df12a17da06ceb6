#include <algorithm>
#include <string>
#include <tuple>

#include "client/connection/connection.h"
#include "common/wire/wire.h"

namespace ridgecast::connection {
namespace {

constexpr std::size_t kMaxUrlBytes = 2048;

Error wrong(std::string_view text, const std::string& why) {
  return {std::string("'").append(text.substr(0, 80)) + "' is no server's address: " + why +
          " (for example ws://127.0.0.1:7070?session=default)"};
}

bool startsWith(std::string_view text, std::string_view lowerPrefix) {
  const auto lower = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; };
  return text.size() >= lowerPrefix.size() &&
         std::equal(lowerPrefix.begin(), lowerPrefix.end(), text.begin(), [&](char p, char c) { return p == lower(c); });
}

bool portIsValid(std::string_view port) {
  if (port.empty() || port.size() > 5 || !std::all_of(port.begin(), port.end(), [](char c) { return c >= '0' && c <= '9'; })) return false;
  const int number = std::stoi(std::string(port));
  return number >= 1 && number <= 65535;
}

bool hostIsValid(std::string_view host, bool isAddress6) {
  const auto allowed = [&](char c) {
    const bool hex = (c >= 'a' && c <= 'f') || (c >= 'A' && c <= 'F') || (c >= '0' && c <= '9');
    if (isAddress6) return hex || c == ':' || c == '.';
    return hex || (c >= 'g' && c <= 'z') || (c >= 'G' && c <= 'Z') || c == '.' || c == '-' || c == '_';
  };
  return !host.empty() && host.size() <= 253 && std::all_of(host.begin(), host.end(), allowed);
}

// Fit to stand in a request as it is.
bool isPlain(std::string_view parameter) {
  return std::all_of(parameter.begin(), parameter.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           std::string_view("._-+%=").find(c) != std::string_view::npos;
  });
}

}  // namespace

Outcome<Url> parseUrl(std::string_view text) {
  Url url;
  if (text.empty()) return url;
  if (text.size() > kMaxUrlBytes) return wrong(text, "it is too long");
  std::string_view rest = text;
  for (const auto& [scheme, port, secure] : {std::tuple{"http://", "80", false}, std::tuple{"ws://", "80", false},
                                             std::tuple{"https://", "443", true}, std::tuple{"wss://", "443", true}}) {
    if (!startsWith(rest, scheme)) continue;
    rest.remove_prefix(std::string_view(scheme).size());
    url.port = port;
    url.secure = secure;
    break;
  }
  if (rest.find("://") != std::string_view::npos)
    return wrong(text, "its scheme is unknown, known are ws://, wss://, http:// and https://");

  rest = rest.substr(0, rest.find('#'));
  const std::size_t endOfHost = std::min(rest.size(), rest.find_first_of("/?"));
  std::string_view host = rest.substr(0, endOfHost);
  rest.remove_prefix(endOfHost);
  if (host.find('@') != std::string_view::npos) return wrong(text, "user names do not belong into it");
  const bool isAddress6 = !host.empty() && host.front() == '[';
  if (isAddress6) {
    const std::size_t close = host.find(']');
    if (close == std::string_view::npos) return wrong(text, "']' is missing");
    std::string_view behind = host.substr(close + 1);
    host = host.substr(1, close - 1);
    if (!behind.empty()) {
      if (behind.front() != ':' || !portIsValid(behind.substr(1))) return wrong(text, "its port must be 1..65535");
      url.port = behind.substr(1);
    }
  } else if (const std::size_t colon = host.find(':'); colon != std::string_view::npos) {
    if (!portIsValid(host.substr(colon + 1))) return wrong(text, "its port must be 1..65535");
    url.port = host.substr(colon + 1);
    host = host.substr(0, colon);
  }
  if (!hostIsValid(host, isAddress6)) return wrong(text, "its host must be a name or an address");
  url.host = host;

  const std::size_t question = rest.find('?');
  if (question == std::string_view::npos) return url;
  for (std::string_view query = rest.substr(question + 1); !query.empty();) {
    const std::string_view parameter = query.substr(0, query.find('&'));
    query.remove_prefix(std::min(query.size(), parameter.size() + 1));
    for (const std::string_view known : {"terrain=", "seed=", "param="}) {
      if (!parameter.starts_with(known)) continue;
      if (!isPlain(parameter)) return wrong(text, "terrain, seed and param have letters, digits and . _ - + % = alone");
      url.world.append(url.world.empty() ? "" : "&").append(parameter);
    }
    if (!parameter.starts_with("session=")) continue;
    url.session = parameter.substr(8);
    if (!wire::sessionNameIsValid(url.session)) return wrong(text, "a session's name has 1 to 64 letters, digits, '.', '_' or '-'");
  }
  return url;
}

}  // namespace ridgecast::connection
