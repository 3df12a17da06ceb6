#pragma once
// The ground around points, independent of the member's camera: a mesh of the square around the circle at the requested error
// (server/box/box_mesh.h), of which the triangles over the circle are sent.
//
// An actor beside the camera session: ask() may come from any thread and only queues. The work runs as tasks of the member's own pool, one
// ground each. If an error cannot be reached, or not within kTimeout, twice the error is tried. Bound: wire::kMaxGrounds requests that wait
// or whose answers have not left.

#include <atomic>
#include <chrono>
#include <deque>
#include <memory>
#include <mutex>
#include <stop_token>

#include "common/terrain/terrain.h"
#include "common/wire/messages.h"
#include "server/scheduling/pool.h"
#include "server/session/sender.h"

namespace ridgecast::session {

class Grounds : public std::enable_shared_from_this<Grounds> {
 public:
  static constexpr std::chrono::seconds kTimeout{4};

  Grounds(std::shared_ptr<const terrain::Terrain> terrain, std::uint32_t triangleBudget, std::shared_ptr<scheduling::Pool> pool,
          std::shared_ptr<Sender> sender, std::chrono::seconds timeout = kTimeout);
  bool ask(const wire::AskGround& ask);  // false: too many are open
  void close();                          // sends nothing more and abandons current work; any thread

 private:
  void run();
  void answer(const wire::AskGround& request);

  const std::shared_ptr<const terrain::Terrain> terrain_;
  const std::uint32_t triangleBudget_;
  const std::shared_ptr<scheduling::Pool> pool_;
  const std::shared_ptr<Sender> sender_;
  const std::chrono::seconds timeout_;
  std::stop_source stop_;

  std::mutex mutex_;
  std::deque<wire::AskGround> pending_;
  std::shared_ptr<std::atomic<std::size_t>> open_ = std::make_shared<std::atomic<std::size_t>>(0);  // not yet answered and sent
  bool runs_ = false;
};

}  // namespace ridgecast::session
