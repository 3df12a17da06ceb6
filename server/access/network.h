#pragma once
// Client addresses, and which proxies are trusted to report them.

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/outcome/outcome.h"

namespace ridgecast::access {

using Address = std::array<std::uint8_t, 16>;  // IPv6; IPv4 as ::ffff:a.b.c.d

std::optional<Address> parseAddress(std::string_view text);  // 192.0.2.1, 2001:db8::1, [2001:db8::1]; with :PORT behind an IPv4 or a ]
std::string toText(const Address& address);                  // 192.0.2.1, 2001:db8::1
// The addresses that one client can choose from: an IPv4 address, or an IPv6 /64.
Address household(const Address& address);

class Network {
 public:
  // 10.0.0.0/8, 2001:db8::/32, or an address. Error: none of these, or bits beyond the prefix.
  static Outcome<Network> parse(std::string_view text);
  bool contains(const Address& address) const;

 private:
  Address address_{};
  unsigned bits_ = 128;
};

// The client: the peer, or behind trusted proxies the last address in X-Forwarded-For that is not a trusted proxy. Reading stops at an
// entry that is not an address.
Address clientAddress(const Address& peer, std::string_view forwardedFor, const std::vector<Network>& trustedProxies);

}  // namespace ridgecast::access
