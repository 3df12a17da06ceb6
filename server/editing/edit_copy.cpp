#include "server/editing/edit_copy.h"

#include <algorithm>
#include <utility>

#include "common/edits/author.h"

namespace ridgecast::editing {

using edit_store::Applied;
using edit_store::Change;

Outcome<void> EditCopy::prepare(std::string_view client) {
  const std::lock_guard lock(mutex_);
  return make(client);
}

Outcome<void> EditCopy::make(std::string_view client) {
  if (store_) return {};
  auto made = makeStore_(client);
  if (!made) return made.error();
  store_ = std::move(*made);
  return {};
}

std::uint64_t EditCopy::last() const {
  const std::lock_guard lock(mutex_);
  return behind_.empty() ? (store_ ? store_->last() : 0) : behind_.back().number;
}

std::uint64_t EditCopy::compacted() const {
  const std::lock_guard lock(mutex_);
  return store_ ? store_->compacted() : 0;
}

std::uint64_t EditCopy::bytes() const {
  const std::lock_guard lock(mutex_);
  return (store_ ? store_->bytes() : 0) + bytesBehind_;
}

Outcome<void> EditCopy::append(std::span<const Applied> edits, const Change& change) {
  const std::lock_guard lock(mutex_);
  const bool wasBehind = !behind_.empty();
  Outcome<void> stored = edits.empty() ? Outcome<void>() : make(edits::clientOf(edits.front().author));
  if (stored && !wasBehind) {  // the usual case
    stored = store_->append(edits, change);
    if (stored) return stored;
  }
  if (!wasBehind) before_ = change.before;
  posts_.insert(posts_.end(), change.posts.begin(), change.posts.end());
  behind_.insert(behind_.end(), edits.begin(), edits.end());
  for (const Applied& e : edits) bytesBehind_ += e.bytes();
  if (stored) stored = store_->append(behind_, {before_, change.after, posts_});
  if (stored) {
    tell_("This server's copy of the session's edits is complete again.", true);
    behind_ = {}, posts_ = {}, before_ = {}, bytesBehind_ = 0;
    return {};
  }
  if (bytesBehind_ > kMaxBehind)
    return Error{"More than " + std::to_string(kMaxBehind >> 20) +
                 " MiB of the session's edits could not be stored: " + stored.error().message};
  tell_("This server's copy of the session's edits is behind the shared log: " + stored.error().message, false);
  return {};
}

Outcome<std::vector<Applied>> EditCopy::read(std::uint64_t after, std::size_t most) {
  const std::lock_guard lock(mutex_);
  if (behind_.empty() || after + 1 < behind_.front().number) return store_ ? store_->read(after, most) : std::vector<Applied>();
  std::vector<Applied> out;
  std::uint64_t bytes = 0;
  for (std::uint64_t k = after + 1 - behind_.front().number; k < behind_.size(); ++k) {
    bytes += behind_[k].bytes();
    if (bytes > most && !out.empty()) break;
    out.push_back(behind_[k]);
  }
  return out;
}

Outcome<std::optional<std::uint64_t>> EditCopy::numberOf(const std::string& key) {
  const std::lock_guard lock(mutex_);
  const auto found = key.empty() ? behind_.end() : std::ranges::find(behind_, key, &Applied::key);
  if (found != behind_.end()) return std::optional(found->number);
  return store_ ? store_->numberOf(key) : std::optional<std::uint64_t>();
}

Outcome<std::string> EditCopy::copy(std::size_t most) {
  const std::lock_guard lock(mutex_);
  if (!behind_.empty()) return Error{"This server has not stored the last edits yet; ask again in a moment."};
  return store_ ? store_->copy(most) : Store::copy(most);
}

}  // namespace ridgecast::editing
