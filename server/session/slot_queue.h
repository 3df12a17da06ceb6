#pragma once
// Background work that must not crowd out the iterations: it waits for one of a few slots in a pool, first come, first served. Any thread.

#include <deque>
#include <memory>
#include <mutex>

#include "server/scheduling/pool.h"

namespace ridgecast::session {

class SlotQueue : public std::enable_shared_from_this<SlotQueue> {
 public:
  using Slot = std::shared_ptr<const void>;  // released with its last copy

  // One that waits. begin() posts its work, in turns of milliseconds, to the pool and keeps the slot as long as it works.
  class Worker {
   public:
    virtual ~Worker() = default;
    virtual void begin(Slot slot) = 0;
  };

  SlotQueue(std::shared_ptr<scheduling::Pool> pool, unsigned slots) : slots_(slots), pool_(std::move(pool)) {}
  // Calls begin() of the worker once there is a slot, unless it is gone by then.
  void enter(std::weak_ptr<Worker> worker);
  scheduling::Pool& pool() { return *pool_; }
  unsigned slots() const { return slots_; }
  unsigned working() const;

 private:
  void leave();
  void beginNext();

  const unsigned slots_;
  const std::shared_ptr<scheduling::Pool> pool_;
  mutable std::mutex mutex_;
  std::deque<std::weak_ptr<Worker>> waiting_;
  unsigned working_ = 0;
  bool begins_ = false;  // a thread is in beginNext()
};

// What cameras ask beside their iterations. All of it shares one pool with one thread fewer than the executor has, at least one.
struct QueryQueues {
  explicit QueryQueues(scheduling::Executor& executor);
  // A ground keeps its slot until it is answered, for it takes up to some hundred MB; queries take slots a turn at a time.
  std::shared_ptr<SlotQueue> grounds, queries;
};

}  // namespace ridgecast::session
