#include "server/bus/address.h"

#include <optional>
#include <string_view>

#include "common/text/text.h"

namespace ridgecast::bus {

std::string Address::text() const {
  const bool isV6 = host.find(':') != std::string::npos;
  return (tls ? "rediss://" : "redis://") + (isV6 ? "[" + host + "]" : host) + ":" + std::to_string(port) +
         (database ? "/" + std::to_string(database) : "");
}

Outcome<Address> parseAddress(const std::string& url) {
  const Error wrong{
      "The engine's URL must be like redis://user:password@host:6379/0 or rediss://host (TLS), with %40 for an @ of the password."};
  Address a;
  std::string_view rest = url;
  for (const std::string_view scheme : {"redis://", "rediss://"}) {
    if (!rest.starts_with(scheme)) continue;
    rest.remove_prefix(scheme.size());
    a.tls = scheme == "rediss://";
    break;
  }
  if (rest.size() == url.size()) return wrong;
  if (const auto at = rest.rfind('@'); at != std::string_view::npos) {
    std::string_view password = rest.substr(0, at);
    const bool hasPassword = password.find(':') != std::string_view::npos;
    const auto user = text::percentDecoded(text::takePart(password, ':')), decoded = text::percentDecoded(password);
    if (!user || !decoded || decoded->empty() == hasPassword || (user->empty() && !hasPassword)) return wrong;
    a.user = *user;
    a.password = *decoded;
    rest.remove_prefix(at + 1);
  }
  std::string_view place = text::takePart(rest, '/');
  if (!rest.empty()) {
    const auto database = text::number<unsigned>(rest);
    if (!database || *database > 1'000'000) return wrong;
    a.database = *database;
  }
  std::optional<std::string_view> port;
  if (place.starts_with('[')) {
    const auto end = place.find(']');
    if (end == std::string_view::npos) return wrong;
    a.host = place.substr(1, end - 1);
    place.remove_prefix(end + 1);
    if (place.starts_with(':'))
      port = place.substr(1);
    else if (!place.empty())
      return wrong;
  } else {
    if (const auto colon = place.find(':'); colon != std::string_view::npos) port = place.substr(colon + 1);
    a.host = place.substr(0, place.find(':'));
  }
  if (port) {
    const auto number = text::number<std::uint16_t>(*port);
    if (!number || *number == 0) return wrong;
    a.port = *number;
  }
  if (a.host.empty() || a.host.find_first_of(" \t\r\n?#") != std::string::npos) return wrong;
  return a;
}

}  // namespace ridgecast::bus
