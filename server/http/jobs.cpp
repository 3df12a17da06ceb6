#include "server/http/jobs.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <utility>

#include "common/outcome/contract.h"
#include "server/logging/logging.h"
#include "server/scheduling/pool.h"

namespace ridgecast::http {

Jobs::Jobs(const Limits& limits) : limits_(limits), running_(std::max(1u, limits.threads)) {
  idle_ = running_.size();
  for (std::size_t k = 0; k < running_.size(); ++k) threads_.emplace_back([this, k] { work(k); });
}

Jobs::~Jobs() { stop(); }

bool Jobs::post(std::stop_source stop, std::function<std::optional<RetryAt>(std::stop_token)> run, std::string client) {
  expects(run && stop.stop_possible(), "a job can be run and stopped");
  std::vector<Job> dropped;  // destroyed after unlocking
  {
    const std::lock_guard lock(mutex_);
    if (closed_) return false;
    const auto abandoned =
        std::stable_partition(waiting_.begin(), waiting_.end(), [](const Job& job) { return !job.stop.stop_requested(); });
    std::move(abandoned, waiting_.end(), std::back_inserter(dropped));
    waiting_.erase(abandoned, waiting_.end());
    if (waiting_.size() >= limits_.waiting + idle_ || hasShareNow(client)) return false;
    waiting_.push_back({std::move(stop), std::move(run), std::move(client)});
  }
  changed_.notify_one();
  return true;
}

void Jobs::wake(const std::stop_source& job) {
  const std::lock_guard lock(mutex_);
  for (Job& other : running_) other.isWoken = other.isWoken || other.stop == job;
  for (Job& other : waiting_)
    if (other.stop == job) other.notBefore = {};
  changed_.notify_one();
}

void Jobs::answered(const std::stop_source& job) {
  const std::lock_guard lock(mutex_);
  for (Job& other : running_)
    if (other.stop == job) other.client.clear();
}

bool Jobs::hasShareNow(std::string_view client) const {
  const auto isOwn = [&](const Job& job) { return job.client == client; };
  return !client.empty() &&
         static_cast<std::size_t>(std::ranges::count_if(waiting_, isOwn) + std::ranges::count_if(running_, isOwn)) >= share();
}

bool Jobs::hasShare(std::string_view client) const {
  const std::lock_guard lock(mutex_);
  return hasShareNow(client);
}

std::size_t Jobs::ahead(const std::stop_source& job) const {
  const std::lock_guard lock(mutex_);
  const auto at = std::ranges::find_if(waiting_, [&](const Job& other) { return other.stop == job; });
  return at == waiting_.end() ? 0 : static_cast<std::size_t>(at - waiting_.begin()) + 1;
}

unsigned Jobs::secondsToWait() const {
  const std::lock_guard lock(mutex_);
  const double seconds = usual_ * static_cast<double>(waiting_.size() + 1) / static_cast<double>(running_.size());
  return static_cast<unsigned>(std::clamp(std::ceil(seconds), 1.0, 600.0));
}

std::size_t Jobs::waiting() const {
  const std::lock_guard lock(mutex_);
  return waiting_.size();
}

void Jobs::finish(Clock::time_point until) {
  {
    std::unique_lock lock(mutex_);
    closed_ = true;
    ended_.wait_until(lock, until, [this] { return stopped_ || (waiting_.empty() && idle_ == running_.size()); });
  }
  stop();
}

void Jobs::stop() {
  std::deque<Job> dropped;
  std::vector<std::thread> threads;
  {
    const std::lock_guard lock(mutex_);
    closed_ = stopped_ = true;
    dropped.swap(waiting_);
    threads.swap(threads_);
    for (Job& job : running_) job.stop.request_stop();
  }
  changed_.notify_all();
  for (std::thread& thread : threads) {
    expects(thread.get_id() != std::this_thread::get_id(), "no job ends its own queue");
    thread.join();
  }
}

Jobs::Job Jobs::next(std::unique_lock<std::mutex>& lock) {
  for (;;) {
    if (stopped_) return {};
    const auto now = Clock::now();
    const auto due = std::ranges::find_if(waiting_, [&](const Job& job) { return job.notBefore <= now; });
    if (due != waiting_.end()) {
      Job job = std::move(*due);
      waiting_.erase(due);
      if (!job.client.empty()) std::ranges::stable_partition(waiting_, [&](const Job& other) { return other.client != job.client; });
      return job;
    }
    const auto next = std::ranges::min_element(waiting_, {}, &Job::notBefore);
    if (next == waiting_.end() || next->notBefore == RetryAt::kWhenWoken)
      changed_.wait(lock);
    else
      changed_.wait_until(lock, next->notBefore);
  }
}

void Jobs::work(std::size_t thread) {
  scheduling::lowerPriority(limits_.lowerPriorityBy);
  std::unique_lock lock(mutex_);
  for (Job job = next(lock); job.run; job = next(lock)) {
    running_[thread] = {job.stop, {}, job.client};
    expects(idle_ > 0, "a thread that takes a job was idle");
    --idle_;
    lock.unlock();
    const auto begin = Clock::now();
    std::optional<RetryAt> retry;
    try {
      if (!job.stop.stop_requested()) retry = job.run(job.stop.get_token());
    } catch (const std::exception& e) {
      logging::error(std::string("a request's work failed: ") + e.what());
    }
    const std::chrono::duration<double> took = Clock::now() - begin;
    if (!retry) job = {};
    lock.lock();
    usual_ = usual_ == 0 ? took.count() : 0.7 * usual_ + 0.3 * took.count();
    const bool isWoken = std::exchange(running_[thread], {}).isWoken;
    ++idle_;
    if (retry && !stopped_) {
      job.notBefore = isWoken ? Clock::time_point() : retry->time;
      waiting_.push_back(std::move(job));
      changed_.notify_one();
    }
    ended_.notify_all();
  }
}

}  // namespace ridgecast::http
