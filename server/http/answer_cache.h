#pragma once
// An LRU cache, by etag, of answers that took long to make, so that a repeated request is answered at once. Holds at most `bytes`; an
// answer of more than a quarter of that is not held. Any thread.

#include <cstddef>
#include <list>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>

#include "server/http/routes.h"

namespace ridgecast::http {

class AnswerCache {
 public:
  explicit AnswerCache(std::size_t bytes) : most_(bytes) {}

  std::optional<Answer> find(const std::string& etag);
  void keep(const Answer& answer);  // a 200 with an etag; others are not held
  std::size_t bytes() const;        // held, with 1 KiB for each answer's header

 private:
  static std::size_t sizeOf(const Answer& answer) { return answer.body.size() + 1024; }

  const std::size_t most_;
  mutable std::mutex mutex_;
  std::size_t bytes_ = 0;
  std::list<Answer> answers_;  // the last wanted first
  std::unordered_map<std::string, std::list<Answer>::iterator> byEtag_;
};

}  // namespace ridgecast::http
