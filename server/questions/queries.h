#pragma once
// One member's queries of the true terrain, answered one after another.
//
// An actor beside the camera session: ask() may come from any thread and only queues. The work runs in turns in the pool that the
// questions of all cameras share; each turn waits for a slot of its own behind all others (QueryQueues). It is charged to the client's
// Budgets::queries, and waits when that is spent. Bound: wire::kMaxQueries that wait or whose answers have not left.

#include <atomic>
#include <chrono>
#include <deque>
#include <memory>
#include <mutex>

#include "common/wire/messages.h"
#include "server/conversation/sender.h"
#include "server/query/query.h"
#include "server/session/session.h"
#include "server/session/slot_queue.h"

namespace ridgecast::questions {

class Queries final : public session::SlotQueue::Worker, public std::enable_shared_from_this<Queries> {
 public:
  Queries(std::shared_ptr<const session::Session> session, std::shared_ptr<conversation::Sender> sender,
          std::shared_ptr<session::Budgets> budgets);
  bool ask(wire::Query query);  // false: too many are open
  void close();                 // sends nothing more and abandons the work; any thread

 private:
  void waitForTurn();  // until the budget allows it and there is a slot
  void begin(session::SlotQueue::Slot slot) override;
  void run();
  bool workOnFirst();  // a piece of its answer; false: none waits

  const std::shared_ptr<const session::Session> session_;
  const std::shared_ptr<conversation::Sender> sender_;
  const std::shared_ptr<session::SlotQueue> queue_;
  const std::shared_ptr<session::Budgets> budgets_;
  std::mutex mutex_;
  std::deque<std::unique_ptr<query::Answering>> pending_;                                           // the first is in work while `runs_`
  std::shared_ptr<std::atomic<std::size_t>> open_ = std::make_shared<std::atomic<std::size_t>>(0);  // not yet answered and sent
  bool runs_ = false, closed_ = false;
};

}  // namespace ridgecast::questions
