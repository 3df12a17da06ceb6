#include "server/session/slot_queue.h"

#include <algorithm>
#include <utility>

#include "common/outcome/contract.h"

namespace ridgecast::session {

void SlotQueue::enter(std::weak_ptr<Worker> worker) {
  expects(!worker.expired(), "who waits for a slot lives");
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(waiting_, [](const auto& one) { return one.expired(); });
    waiting_.push_back(std::move(worker));
  }
  beginNext();
}

unsigned SlotQueue::working() const {
  const std::lock_guard lock(mutex_);
  return working_;
}

void SlotQueue::leave() {
  {
    const std::lock_guard lock(mutex_);
    expects(working_ > 0, "a slot that is left was taken");
    --working_;
  }
  beginNext();
}

void SlotQueue::beginNext() {
  std::unique_lock lock(mutex_);
  if (std::exchange(begins_, true)) return;  // that one sees what has changed
  while (working_ < slots_ && !waiting_.empty()) {
    auto next = waiting_.front().lock();
    waiting_.pop_front();
    if (!next) continue;
    ++working_;
    expects(working_ <= slots_, "no more work than there are slots");
    lock.unlock();
    next->begin(Slot(nullptr, [self = shared_from_this()](const void*) { self->leave(); }));
    next.reset();
    lock.lock();
  }
  begins_ = false;
}

QueryQueues::QueryQueues(scheduling::Executor& executor) {
  const unsigned slots = std::max(1u, executor.threads() - 1);
  const auto pool = executor.makePool(slots);
  grounds = std::make_shared<SlotQueue>(pool, slots);
  queries = std::make_shared<SlotQueue>(pool, slots);
}

}  // namespace ridgecast::session
