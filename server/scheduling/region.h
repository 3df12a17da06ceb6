#pragma once
// Parallel loops as threads see them: each hands out its work in its own way. Private to the room.
//
// A region lives on its caller's stack. Helpers join and leave it under the executor's lock, and the caller leaves only when the last
// helper has left, so no helper ever sees a region that is gone.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <utility>
#include <vector>

#include "common/outcome/contract.h"
#include "server/scheduling/pool.h"
#include "server/scheduling/threads.h"

namespace ridgecast::scheduling {

inline bool never() { return false; }

class Region {
 public:
  virtual bool wantsHelp() const = 0;
  // Works until nothing is left to start, or until `leave()` after any task. Must not throw.
  virtual void help(const std::function<bool()>& leave) noexcept = 0;

  Atomic<unsigned> helpers{0};  // changed under the executor's lock
  Condition helpersGone;

 protected:
  ~Region() = default;
};

// forEach: an atomic counter.
class Range final : public Region {
 public:
  Range(std::size_t count, std::size_t grain, const std::function<void(std::size_t)>& body) : count_(count), grain_(grain), body_(body) {}

  bool wantsHelp() const override { return next_.load() < count_; }

  void help(const std::function<bool()>& leave) noexcept override {
    while (batch())
      if (leave()) return;
  }

  bool batch() noexcept {
    // Checked before it is raised, so that late helpers cannot make the counter wrap.
    if (next_.load(std::memory_order_relaxed) >= count_) return false;
    const std::size_t begin = next_.fetch_add(grain_);
    if (begin >= count_) return false;
    const std::size_t end = begin + std::min(grain_, count_ - begin);
    for (std::size_t k = begin; k < end; ++k) body_(k);
    return true;
  }

 private:
  const std::size_t count_, grain_;
  const std::function<void(std::size_t)>& body_;
  Atomic<std::size_t> next_{0};
};

// forEachOrdered: a heap of tasks that are ready, under a lock of its own.
class Ordered final : public Region {
 public:
  Ordered(const Order& order, const std::function<void(std::size_t)>& body, std::function<void()> callHelp)
      : count_(order.size()), body_(body), callHelp_(std::move(callHelp)), missing_(count_), first_(count_ + 1) {
    for (std::size_t k = 0; k < count_; ++k) {
      missing_[k] = static_cast<std::uint32_t>(order[k].size());
      for (const std::uint32_t p : order[k]) {
        expects(p < k, "a predecessor is smaller");
        ++first_[p + 1];
      }
    }
    for (std::size_t k = 0; k < count_; ++k) first_[k + 1] += first_[k];
    followers_.resize(first_[count_]);
    std::vector<std::uint32_t> fill(first_.begin(), first_.end() - 1);
    for (std::size_t k = 0; k < count_; ++k)
      for (const std::uint32_t p : order[k]) followers_[fill[p]++] = static_cast<std::uint32_t>(k);
    for (std::size_t k = 0; k < count_; ++k)
      if (missing_[k] == 0) ready_.push_back(static_cast<std::uint32_t>(k));  // ascending is a heap already
    readyCount_ = ready_.size();
  }

  bool wantsHelp() const override { return readyCount_.load() > 0; }

  void help(const std::function<bool()>& leave) noexcept override { work(false, leave); }
  void lead() noexcept { work(true, never); }

 private:
  void work(bool caller, const std::function<bool()>& leave) noexcept {
    std::unique_lock lock(mutex_);
    for (;;) {
      if (ready_.empty()) {
        if (done_ == count_) return;
        lock.unlock();
        const bool more = spinUntil(
            [&] { return readyCount_.load(std::memory_order_relaxed) > 0 || finished_.load(std::memory_order_relaxed) || leave(); });
        lock.lock();
        if (caller) {
          callerWaits_ = true;
          wake_.wait(lock, [&] { return !ready_.empty() || done_ == count_; });
          callerWaits_ = false;
        } else if (!more || leave()) {
          return;
        }
        continue;
      }
      std::pop_heap(ready_.begin(), ready_.end(), std::greater<>());
      const std::uint32_t task = ready_.back();
      ready_.pop_back();
      readyCount_ = ready_.size();
      lock.unlock();
      body_(task);
      lock.lock();
      finish(task);
      if (done_ == count_) {
        finished_ = true;
        if (callerWaits_) wake_.notify_one();
        return;
      }
      std::size_t spare = ready_.size();
      const bool leaving = leave();
      if (spare > 0 && !leaving) --spare;  // one for this thread
      if (spare > 0 && callerWaits_) {
        wake_.notify_one();
        --spare;
      }
      if (spare > 0) {
        lock.unlock();
        callHelp_();
        lock.lock();
      }
      if (leaving) return;
    }
  }

  void finish(std::uint32_t task) {  // what waited for it may start
    expects(done_ < count_, "each task is done once");
    ++done_;
    for (std::uint32_t f = first_[task]; f < first_[task + 1]; ++f) {
      expects(missing_[followers_[f]] > 0, "a task waits for each predecessor once");
      if (--missing_[followers_[f]] > 0) continue;
      ready_.push_back(followers_[f]);
      std::push_heap(ready_.begin(), ready_.end(), std::greater<>());
    }
    readyCount_ = ready_.size();
  }

  const std::size_t count_;
  const std::function<void(std::size_t)>& body_;
  const std::function<void()> callHelp_;
  std::vector<std::uint32_t> missing_;  // predecessors that are not done
  std::vector<std::uint32_t> first_, followers_;
  Mutex mutex_;
  Condition wake_;                    // the caller's
  std::vector<std::uint32_t> ready_;  // a heap, least first
  Atomic<std::size_t> readyCount_{0};
  Atomic<bool> finished_{false};
  std::size_t done_ = 0;
  bool callerWaits_ = false;
};

}  // namespace ridgecast::scheduling
