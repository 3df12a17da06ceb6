#pragma once
// Work for HTTP requests that would block a socket's thread too long: a bounded queue with its own few threads.
//
// A job checks its std::stop_token every few milliseconds: it is stopped when its client leaves and when the server shuts down. Bounds:
// `threads` jobs run and `waiting` wait, at most share() of them for one client; beyond that post() refuses. A job that is stopped before
// it starts never starts. Clients take turns: when a client's job begins, its other jobs move behind all that wait. A job may run in turns,
// between which waiting jobs run; its next turn is at a given time, or when wake() is called (RetryAt). Any thread may post. An exception
// ends its job, and is logged.

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace ridgecast::http {

// Not now: the next turn is not before this time, unless it is woken before.
struct RetryAt {
  static constexpr std::chrono::steady_clock::time_point kWhenWoken = std::chrono::steady_clock::time_point::max();
  std::chrono::steady_clock::time_point time;
};

class Jobs {
 public:
  using Clock = std::chrono::steady_clock;

  struct Limits {
    unsigned threads = 1;
    std::size_t waiting = 4;
    int lowerPriorityBy = 0;  // of the threads, as scheduling::lowerPriority
  };
  explicit Jobs(const Limits& limits);
  ~Jobs();  // calls stop()
  Jobs(const Jobs&) = delete;
  Jobs& operator=(const Jobs&) = delete;

  // `client`: as http::Request::client; empty: no client, so no share applies. False: full, stopped, or the client is at its share. Calls
  // `run` on one of these threads until it returns nothing or `stop` is requested; each time it queues behind waiting jobs and waits for
  // the time that it returned, unless wake() was called after the turn began.
  bool post(std::stop_source stop, std::function<std::optional<RetryAt>(std::stop_token)> run, std::string client = {});
  // Makes the job's next turn due now. Does nothing once the job has ended. Any thread.
  void wake(const std::stop_source& job);
  // The running job no longer counts for its client, which may ask again as soon as it has its answer. Any thread.
  void answered(const std::stop_source& job);
  // Half of all places, at least one.
  std::size_t share() const { return std::max<std::size_t>(1, (limits_.threads + limits_.waiting) / 2); }
  bool hasShare(std::string_view client) const;  // whether that many jobs of this client wait or run
  // How many jobs must begin or end before the one with this stop source begins; 0: it has begun. Any thread.
  std::size_t ahead(const std::stop_source& job) const;
  // Seconds until all jobs now waiting will have begun, estimated from recent durations: 1 to 600. Any thread.
  unsigned secondsToWait() const;
  // Jobs that wait; up to `threads` more run. Any thread.
  std::size_t waiting() const;
  // Accepts no more. Lets running and waiting jobs end until the given time, then calls stop(). Any thread except a job's.
  void finish(Clock::time_point until);
  // Stops all jobs and waits for running ones. Any thread except a job's.
  void stop();

 private:
  struct Job {
    std::stop_source stop{std::nostopstate};
    std::function<std::optional<RetryAt>(std::stop_token)> run;
    std::string client;
    Clock::time_point notBefore{};
    bool isWoken = false;
  };
  bool hasShareNow(std::string_view client) const;  // under the lock
  Job next(std::unique_lock<std::mutex>& lock);     // waits for it; one without `run`: stopped
  void work(std::size_t thread);

  const Limits limits_;
  mutable std::mutex mutex_;
  std::condition_variable changed_, ended_;
  std::deque<Job> waiting_;
  std::vector<Job> running_;  // by thread; without `run`
  std::size_t idle_ = 0;      // threads without a job
  double usual_ = 0;          // seconds that a job takes
  bool closed_ = false, stopped_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace ridgecast::http
