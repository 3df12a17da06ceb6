#pragma once
// The public keys that an issuer of JSON Web Tokens publishes at a URL, as they change: fetched at the start, when told to, and when a
// token names a key that is not known, at most once a minute. If that fails, the keys stay that there were.

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <set>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/access/keys.h"

namespace ridgecast::access {

// Any thread. One thread of its own fetches, so that nobody who is judged waits.
class IssuerKeys {
 public:
  // The JSON Web Key Set: takes as long as its timeout, but returns soon after a stop. Error: one sentence.
  using Fetch = std::function<Outcome<std::string>(const std::stop_token& stop)>;
  static constexpr std::chrono::milliseconds kEvery{60'000};

  // `changed` takes the keys, and `failed` the sentence, of each fetch by its own thread.
  IssuerKeys(Fetch fetch, std::function<void(std::vector<Key>)> changed, std::function<void(const Error&)> failed,
             std::chrono::milliseconds every = kEvery);
  ~IssuerKeys();
  IssuerKeys(const IssuerKeys&) = delete;
  IssuerKeys& operator=(const IssuerKeys&) = delete;

  // Now, by the calling thread. Error: one sentence; they cannot be fetched, or are none.
  Outcome<std::vector<Key>> fetch();
  // Whether a token that is refused may be good in a moment: it names a key that is not known, and the keys are being fetched, which begins
  // if the last time was kEvery ago.
  bool mayKnowSoon(std::string_view token);

 private:
  void run(const std::stop_token& stop);
  Outcome<std::vector<Key>> fetch(const std::stop_token& stop);

  const Fetch fetch_;
  const std::function<void(std::vector<Key>)> changed_;
  const std::function<void(const Error&)> failed_;
  const std::chrono::milliseconds every_;
  std::mutex mutex_;
  std::condition_variable_any wake_;
  std::set<std::string, std::less<>> known_;                      // kids, as last fetched
  std::optional<std::chrono::steady_clock::time_point> fetched_;  // when the last fetch began
  bool isFetching_ = false;                                       // its thread does, or is to
  std::jthread thread_;                                           // last: it uses the others
};

}  // namespace ridgecast::access
