#include "server/access/limits.h"

namespace ridgecast::access {

std::optional<ConnectionsByAddress::Place> ConnectionsByAddress::enter(const Address& client) {
  const Address who = household(client);
  const std::lock_guard lock(state_->mutex);
  std::uint32_t& count = state_->counts[who];
  if (mostEach_ != 0 && count >= mostEach_) return std::nullopt;
  ++count;
  return Place(state_, who);
}

ConnectionsByAddress::Place::~Place() {
  if (!state_) return;
  const std::lock_guard lock(state_->mutex);
  const auto found = state_->counts.find(who_);
  if (--found->second == 0) state_->counts.erase(found);
}

}  // namespace ridgecast::access
