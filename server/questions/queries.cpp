#include "server/questions/queries.h"

#include <exception>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"

namespace ridgecast::questions {

Queries::Queries(std::shared_ptr<const session::Session> session, std::shared_ptr<conversation::Sender> sender,
                 std::shared_ptr<session::Budgets> budgets)
    : session_(std::move(session)),
      sender_(std::move(sender)),
      queue_(session_->resources().queryQueues().queries),
      budgets_(std::move(budgets)) {
  expects(sender_ && budgets_, "queries are charged to somebody, and answered");
}

bool Queries::ask(wire::Query query) {
  {
    const std::lock_guard lock(mutex_);
    if (*open_ >= wire::kMaxQueries) return false;
    ++*open_;
    editing::Ground ground = session_->ground();
    pending_.push_back(std::make_unique<query::Answering>(std::move(ground.terrain), std::move(query), ground.edit));
    if (std::exchange(runs_, true)) return true;
  }
  waitForTurn();
  return true;
}

void Queries::close() {
  const std::lock_guard lock(mutex_);
  closed_ = true;
}

void Queries::waitForTurn() {
  const scheduling::Timer& timer = *session_->resources().timer;
  const auto free = budgets_->queries.free();
  if (free <= timer.now()) return queue_->enter(weak_from_this());
  timer.at(free, [weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->queue_->enter(weak);
  });
}

void Queries::begin(session::SlotQueue::Slot slot) {
  queue_->pool().post([self = shared_from_this(), slot = std::move(slot)] { self->run(); });
}

void Queries::run() {
  using Steady = std::chrono::steady_clock;
  try {
    for (const auto until = Steady::now() + session_->resources().limits.turn; Steady::now() < until;)
      if (!workOnFirst()) return;
  } catch (const std::exception& e) {
    return sender_->fail(conversation::failureOf(e));
  }
  waitForTurn();
}

bool Queries::workOnFirst() {
  query::Answering* first = nullptr;
  {
    const std::lock_guard lock(mutex_);
    runs_ = !closed_ && !pending_.empty();
    if (!runs_) return false;
    first = pending_.front().get();
  }
  if (!first->isDone()) {
    const std::uint64_t heights = first->work();
    budgets_->queries.spend(session_->resources().timer->now(), heights);
    return true;
  }
  sender_->send(first->take(), conversation::ticketOf(open_));
  std::unique_ptr<query::Answering> done;  // destroyed without the lock
  const std::lock_guard lock(mutex_);
  expects(!pending_.empty() && pending_.front().get() == first, "what is answered waits first");
  done = std::move(pending_.front());
  pending_.pop_front();
  return true;
}

}  // namespace ridgecast::questions
