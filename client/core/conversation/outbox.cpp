#include "client/core/conversation/outbox.h"

#include <utility>

namespace ridgecast::core {

Wrong Outbox::put(const wire::PoseMessage& pose) {
  if (pacing_ == wire::Pacing::kFree) poses_.clear();
  if (poses_.size() >= kMaxPoses) return std::to_string(kMaxPoses) + " poses wait to leave; send the next when iterations have arrived";
  poses_.push_back(pose);
  return std::nullopt;
}

Wrong Outbox::put(wire::ClientMessage message) {
  if (messages_.size() >= kMaxWaiting) return std::to_string(kMaxWaiting) + " messages wait to leave; send fewer at a time";
  messages_.push_back(std::move(message));
  return std::nullopt;
}

void Outbox::put(const wire::ResendLeaves& resend) {
  const bool all = resend.leaves.empty() || (resend_ && resend_->leaves.empty());
  if (!resend_) resend_.emplace();
  resend_->leaves.insert(resend_->leaves.end(), resend.leaves.begin(), resend.leaves.end());
  if (all || resend_->leaves.size() > wire::kMaxResendLeaves) resend_->leaves.clear();
}

std::optional<wire::ClientMessage> Outbox::next() {
  const auto pop = [](auto& queue) -> wire::ClientMessage {
    auto message = std::move(queue.front());
    queue.pop_front();
    return message;
  };
  if (!resumes_.empty()) return pop(resumes_);
  if (resend_) return *std::exchange(resend_, std::nullopt);  // before the hash that it explains
  if (acknowledge_) return *std::exchange(acknowledge_, std::nullopt);
  if (!wants_.empty()) return pop(wants_);
  if (settings_) return wire::ChangeSettings{*std::exchange(settings_, std::nullopt)};
  if (!poses_.empty()) return pop(poses_);
  if (!messages_.empty()) return pop(messages_);
  if (auto query = queries.next()) return std::move(*query);
  if (auto ask = grounds.next()) return std::move(*ask);
  if (auto edit = edits.next()) return std::move(*edit);
  return std::nullopt;
}

}  // namespace ridgecast::core
