#include "server/access/network.h"

#include <gtest/gtest.h>

#include <random>

namespace ridgecast::access {
namespace {

TEST(Network, ReadsAndWritesAddresses) {
  for (const char* text : {"127.0.0.1", "192.0.2.7", "::1", "2001:db8::7", "255.255.255.255", "::"}) {
    const auto address = parseAddress(text);
    ASSERT_TRUE(address) << text;
    EXPECT_EQ(toText(*address), text);
  }
  EXPECT_EQ(parseAddress("192.0.2.7:80"), parseAddress("192.0.2.7"));
  EXPECT_EQ(parseAddress("[2001:db8::7]:80"), parseAddress("2001:db8::7"));
  EXPECT_EQ(parseAddress("::ffff:192.0.2.7"), parseAddress("192.0.2.7"));
  for (const char* text : {"", "a", "1.2.3", "1.2.3.4.5", "1.2.3.256", "1.2.3.4:", "1.2.3.4:x", "[::1", "[::1]x", "unknown", "_hidden",
                           "::1::", "1111:2222:3333:4444:5555:6666:7777:8888:9999:aaaa:bbbb"})
    EXPECT_FALSE(parseAddress(text)) << text;
  EXPECT_FALSE(parseAddress(std::string_view("1.2.3.4\0x", 9)));
}

TEST(Network, KnowsHouseholds) {
  EXPECT_EQ(household(*parseAddress("192.0.2.7")), *parseAddress("192.0.2.7"));
  EXPECT_EQ(household(*parseAddress("2001:db8:1:2:3:4:5:6")), household(*parseAddress("2001:db8:1:2::")));
  EXPECT_NE(household(*parseAddress("2001:db8:1:2::")), household(*parseAddress("2001:db8:1:3::")));
}

TEST(Network, HoldsWhatItsPrefixSays) {
  std::mt19937 random(1);
  for (int k = 0; k < 20'000; ++k) {
    // In whole numbers instead of bytes.
    const std::uint32_t host = static_cast<std::uint32_t>(random()), other = host ^ (random() % 2 ? 1u << (random() % 32) : 0u);
    const unsigned bits = static_cast<unsigned>(random() % 33);
    const std::uint32_t mask = bits == 0 ? 0 : ~std::uint32_t{0} << (32 - bits);
    const auto text = [](std::uint32_t a) {
      return std::to_string(a >> 24) + "." + std::to_string((a >> 16) & 255) + "." + std::to_string((a >> 8) & 255) + "." +
             std::to_string(a & 255);
    };
    const auto network = Network::parse(text(host & mask) + "/" + std::to_string(bits));
    ASSERT_TRUE(network);
    EXPECT_TRUE(network->contains(*parseAddress(text(host))));
    EXPECT_EQ(network->contains(*parseAddress(text(other))), (other & mask) == (host & mask)) << bits;
    EXPECT_FALSE(network->contains(*parseAddress("2001:db8::1")));
  }
  EXPECT_TRUE(Network::parse("2001:db8::/33")->contains(*parseAddress("2001:db8:7fff::1")));
  EXPECT_FALSE(Network::parse("2001:db8::/33")->contains(*parseAddress("2001:db8:8000::1")));
  EXPECT_TRUE(Network::parse("192.0.2.7")->contains(*parseAddress("192.0.2.7")));
  for (const char* text : {"", "/8", "10.0.0.0/", "10.0.0.0/33", "10.0.0.0/x", "10.0.0.0/-1", "10.0.0.1/8", "10.0.0.0/8/8",
                           "2001:db8::/129", "host/8", "10.0.0.0:80/8", "[::1]/128"})
    EXPECT_FALSE(Network::parse(text)) << text;
}

TEST(Network, BelievesProxiesThatAreTrustedAndNobodyElse) {
  const std::vector<Network> proxies{*Network::parse("10.0.0.0/8"), *Network::parse("127.0.0.1")};
  const auto client = [&](const char* peer, const char* forwarded) {
    return toText(clientAddress(*parseAddress(peer), forwarded, proxies));
  };
  EXPECT_EQ(client("192.0.2.1", "203.0.113.9"), "192.0.2.1");
  EXPECT_EQ(client("10.0.0.1", ""), "10.0.0.1");
  EXPECT_EQ(client("10.0.0.1", "203.0.113.9"), "203.0.113.9");
  EXPECT_EQ(client("127.0.0.1", "198.51.100.1, 203.0.113.9 , 10.2.3.4"), "203.0.113.9");
  EXPECT_EQ(client("10.0.0.1", "203.0.113.9, junk"), "10.0.0.1");
  EXPECT_EQ(client("10.0.0.1", "junk, 203.0.113.9"), "203.0.113.9");
  EXPECT_EQ(client("10.0.0.1", "10.0.0.2, 10.0.0.3"), "10.0.0.2");
  EXPECT_EQ(client("10.0.0.1", ",,,"), "10.0.0.1");
  EXPECT_EQ(toText(clientAddress(*parseAddress("10.0.0.1"), "203.0.113.9", {})), "10.0.0.1");
}

}  // namespace
}  // namespace ridgecast::access
