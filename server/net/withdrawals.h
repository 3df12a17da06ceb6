#pragma once
// Tokens that were taken out of one server's file: the other servers refuse them within two seconds, until each reads its own file again
// (SIGHUP), which then decides. Records in the bus, not messages, so that a server that was away for less than kLife hears of them, too.
// JSON Web Tokens stand in no file: they end by their expiry, or with their keys. Private to the room.

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "server/bus/bus.h"
#include "server/scheduling/timer.h"

namespace ridgecast::net {

// Any thread.
class Withdrawals : public std::enable_shared_from_this<Withdrawals> {
 public:
  static constexpr std::chrono::milliseconds kLife{600'000}, kLookEvery{1'000};
  static constexpr std::size_t kAtATime = 1'000;  // hashes of a record

  using Hashes = std::vector<std::string>;  // access::Tokens::missingFrom
  // `withdraw` is called with what other servers withdraw. `timer` must outlive this.
  Withdrawals(std::shared_ptr<bus::Bus> bus, const scheduling::Timer& timer, std::function<void(const Hashes&)> withdraw);
  void begin();  // looks from now on; nothing with bus::Alone
  // This server has read its file: what others withdrew before does not count any more. `withdrawn`: what the file has lost.
  void loaded(const Hashes& withdrawn);

 private:
  void look();

  const std::shared_ptr<bus::Bus> bus_;
  const scheduling::Timer& timer_;
  const std::function<void(const Hashes&)> withdraw_;
  std::mutex mutex_;
  std::int64_t loadedAt_ = 0;    // by the bus's clock
  std::set<std::string> known_;  // records
};

}  // namespace ridgecast::net
