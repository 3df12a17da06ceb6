#include "server/access/issuer_keys.h"

#include <utility>

#include "common/outcome/contract.h"
#include "server/access/jwt.h"

namespace ridgecast::access {

IssuerKeys::IssuerKeys(Fetch fetch, std::function<void(std::vector<Key>)> changed, std::function<void(const Error&)> failed,
                       std::chrono::milliseconds every)
    : fetch_(std::move(fetch)), changed_(std::move(changed)), failed_(std::move(failed)), every_(every) {
  expects(fetch_ && changed_ && failed_, "keys come from somewhere, and go to somebody");
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

IssuerKeys::~IssuerKeys() = default;  // stops the thread and waits for it

Outcome<std::vector<Key>> IssuerKeys::fetch() { return fetch(std::stop_token()); }

Outcome<std::vector<Key>> IssuerKeys::fetch(const std::stop_token& stop) {
  {
    const std::lock_guard lock(mutex_);
    fetched_ = std::chrono::steady_clock::now();
  }
  const auto text = fetch_(stop);
  if (!text) return text.error();
  auto keys = Key::readSet(*text);
  if (!keys) return Error{"The answer of the tokens' issuer cannot be used: " + keys.error().message + "."};
  const std::lock_guard lock(mutex_);
  known_.clear();
  for (const Key& key : *keys) known_.insert(key.id());
  return keys;
}

bool IssuerKeys::mayKnowSoon(std::string_view token) {
  const std::string id = keyIdOf(token);
  if (id.empty()) return false;
  const std::lock_guard lock(mutex_);
  if (known_.contains(id)) return false;
  if (!isFetching_ && fetched_ && std::chrono::steady_clock::now() - *fetched_ < every_) return false;
  isFetching_ = true;
  wake_.notify_one();
  return true;
}

void IssuerKeys::run(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (wake_.wait(lock, stop, [this] { return isFetching_; })) {
    lock.unlock();
    auto keys = fetch(stop);
    if (!stop.stop_requested()) keys ? changed_(std::move(*keys)) : failed_(keys.error());
    lock.lock();
    isFetching_ = false;
  }
}

}  // namespace ridgecast::access
