#include "server/editing/ground_check.h"

#include <algorithm>
#include <utility>

#include "common/text/text.h"

namespace ridgecast::editing {

void GroundCheck::add(std::uint64_t edit, std::uint64_t identity, std::shared_ptr<const edits::Layer> layer) {
  const std::lock_guard lock(mutex_);
  waiting_.push_back({edit, identity, std::move(layer)});
  if (waiting_.size() > kMaxWaiting) waiting_.pop_front();
  if (!std::exchange(works_, true)) pool_->post([self = shared_from_this()] { self->work(); });
}

void GroundCheck::work() {
  constexpr std::size_t kTilesOfTurn = 1000;  // a millisecond
  if (!now_.layer) {
    const std::lock_guard lock(mutex_);
    if (waiting_.empty()) {
      works_ = false;
      return;
    }
    now_ = std::move(waiting_.front());
    waiting_.pop_front();
    tiles_ = now_.layer->addresses();
    next_ = 0, sum_ = 0;
  }
  for (const std::size_t end = std::min(tiles_.size(), next_ + kTilesOfTurn); next_ < end; ++next_)
    sum_ += now_.layer->hashOf(tiles_[next_]);
  if (next_ == tiles_.size()) {
    compare(now_, sum_);
    now_ = {}, tiles_ = {};
  }
  pool_->post([self = shared_from_this()] { self->work(); });
}

void GroundCheck::compare(const Ground& ground, std::uint64_t hash) const {
  const std::string ours = text::hexadecimal(ground.identity) + ' ' + text::hexadecimal(hash);
  bus_->hold("ground/" + session_ + "/" + std::to_string(ground.edit), ours, 0, kLife,
             [differs = differs_, ours, edit = ground.edit](const auto& held) {
               if (!held || held->isYours) return;
               std::string_view mine = ours, theirs = held->record.value;
               const bool isOfOneEdit = text::takePart(mine, ' ') == text::takePart(theirs, ' ');
               if (isOfOneEdit && mine != theirs)
                 differs("the ground after edit " + std::to_string(edit) + " has the hash " + std::string(mine) + " here, and " +
                         std::string(theirs) + " on another server");
             });
}

}  // namespace ridgecast::editing
