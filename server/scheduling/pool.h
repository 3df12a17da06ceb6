#pragma once
// A logical worker pool for each camera over the threads of an executor.
//
// An Executor owns the threads. A Pool is one camera's share: its own queue, and at most `limit` of its tasks in flight at any time.
// Clients that have work are served round robin, one batch each, and so are a client's pools: whoever has a thousand cameras has no more
// of the threads than whoever has one. If there are two or more threads and all run long tasks (over 10 ms of CPU time), one extra thread
// starts other pools' short tasks (up to 4 ms) at once, and the system shares out the processors.

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace ridgecast::scheduling {

class Pool;

// Lowers the calling thread's priority, for good: adds 0..19 to its nice value, also for processes that it starts. Does nothing where the
// system has no priorities of threads.
void lowerPriority(int by);

class Executor {
 public:
  // threads 0: as many as the hardware has. While `first` works, this executor's loops rest between tasks, so that it uses exactly `share`
  // of all cores, 0 < share <= 1, whatever else runs: not less (a low priority could starve it), not more even if a core is free (it would
  // take cache and memory bandwidth).
  explicit Executor(unsigned threads, const Executor* first = nullptr, double share = 1);
  // Without threads: tasks wait for work(). A program's results then depend only on its calls.
  struct WithoutThreads {};
  explicit Executor(WithoutThreads);
  ~Executor();  // waits for the tasks in flight; tasks still queued are dropped
  Executor(const Executor&) = delete;
  Executor& operator=(const Executor&) = delete;

  unsigned threads() const;
  // Posted tasks that no thread has begun, of all pools. Any thread.
  std::size_t queued() const;
  // Share of the threads that have been at work in the last seconds, 0 to 1, whether a processor ran them or not. Any thread.
  double usage() const;
  // Without threads: the calling thread runs all posted tasks, including those that they post.
  void work();
  // limit 0: min(4, threads). `client` empty: nobody else's. The pool may outlive the executor, but must not be used then.
  std::shared_ptr<Pool> makePool(unsigned limit = 0, const std::string& client = {});

 private:
  struct State;
  friend class Pool;
  std::shared_ptr<State> state_;
};

// Which tasks must be done before a task may start: `before[k]` lists the predecessors of task k, all smaller than k.
using Order = std::vector<std::vector<std::uint32_t>>;

class Pool {
 public:
  ~Pool();
  // Queues a task, which must not throw; false when the pool's queue is full (1,024 posted tasks), or the executor has ended. Any thread.
  bool post(std::function<void()> task);

  // Call when a loop follows within microseconds: wakes one sleeping thread of the executor, if any, to look for it.
  void wakeOne();

  // body(k) for every k in [0, count), in parallel; returns when all are done. The calling thread takes part, so that a task of this pool
  // may call it without tying up a thread. Hands out `grain` indices at a time. Rethrows the first exception of body once the calls that
  // had begun have ended; the others are skipped.
  void forEach(std::size_t count, std::size_t grain, const std::function<void(std::size_t)>& body);

  // The same, but task k starts only when all of order[k] are done; everything that ran in a predecessor is visible to it.
  // Ready tasks start in ascending order.
  void forEachOrdered(const Order& order, const std::function<void(std::size_t)>& body);

 private:
  friend class Executor;
  struct Impl;
  struct Row;
  explicit Pool(std::shared_ptr<Impl> impl);
  std::shared_ptr<Impl> impl_;
};

}  // namespace ridgecast::scheduling
