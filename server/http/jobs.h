#pragma once
// Work behind HTTP requests that takes longer than a socket's thread may wait: a bounded queue, a few threads of its own.
//
// A job is given a std::stop_token, to be asked every few milliseconds: it is stopped when its asker leaves and when the server shuts
// down. Bounds: `threads` jobs run, `waiting` wait; beyond that post() refuses. A job that is stopped before it began never begins.
// Any thread may post; what a job throws is the job's mistake and ends as `failed`.

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <stop_token>
#include <thread>
#include <vector>

namespace ridgecast::http {

class Jobs {
 public:
  struct Limits {
    unsigned threads = 1;
    std::size_t waiting = 4;
    int niceness = 0;  // of the threads, as scheduling::setNiceness
  };
  explicit Jobs(const Limits& limits);
  ~Jobs();  // as stop()
  Jobs(const Jobs&) = delete;
  Jobs& operator=(const Jobs&) = delete;

  // False: full, or stopped. `run` is called once, on a thread of this, unless `stop` is requested before.
  bool post(std::stop_source stop, std::function<void(std::stop_token)> run);
  // How many wait; at most `threads` more run. Any thread.
  std::size_t waiting() const;
  // Takes no more; what runs or waits has until then to end, then as stop(). Any thread but a job's.
  void finish(std::chrono::steady_clock::time_point until);
  // Stops all jobs and waits for those that run. Any thread but a job's.
  void stop();

 private:
  struct Job {
    std::stop_source stop;
    std::function<void(std::stop_token)> run;
  };
  void work(std::size_t thread);

  const Limits limits_;
  mutable std::mutex mutex_;
  std::condition_variable changed_, ended_;
  std::deque<Job> waiting_;
  std::vector<std::stop_source> running_;  // by thread
  std::size_t idle_ = 0;                   // threads without a job
  bool closed_ = false, stopped_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace ridgecast::http
