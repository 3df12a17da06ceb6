#include "client/core/conversation/url.h"

#include <strings.h>

#include <algorithm>
#include <cstring>
#include <string>
#include <tuple>

#include "common/wire/wire.h"

namespace ridgecast::core {
namespace {

constexpr std::size_t kMaxUrlBytes = 2048;

Error wrong(std::string_view text, const std::string& why) {
  return {std::string("'").append(text.substr(0, 80)) + "' is not a server's address: " + why +
          " (for example ws://127.0.0.1:7070?session=default)"};
}

constexpr std::string_view kDigits = "0123456789", kHexDigits = "0123456789abcdefABCDEF";
constexpr std::string_view kAlphanumeric = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ";

bool consistsOf(std::string_view text, std::string_view some, std::string_view more = {}) {
  return std::ranges::all_of(text, [&](char c) { return some.find(c) != some.npos || more.find(c) != more.npos; });
}

bool portIsValid(const std::string& port) {
  return !port.empty() && port.size() <= 5 && consistsOf(port, kDigits) && std::stoi(port) >= 1 && std::stoi(port) <= 65535;
}

// Takes the scheme off `rest`.
void parseScheme(std::string_view& rest, Url& url) {
  for (const auto& [scheme, port, secure] :
       {std::tuple{"http://", "80", false}, {"ws://", "80", false}, {"https://", "443", true}, {"wss://", "443", true}}) {
    const std::size_t size = std::strlen(scheme);
    if (rest.size() < size || strncasecmp(rest.data(), scheme, size) != 0) continue;
    rest.remove_prefix(size);
    url.port = port;
    url.secure = secure;
    return;
  }
}

// Host and port. What is wrong with them, if anything.
const char* parseHost(std::string_view host, Url& url) {
  if (host.find('@') != host.npos) return "it must not have a user name";
  std::size_t end = host.find(':');
  const bool isAddress6 = host.starts_with('[');
  if (isAddress6) {
    const std::size_t close = host.find(']');
    if (close == host.npos) return "']' is missing";
    end = close + 1 < host.size() ? close + 1 : host.npos;
    url.host = host.substr(1, close - 1);
  } else {
    url.host = host.substr(0, end);
  }
  if (end != host.npos) {
    url.port = host.substr(end + 1);
    if (host[end] != ':' || !portIsValid(url.port)) return "its port must be 1..65535";
  }
  const bool valid = isAddress6 ? consistsOf(url.host, kHexDigits, ":.") : consistsOf(url.host, kAlphanumeric, ".-_");
  return valid && !url.host.empty() && url.host.size() <= 253 ? nullptr : "its host must be a name or an address";
}

// Session and world. What is wrong with them, if anything.
const char* parseQuery(std::string_view query, Url& url) {
  while (!query.empty()) {
    const std::string_view parameter = query.substr(0, query.find('&'));
    query.remove_prefix(std::min(query.size(), parameter.size() + 1));
    if (parameter.starts_with("session=")) {
      url.session = parameter.substr(8);
      if (!wire::sessionNameIsValid(url.session)) return "a session's name has 1 to 64 letters, digits, '.', '_' or '-'";
    } else if (parameter.starts_with("terrain=") || parameter.starts_with("seed=") || parameter.starts_with("param=") ||
               parameter.starts_with("clock=")) {
      if (!consistsOf(parameter, kAlphanumeric, "._-+%="))
        return "terrain, seed, param and clock have only letters, digits and . _ - + % =";
      url.world.append(url.world.empty() ? "" : "&").append(parameter);
    }
  }
  return nullptr;
}

}  // namespace

std::string Url::where() const { return (host.find(':') == std::string::npos ? host : "[" + host + "]") + ":" + port; }

Outcome<Url> parseUrl(std::string_view text) {
  Url url;
  if (text.empty()) return url;
  if (text.size() > kMaxUrlBytes) return wrong(text, "it is too long");
  std::string_view rest = text;
  parseScheme(rest, url);
  if (rest.find("://") != rest.npos) return wrong(text, "its scheme is unknown, known are ws://, wss://, http:// and https://");
  rest = rest.substr(0, rest.find('#'));
  if (const char* why = parseHost(rest.substr(0, rest.find_first_of("/?")), url)) return wrong(text, why);
  if (const std::size_t question = rest.find('?'); question != rest.npos)
    if (const char* why = parseQuery(rest.substr(question + 1), url)) return wrong(text, why);
  return url;
}

}  // namespace ridgecast::core
