#pragma once
// The ground around points, whatever a member's camera sees: a mesh of its own, refined from straight above until its error is what was
// asked for, and sent whole. It is kept from one question to the next, so that a vehicle that asks as it drives on costs what is new.
//
// An actor beside the camera session: ask() comes from any thread and only notes; the work runs as tasks of the member's own pool, one
// iteration a task, so that it shares fairly. Bound: wire::kMaxGrounds questions wait or are answered and have not left.

#include <atomic>
#include <deque>
#include <memory>
#include <mutex>

#include "common/camera/camera.h"
#include "common/wire/messages.h"
#include "server/session/sender.h"
#include "server/session/session.h"

namespace ridgecast::session {

class Grounds : public std::enable_shared_from_this<Grounds> {
 public:
  // `granted` gives the triangle budget.
  Grounds(std::shared_ptr<const terrain::Terrain> terrain, const wire::Settings& granted, MakeMesh makeMesh,
          std::shared_ptr<scheduling::Pool> pool, std::shared_ptr<Sender> sender);
  bool ask(const wire::AskGround& ask);  // false: too many wait
  void close();                          // nothing more is sent; any thread

 private:
  bool post();  // under the lock
  void run();
  // One iteration for the question; true when it is answered.
  bool work();
  void aim();
  wire::Ground answer();

  const std::shared_ptr<const terrain::Terrain> terrain_;
  const wire::Settings settings_;
  const MakeMesh makeMesh_;
  const std::shared_ptr<scheduling::Pool> pool_;
  const std::shared_ptr<Sender> sender_;

  std::mutex mutex_;
  std::deque<wire::AskGround> asked_;
  std::shared_ptr<std::atomic<std::size_t>> open_ = std::make_shared<std::atomic<std::size_t>>(0);  // not yet answered and sent
  bool runs_ = false, closed_ = false;

  // Of the running task alone.
  std::unique_ptr<IteratingMesh> mesh_;
  bool begun_ = false;  // with the first of asked_, which is now_
  wire::AskGround now_;
  camera::Camera camera_;
  double sharpness_ = 1, lastError_ = 0;  // how much finer than it should have to be; what the round before reached
  int iterations_ = 0, rounds_ = 0;
};

}  // namespace ridgecast::session
