#pragma once
// The two connections to Redis as one line: opened, prepared, watched over and opened again, by a thread of its own. What is called and
// subscribed goes through it. redis.h says what it looks like from outside.
//
// Public calls: any thread. All else, handlers included, on the line's thread. Heavy: for .cpp files that see sockets.

#include <array>
#include <atomic>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/bus/bus.h"
#include "server/bus/link.h"
#include "server/metrics/metrics.h"

namespace ridgecast::bus {

class Line final : public std::enable_shared_from_this<Line> {
 public:
  enum class Script { kAppend, kRead, kLast, kHold, kTake, kDrop, kList, kArrive };
  static constexpr std::size_t kScripts = 8;
  static constexpr std::chrono::seconds kFarewell{1};
  using Answer = Link::Answer;
  using Done = Link::Done;

  Line(Address address, std::string ca, metrics::Metrics& figures);
  // Begins, and waits until the engine is there. Error: one sentence; the line has ended.
  std::optional<Error> start();
  // After start(). What was called before has its answers, if they come within kFarewell. No handler is called after it, but the one that
  // calls it.
  void stop();

  std::string where() const { return address_.text(); }
  std::uint32_t server() const { return server_; }
  // Less than a sixteenth of its memory is left, as far as it was heard a second ago, and with what this server has written since: only
  // small records have room, without which no session goes on.
  bool isNearlyFull() const;
  void countWritten(std::size_t bytes) { written_ += bytes + bytes / 4; }  // its allocator rounds each up by less than a quarter
  bool isAway() const { return isAway_; }
  std::int64_t now() const;

  void call(Script script, const std::vector<std::string_view>& keys, const std::vector<std::string_view>& arguments, Done done);
  void publish(std::string_view channel, std::string_view message, Done done);
  void post(std::function<void()> run);
  // Where a kind of things of this name is told: databases of an engine share its channels.
  std::string channelOf(std::string_view kind, std::string_view name) const;
  // Of a log's channel: the last number, at first too. Of another: each message of other servers.
  Subscription watch(const std::string& channel, std::string log, std::function<void(std::uint64_t)> changed);
  Subscription hear(const std::string& channel, std::function<void(const std::string&)> heard);

 private:
  using Clock = std::chrono::steady_clock;
  // In their order; each follows when all that was asked in the one before is answered.
  enum class Stage { kAway, kOpening, kGreeting, kSubscribing, kArriving, kThere };
  struct Handler;
  struct Topic {
    std::string log;  // its key; empty: messages
    std::vector<std::weak_ptr<Handler>> handlers;
  };
  struct Sample {
    std::int64_t delay = 0, ahead = 0;  // microseconds: of the reply; the engine's clock before the steady one
  };

  void dial();
  void lost(const Link::Fault& fault);
  void tick();
  void next();
  void greet();
  void checkEngine(const Reply& info);
  void checkSettings(const Reply& settings);
  void measure(const Reply& info);  // the engine's memory
  void countAway();
  void arrive();
  void arrived(const Reply& reply);
  // Sends it, and goes to the next stage after the last of this one.
  void ask(Link& link, const std::vector<std::string_view>& command, std::function<void(const Reply&)> use);
  bool isGood(const Reply& reply);  // false: the line was lost by it
  void askTime();
  void send(std::string bytes, Done done);
  std::string commandOf(Script script, const std::vector<std::string_view>& keys, const std::vector<std::string_view>& arguments) const;

  Subscription subscribe(const std::string& channel, std::string log, std::shared_ptr<Handler> handler);
  void subscribeNow(const std::string& channel);
  void askLast(const std::string& channel);
  void tidy(const std::string& channel);
  void pushed(const Reply& reply);

  const Address address_;
  const std::string ca_;
  metrics::Gauge& connected_;
  metrics::Counter &reconnects_, &awaySeconds_;
  metrics::Gauge &memory_, &memoryLimit_;  // the engine's, bytes
  const std::string ownChannel_;           // for answers that keep the order of messages
  std::atomic<std::uint32_t> server_ = 0;
  std::atomic<bool> isAway_ = true, hasEnded_ = false;
  std::atomic<std::uint64_t> used_ = 0, limit_ = 0, written_ = 0;  // bytes: of the engine's memory; since that was asked
  std::atomic<std::int64_t> ahead_ = 0;                            // as Sample's
  std::array<std::string, kScripts> hashes_;                       // written before start() ends, and not after
  struct Waiting {
    std::atomic<std::size_t> calls = 0, bytes = 0;
  };
  const std::shared_ptr<Waiting> waiting_ = std::make_shared<Waiting>();

  boost::asio::io_context io_{1};
  boost::asio::executor_work_guard<boost::asio::io_context::executor_type> guard_{io_.get_executor()};
  boost::asio::steady_timer redial_{io_}, tick_{io_};
  std::optional<std::promise<std::optional<Error>>> first_;  // until the engine has been there, or never will
  Stage stage_ = Stage::kAway;
  std::size_t asked_ = 0, opened_ = 0;
  std::shared_ptr<Link> commands_, subscriptions_;
  std::chrono::milliseconds pause_{};
  Link::Fault fault_;            // the last
  Clock::time_point leftAt_;     // when it was there last
  Clock::time_point countedTo_;  // by awaySeconds_
  Clock::time_point measuredAt_;
  std::string engine_, known_;  // its run: the one here, and the one that was there last
  bool asksTime_ = false;
  std::deque<Sample> samples_;
  std::map<std::string, Topic> topics_;  // by channel
  std::thread thread_;
};

}  // namespace ridgecast::bus
