#pragma once
// Compares the ground of a session with that of the other servers, each time that edits reach a multiple of kEvery: the first to get there
// writes the hash of its ground into a record, the others compare. The order of edits alone (edit_order.h) does not show that two programs
// make different ground of equal edits.

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "common/edits/layer.h"
#include "server/bus/bus.h"
#include "server/scheduling/pool.h"

namespace ridgecast::editing {

// Any thread. Hashing takes turns.
class GroundCheck : public std::enable_shared_from_this<GroundCheck> {
 public:
  static constexpr std::uint64_t kEvery = 1000;  // edits
  static constexpr std::size_t kMaxWaiting = 4;  // grounds; the oldest is left out
  static constexpr std::chrono::minutes kLife{10};

  GroundCheck(std::shared_ptr<bus::Bus> bus, std::string session, scheduling::Executor& executor)
      : bus_(std::move(bus)), session_(std::move(session)), pool_(executor.makePool(1)) {}
  // `differs` is called with a sentence about both hashes. Once, before any is added.
  void begin(std::function<void(const std::string& sentence)> differs) { differs_ = std::move(differs); }

  // The ground as of this edit, whose identity (edit_log::identityOf) tells it from one that the log has lost.
  void add(std::uint64_t edit, std::uint64_t identity, std::shared_ptr<const edits::Layer> layer);

 private:
  struct Ground {
    std::uint64_t edit = 0, identity = 0;
    std::shared_ptr<const edits::Layer> layer;
  };
  void work();
  void compare(const Ground& ground, std::uint64_t hash) const;

  const std::shared_ptr<bus::Bus> bus_;
  const std::string session_;
  const std::shared_ptr<scheduling::Pool> pool_;
  std::function<void(const std::string&)> differs_ = [](const std::string&) {};
  std::mutex mutex_;
  std::deque<Ground> waiting_;
  bool works_ = false;
  // Of the task: the ground in work.
  Ground now_;
  std::vector<edits::TileAddress> tiles_;
  std::size_t next_ = 0;
  std::uint64_t sum_ = 0;
};

}  // namespace ridgecast::editing
