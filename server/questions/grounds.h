#pragma once
// The ground around points, independent of the member's camera: a mesh of the square around the circle (server/box/box_mesh.h), of which
// the triangles over the circle are sent. Every leaf carries the error that the mesh keeps, at most the requested one. If no mesh keeps the
// error, the reply names one that does (tested), if that was found in time. That depends only on terrain and triangles: the same question
// gets the same answer, or on a busy server none in time.
//
// An actor beside the camera session: ask() may come from any thread and only queues. The work runs in turns, as tasks of the pool that the
// questions of all cameras share, once there is a slot (QueryQueues). Bounds: wire::kMaxGrounds requests that wait or whose answers have
// not left; one of them in work; each is answered within kTimeout.

#include <atomic>
#include <chrono>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "common/wire/messages.h"
#include "server/conversation/sender.h"
#include "server/editing/edits.h"
#include "server/session/slot_queue.h"

namespace ridgecast::questions {

class Grounds final : public session::SlotQueue::Worker, public std::enable_shared_from_this<Grounds> {
 public:
  static constexpr std::chrono::seconds kTimeout{30};  // from ask() on

  // `turn`: how long it works before others have their turn.
  Grounds(std::function<editing::Ground()> ground, std::uint32_t triangleBudget, std::shared_ptr<session::SlotQueue> queue,
          std::shared_ptr<conversation::Sender> sender, std::chrono::seconds timeout = kTimeout,
          std::chrono::milliseconds turn = std::chrono::milliseconds(2));
  ~Grounds() override;
  bool ask(const wire::AskGround& ask);  // false: too many are open
  void close();                          // sends nothing more and abandons current work; any thread

 private:
  using Clock = std::chrono::steady_clock;
  struct Work;

  void begin(session::SlotQueue::Slot slot) override;
  void run(session::SlotQueue::Slot slot);
  // Some milliseconds of work; returns the answer, if it is the last.
  std::optional<wire::Ground> turn(Work& work) const;
  std::optional<wire::Ground> mesh(Work& work, Clock::time_point until) const;
  // From the leaf `done` on. False: the turn is over and some are left.
  bool eachLeaf(const Work& work, std::size_t& done, Clock::time_point until, const std::function<void(std::size_t)>& body) const;
  std::optional<wire::Ground> coarser(Work& work, double reached) const;
  wire::Ground unfit(const Work& work, const std::string& fits) const;
  static wire::Ground refusal(const Work& work, std::string sentence);

  const std::function<editing::Ground()> ground_;  // of now
  const std::uint32_t triangleBudget_;
  const std::shared_ptr<session::SlotQueue> queue_;
  const std::shared_ptr<conversation::Sender> sender_;
  const std::chrono::seconds timeout_;
  const std::chrono::milliseconds turn_;
  std::stop_source stop_;

  std::mutex mutex_;
  std::deque<std::unique_ptr<Work>> pending_;                                                       // the first is in work while `runs_`
  std::shared_ptr<std::atomic<std::size_t>> open_ = std::make_shared<std::atomic<std::size_t>>(0);  // not yet answered and sent
  bool runs_ = false;                                                                               // waits for a slot or has one
};

}  // namespace ridgecast::questions
