#include "server/access/issuer_keys.h"

#include <gtest/gtest.h>

#include <atomic>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "server/access/crypto.h"
#include "tests/support/waiting.h"

namespace ridgecast::access {
namespace {

using namespace std::chrono_literals;
using testing_support::await;

// RFC 7515, appendix A.3, under this name.
std::string setOf(const std::string& kid) {
  return R"({"keys":[{"kid":")" + kid +
         R"(","kty":"EC","crv":"P-256","x":"f83OJ3D2xF1Bg8vub9tLe1gHMzV76e8Tus9uPHvRVEU",)"
         R"("y":"x_FEzRu9m36HLN_tue659LNpXW6pCyStikYjKIWI5a0"}]})";
}
std::string tokenOf(const std::string& header) { return base64url(header) + ".e30.AAAA"; }
std::string tokenOfKey(const std::string& kid) { return tokenOf(R"({"alg":"ES256","kid":")" + kid + "\"}"); }

// An issuer whose answers a test gives, and the keys that were taken.
struct Issuer {
  Outcome<std::string> answer(const std::stop_token& stop) {
    ++fetches;
    while (isSlow && !stop.stop_requested()) std::this_thread::sleep_for(1ms);
    const std::lock_guard lock(mutex);
    if (!text) return Error{"The network is down."};
    return Outcome<std::string>(boost::system::in_place_value, *text);
  }
  void publish(std::optional<std::string> next) {  // none: it cannot be reached
    const std::lock_guard lock(mutex);
    text = std::move(next);
  }
  IssuerKeys::Fetch fetch() {
    return [this](const std::stop_token& stop) { return answer(stop); };
  }
  std::mutex mutex;
  std::optional<std::string> text = setOf("first");
  std::atomic<int> fetches{0}, changes{0}, failures{0};
  std::atomic<bool> isSlow{false};
  IssuerKeys keysEvery(std::chrono::milliseconds every) {
    return IssuerKeys(
        fetch(), [this](const std::vector<Key>&) { ++changes; }, [this](const Error&) { ++failures; }, every);
  }
};

TEST(IssuerKeys, AreFetchedAgainWhenATokenNamesAnother) {
  Issuer issuer;
  IssuerKeys keys = issuer.keysEvery(0ms);
  ASSERT_EQ(keys.fetch().value().front().id(), "first");
  EXPECT_FALSE(keys.mayKnowSoon(tokenOfKey("first"))) << "it is known: the token is bad for another reason";
  for (const std::string& token : {tokenOf(R"({"alg":"ES256"})"), tokenOf("[]"), std::string("rc_abc"), std::string(10'000, 'x')})
    EXPECT_FALSE(keys.mayKnowSoon(token));
  EXPECT_EQ(issuer.fetches, 1);
  issuer.publish(setOf("second"));
  EXPECT_TRUE(keys.mayKnowSoon(tokenOfKey("second")));
  EXPECT_TRUE(await([&] { return issuer.changes == 1; }));
  EXPECT_TRUE(await([&] { return !keys.mayKnowSoon(tokenOfKey("second")); }));
  issuer.publish(std::nullopt);
  EXPECT_TRUE(keys.mayKnowSoon(tokenOfKey("third")));
  EXPECT_TRUE(await([&] { return issuer.failures == 1; }));
  EXPECT_FALSE(keys.mayKnowSoon(tokenOfKey("second"))) << "the keys stay";
  issuer.publish("<html>");
  EXPECT_TRUE(await([&] { return keys.mayKnowSoon(tokenOfKey("third")) && issuer.failures >= 2; }));
}

TEST(IssuerKeys, AreFetchedOnceAMinuteAtMost) {
  Issuer issuer;
  IssuerKeys keys = issuer.keysEvery(1h);
  ASSERT_TRUE(keys.fetch());
  for (int k = 0; k < 1000; ++k) EXPECT_FALSE(keys.mayKnowSoon(tokenOfKey(std::to_string(k))));
  EXPECT_EQ(issuer.fetches, 1);
}

TEST(IssuerKeys, AFetchInProgressIsSharedAndStops) {
  Issuer issuer;
  {
    IssuerKeys keys = issuer.keysEvery(0ms);
    ASSERT_TRUE(keys.fetch());
    issuer.isSlow = true;
    for (int k = 0; k < 100; ++k) EXPECT_TRUE(keys.mayKnowSoon(tokenOfKey(std::to_string(k)))) << k;
    EXPECT_TRUE(await([&] { return issuer.fetches == 2; }));
    for (int k = 0; k < 100; ++k) EXPECT_TRUE(keys.mayKnowSoon(tokenOfKey(std::to_string(k)))) << k;
  }
  EXPECT_EQ(issuer.fetches, 2);
  EXPECT_EQ(issuer.changes + issuer.failures, 0) << "nobody is told any more";
}

}  // namespace
}  // namespace ridgecast::access
