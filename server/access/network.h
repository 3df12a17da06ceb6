#pragma once
// Addresses of clients, and whose word is taken for them.

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
// What one client has of addresses to choose from: an IPv4 address, or a /64 of IPv6.
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

// The client: the peer, or behind trusted proxies the last address of X-Forwarded-For that is none of them. Reading that header ends at an
// entry that is no address.
Address clientAddress(const Address& peer, std::string_view forwardedFor, const std::vector<Network>& trustedProxies);

}  // namespace ridgecast::access
