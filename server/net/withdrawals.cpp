#include "server/net/withdrawals.h"

#include <algorithm>
#include <map>
#include <string_view>
#include <utility>

#include "common/text/text.h"
#include "server/logging/logging.h"

namespace ridgecast::net {

namespace {

constexpr std::string_view kWithdrawn = "withdrawn/";  // withdrawn/TIME/SERVER/PART/ -> HASH HASH ...

}  // namespace

Withdrawals::Withdrawals(std::shared_ptr<bus::Bus> bus, const scheduling::Timer& timer, std::function<void(const Hashes&)> withdraw)
    : bus_(std::move(bus)), timer_(timer), withdraw_(std::move(withdraw)) {}

void Withdrawals::begin() {
  if (bus_->server() != 0) look();
}

void Withdrawals::loaded(const Hashes& withdrawn) {
  const std::int64_t now = bus_->now();
  {
    const std::lock_guard lock(mutex_);
    loadedAt_ = now;
  }
  for (std::size_t at = 0; at < withdrawn.size(); at += kAtATime) {
    std::string hashes;
    for (std::size_t k = at; k < std::min(withdrawn.size(), at + kAtATime); ++k) hashes += withdrawn[k] + " ";
    const std::string key =
        std::string(kWithdrawn) + std::to_string(now) + "/" + std::to_string(bus_->server()) + "/" + std::to_string(at / kAtATime) + "/";
    bus_->hold(key, std::move(hashes), 0, kLife, [](const Outcome<bus::Bus::Held>& held) {
      if (!held) logging::error("the other servers were not told of withdrawn tokens, reload each of them: " + held.error().message);
    });
  }
}

void Withdrawals::look() {
  timer_.at(timer_.now() + kLookEvery, [weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->look();
  });
  bus_->list(std::string(kWithdrawn), [weak = weak_from_this()](const Outcome<std::map<std::string, bus::Record>>& records) {
    const auto self = weak.lock();
    if (!self || !records) return;
    Hashes withdrawn;
    {
      const std::lock_guard lock(self->mutex_);
      std::set<std::string> known;
      for (const auto& [key, record] : *records) {
        known.insert(key);
        std::string_view rest = std::string_view(key).substr(kWithdrawn.size());
        const auto time = text::number<std::int64_t>(text::takePart(rest, '/'));
        const auto server = text::number<std::uint32_t>(text::takePart(rest, '/'));
        if (!time || *time <= self->loadedAt_ || server == self->bus_->server() || self->known_.contains(key)) continue;
        for (std::string_view hashes = record.value; !hashes.empty();) withdrawn.emplace_back(text::takePart(hashes, ' '));
      }
      self->known_ = std::move(known);
    }
    if (!withdrawn.empty()) self->withdraw_(withdrawn);
  });
}

}  // namespace ridgecast::net
