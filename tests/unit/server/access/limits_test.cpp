#include "server/access/limits.h"

#include <gtest/gtest.h>

#include <thread>
#include <vector>

namespace ridgecast::access {
namespace {

TEST(ConnectionsByAddress, CountsEachClientAlone) {
  const Address a = *parseAddress("192.0.2.1"), b = *parseAddress("192.0.2.2");
  ConnectionsByAddress connectionsByAddress(2);
  auto first = connectionsByAddress.enter(a), second = connectionsByAddress.enter(a);
  ASSERT_TRUE(first && second);
  EXPECT_FALSE(connectionsByAddress.enter(a));
  auto other = connectionsByAddress.enter(b);
  EXPECT_TRUE(other);
  first.reset();
  auto third = connectionsByAddress.enter(a);
  ASSERT_TRUE(third);
  EXPECT_FALSE(connectionsByAddress.enter(a));
  *third = std::move(*other);  // gives a's back in its stead
  other.reset();
  EXPECT_TRUE(connectionsByAddress.enter(a));
  // Neighbours in one /64 are one client.
  auto six = connectionsByAddress.enter(*parseAddress("2001:db8::1")), more = connectionsByAddress.enter(*parseAddress("2001:db8::2"));
  EXPECT_FALSE(connectionsByAddress.enter(*parseAddress("2001:db8::3")));
  EXPECT_TRUE(connectionsByAddress.enter(*parseAddress("2001:db8:0:1::3")));
}

TEST(ConnectionsByAddress, IsExactAmongThreadsAndOutlived) {
  std::optional<ConnectionsByAddress::Place> last;
  {
    ConnectionsByAddress connectionsByAddress(5);
    std::atomic<int> inside{0}, most{0};
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t)
      threads.emplace_back([&] {
        for (int k = 0; k < 2000; ++k) {
          std::vector<ConnectionsByAddress::Place> places;
          for (int j = 0; j < 3; ++j)
            if (auto place = connectionsByAddress.enter(*parseAddress("192.0.2.1"))) {
              places.push_back(std::move(*place));
              const int now = ++inside;
              for (int seen = most; now > seen && !most.compare_exchange_weak(seen, now);) {
              }
            }
          inside -= static_cast<int>(places.size());
        }
      });
    for (auto& thread : threads) thread.join();
    EXPECT_LE(most, 5);
    last = connectionsByAddress.enter(*parseAddress("192.0.2.1"));
  }
  last.reset();
}

}  // namespace
}  // namespace ridgecast::access
