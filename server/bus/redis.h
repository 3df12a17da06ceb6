#pragma once
// The engine that is Redis 7 (or an heir that speaks like it), durable when it is set up as server/README.md says: logs are streams whose
// ids are their numbers, appended by a script that checks the last one; records are hashes with a life; messages and changes are published.
//
//   two connections: commands <-> replies, subscriptions -> messages; they come and go together
//
//   away --(dial, greet: version, settings, scripts; subscribe; arrive)--> there
//     ^------(closed, silent for 2 s, a replica, its scripts gone)-----------'     then again after 50 ms, growing to 1 s
//
// After another engine than before is found (restarted, or a replica that took over), new entries are refused for kGrace.
// Keys begin with "ridgecast:". Not for Redis Cluster: a log's entries and the grace are one script's.

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>

#include "common/outcome/outcome.h"
#include "server/bus/bus.h"
#include "server/metrics/metrics.h"

namespace ridgecast::bus {

class Line;

class Redis final : public Bus {
 public:
  static constexpr std::chrono::seconds kGrace{2};
  static constexpr std::size_t kMaxAppendBytes = std::size_t{16} << 20;   // of one append, 32 more for each entry; beyond is kFull
  static constexpr std::size_t kMaxValueBytes = std::size_t{4} << 20;     // of a record; more is an error
  static constexpr std::size_t kMaxWaitingBytes = std::size_t{64} << 20;  // of calls without an answer; more fail as if it were away
  static constexpr std::size_t kMaxWaiting = 65'536;                      // such calls
  static constexpr std::size_t kMaxListedBytes = std::size_t{64} << 20;   // by one list(); more is an error

  struct Settings {
    std::string url;                     // address.h
    std::filesystem::path passwordFile;  // its first line, instead of one in the URL; empty: none
    std::filesystem::path ca;            // of rediss://, PEM; empty: the authorities that this system trusts
  };
  // Waits until the engine is there, at most some seconds. Error: it is not, it loses what it acknowledges, or evicts.
  static Outcome<std::shared_ptr<Redis>> connect(const Settings& settings, std::shared_ptr<metrics::Metrics> figures);
  ~Redis() override;  // end()
  // Waits a second at most until what was called is answered. No handler is called after it, and calls do nothing.
  void end();

  std::string where() const;  // without its password

  std::uint32_t server() const override;
  bool isAway() const override;
  std::int64_t now() const override;
  void append(const std::string& log, std::uint64_t after, std::vector<std::string> entries, Origin origin,
              std::function<void(Appended)> done) override;
  void read(const std::string& log, std::uint64_t after, std::size_t most, std::function<void(Outcome<std::vector<Entry>>)> done) override;
  Subscription watch(const std::string& log, std::function<void(std::uint64_t last)> changed) override;
  void tell(const std::string& channel, std::string message) override;
  Subscription hear(const std::string& channel, std::function<void(const std::string& message)> heard) override;
  void hold(const std::string& key, std::string value, std::uint64_t epoch, std::chrono::milliseconds life,
            std::function<void(Outcome<Held>)> done) override;
  void take(const std::string& key, std::uint64_t epoch, std::function<void(Outcome<Held>)> done) override;
  void drop(const std::string& key, std::uint64_t epoch) override;
  void list(const std::string& prefix, std::function<void(Outcome<std::map<std::string, Record>>)> done) override;

 private:
  struct Figures;
  struct Listing;
  Redis(std::shared_ptr<Line> line, std::shared_ptr<Figures> figures);

  const std::shared_ptr<Line> line_;
  const std::shared_ptr<Figures> figures_;
};

}  // namespace ridgecast::bus
