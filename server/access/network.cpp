#include "server/access/network.h"

#include <arpa/inet.h>

#include <algorithm>

#include "common/text/text.h"

namespace ridgecast::access {

namespace {

constexpr std::array<std::uint8_t, 12> kMapped{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};

bool isIpv4(const Address& address) { return std::equal(kMapped.begin(), kMapped.end(), address.begin()); }

bool portFollows(std::string_view text) {
  return text.empty() || (text.front() == ':' && text.size() > 1 && text.size() <= 6 &&
                          std::all_of(text.begin() + 1, text.end(), [](char c) { return c >= '0' && c <= '9'; }));
}

}  // namespace

std::optional<Address> parseAddress(std::string_view text) {
  Address address{};
  if (text.starts_with('[')) {
    const auto close = text.find(']');
    if (close == std::string_view::npos || !portFollows(text.substr(close + 1))) return std::nullopt;
    text = text.substr(1, close - 1);
  } else if (const auto colon = text.find(':'); colon != std::string_view::npos && text.find(':', colon + 1) == std::string_view::npos) {
    if (!portFollows(text.substr(colon))) return std::nullopt;
    text = text.substr(0, colon);
  }
  if (text.size() >= INET6_ADDRSTRLEN || text.find('\0') != std::string_view::npos) return std::nullopt;
  char zeroEnded[INET6_ADDRSTRLEN] = {};
  std::copy(text.begin(), text.end(), zeroEnded);
  if (inet_pton(AF_INET6, zeroEnded, address.data()) == 1) return address;
  std::copy(kMapped.begin(), kMapped.end(), address.begin());
  if (inet_pton(AF_INET, zeroEnded, address.data() + kMapped.size()) == 1) return address;
  return std::nullopt;
}

std::string toText(const Address& address) {
  char text[INET6_ADDRSTRLEN] = {};
  if (isIpv4(address))
    inet_ntop(AF_INET, address.data() + kMapped.size(), text, sizeof text);
  else
    inet_ntop(AF_INET6, address.data(), text, sizeof text);
  return text;
}

Address household(const Address& address) {
  Address out = address;
  if (!isIpv4(address)) std::fill(out.begin() + 8, out.end(), std::uint8_t{0});
  return out;
}

Outcome<Network> Network::parse(std::string_view text) {
  const auto wrong = [&](const char* why) {
    return Error{"'" + std::string(text.substr(0, 60)) + "' is not a network: " + why +
                 " (for example 10.0.0.0/8, 2001:db8::/32 or 192.0.2.7)."};
  };
  const auto slash = std::min(text.find('/'), text.size());
  const std::string_view host = text.substr(0, slash);
  const auto address = host.find_first_of("[]") == std::string_view::npos ? parseAddress(host) : std::nullopt;
  const bool withPort = host.find('.') != std::string_view::npos && std::count(host.begin(), host.end(), ':') == 1;
  if (!address || withPort) return wrong("its address is none");
  Network network;
  network.address_ = *address;
  const unsigned most = host.find(':') == std::string_view::npos ? 32 : 128;
  const unsigned bits = slash < text.size() ? text::number<unsigned>(text.substr(slash + 1)).value_or(most + 1) : most;
  if (bits > most) return wrong("a number of bits belongs after the /");
  network.bits_ = bits + (most == 32 ? 96 : 0);
  for (unsigned bit = network.bits_; bit < 128; ++bit)
    if (network.address_[bit / 8] & (0x80u >> (bit % 8))) return wrong("it has bits beyond its prefix");
  return network;
}

bool Network::contains(const Address& address) const {
  for (unsigned byte = 0; byte < 16; ++byte) {
    const unsigned left = bits_ > 8 * byte ? std::min(8u, bits_ - 8 * byte) : 0;
    const auto mask = static_cast<std::uint8_t>(0xff00u >> left);
    if ((address[byte] & mask) != (address_[byte] & mask)) return false;
  }
  return true;
}

Address clientAddress(const Address& peer, std::string_view forwardedFor, const std::vector<Network>& trustedProxies) {
  const auto trusted = [&](const Address& a) {
    return std::any_of(trustedProxies.begin(), trustedProxies.end(), [&](const Network& n) { return n.contains(a); });
  };
  Address client = peer;
  while (!forwardedFor.empty() && trusted(client)) {
    const auto comma = forwardedFor.rfind(',');
    const auto last = parseAddress(text::trimmed(comma == std::string_view::npos ? forwardedFor : forwardedFor.substr(comma + 1)));
    if (!last) break;
    client = *last;
    forwardedFor = comma == std::string_view::npos ? std::string_view() : forwardedFor.substr(0, comma);
  }
  return client;
}

}  // namespace ridgecast::access
