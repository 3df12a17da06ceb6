#include "server/http/answer_cache.h"

#include "common/outcome/contract.h"

namespace ridgecast::http {

std::optional<Answer> AnswerCache::find(const std::string& etag) {
  const std::lock_guard lock(mutex_);
  const auto found = byEtag_.find(etag);
  if (found == byEtag_.end()) return std::nullopt;
  answers_.splice(answers_.begin(), answers_, found->second);
  return answers_.front();
}

void AnswerCache::keep(const Answer& answer) {
  const std::size_t size = sizeOf(answer);
  if (answer.status != 200 || answer.etag.empty() || size > most_ / 4) return;
  const std::lock_guard lock(mutex_);
  if (byEtag_.contains(answer.etag)) return;
  for (; bytes_ + size > most_; answers_.pop_back()) {
    expects(!answers_.empty() && bytes_ >= sizeOf(answers_.back()), "what is cached is counted");
    bytes_ -= sizeOf(answers_.back());
    byEtag_.erase(answers_.back().etag);
  }
  answers_.push_front(answer);
  byEtag_.emplace(answer.etag, answers_.begin());
  bytes_ += size;
}

std::size_t AnswerCache::bytes() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

}  // namespace ridgecast::http
