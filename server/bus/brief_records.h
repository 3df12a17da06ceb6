#pragma once
// Records that many may write at once and that soon expire, such as the meshes that a server which drains hands over: bounded in total, so
// that they take no room from what the engine must keep.
//
//   hold() --> waits for room --> room in a share that this server has claimed: written
//                 |                   '-- a share: a record of its own, which lives as long as what is written by it
//                 '--> no share is free, or the engine is away: an error for all that wait
//
// Bounds: kSharesOfOne * shareBytes of each server in kLife, on their way and in the engine; kShares * shareBytes in the engine.

#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "server/bus/bus.h"

namespace ridgecast::bus {

// Any thread; must be held by a shared_ptr.
class BriefRecords : public std::enable_shared_from_this<BriefRecords> {
 public:
  using Time = std::chrono::steady_clock::time_point;
  static constexpr std::chrono::seconds kLife{60}, kDelay{5};  // kDelay: at most, from a call to the engine
  static constexpr std::size_t kShareBytes = std::size_t{16} << 20;
  static constexpr int kShares = 16, kSharesOfOne = 4;

  // `name`: of the shares.
  explicit BriefRecords(std::string name, std::size_t shareBytes = kShareBytes) : name_(std::move(name)), shareBytes_(shareBytes) {}
  // As Bus::hold() of a new record that lives for kLife. Error: also if there is no room. `now` never runs backwards.
  void hold(const std::shared_ptr<Bus>& bus, const std::string& key, std::string value, Time now,
            std::function<void(Outcome<Bus::Held>)> done);

 private:
  struct Waiting {
    std::size_t bytes = 0;
    std::function<void(bool hasRoom)> go;
  };
  void serve(const std::shared_ptr<Bus>& bus);
  void claim(const std::shared_ptr<Bus>& bus, int share);
  void claimed(const std::shared_ptr<Bus>& bus, bool isOurs);

  const std::string name_;
  const std::size_t shareBytes_;
  std::mutex mutex_;
  Time until_{};           // of the shares
  std::size_t left_ = 0;   // bytes of them
  std::size_t taken_ = 0;  // bytes that were written since they began, or wait
  bool isClaiming_ = false;
  std::vector<Waiting> waiting_;
};

}  // namespace ridgecast::bus
