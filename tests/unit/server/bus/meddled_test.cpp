// An engine that answers half of its replies, garbage, or without end: the bus stays away, or comes back, and neither crashes nor fills up.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <mutex>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "server/bus/redis.h"
#include "tests/support/redis_server.h"
#include "tests/support/sanitized.h"
#include "tests/support/waiting.h"
#include "tests/unit/server/bus/laws.h"

namespace ridgecast::bus {
namespace {

using namespace std::chrono_literals;
using testing_support::await;
using testing_support::RedisServer;

// Between a bus and its engine: what the engine says is passed on, up to a fault.
class Meddler {
 public:
  struct Fault {
    std::size_t after = 0;      // bytes of replies on one connection; then
    std::string says{};         // this instead of the rest,
    bool withoutEnd = false;    // again and again,
    bool isSilentThen = false;  // and nothing, instead of closing
  };

  explicit Meddler(std::uint16_t engine) : engine_(engine) {
    listener_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address = at(0);
    if (bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 || listen(listener_, 16) != 0)
      throw std::runtime_error("cannot listen");
    socklen_t length = sizeof address;
    getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &length);
    port_ = ntohs(address.sin_port);
    threads_.emplace_back([this] { accept(); });
  }
  ~Meddler() {
    ends_ = true;
    for (std::size_t i = 0;; ++i) {
      std::thread thread;
      {
        const std::lock_guard lock(mutex_);
        if (i == threads_.size()) break;
        thread = std::move(threads_[i]);
      }
      thread.join();
    }
    close(listener_);
  }
  Meddler(const Meddler&) = delete;
  Meddler& operator=(const Meddler&) = delete;

  std::string url() const { return "redis://127.0.0.1:" + std::to_string(port_); }
  // Of the next connections, so many.
  void spoil(int connections, Fault fault) {
    const std::lock_guard lock(mutex_);
    left_ = connections;
    fault_ = std::move(fault);
  }
  // Of those that are open, at once; once each.
  void spoilOpen(Fault fault) {
    const std::lock_guard lock(mutex_);
    now_ = std::move(fault);
    ++moment_;
  }
  std::size_t said() const { return said_; }  // bytes of faults

 private:
  static sockaddr_in at(std::uint16_t port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(port);
    return address;
  }
  static bool isReadable(int socket) {
    pollfd waits{socket, POLLIN, 0};
    return poll(&waits, 1, 5) > 0;
  }
  void accept() {
    while (!ends_) {
      if (!isReadable(listener_)) continue;
      const int client = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      if (client < 0) continue;
      const std::lock_guard lock(mutex_);
      std::optional<Fault> fault;
      if (left_ > 0) --left_, fault = fault_;
      threads_.emplace_back([this, client, fault, moment = moment_] { pass(client, fault, moment); });
    }
  }
  bool say(int to, const std::string& bytes) {
    const ssize_t sent = send(to, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent > 0) said_ += static_cast<std::size_t>(sent);
    return sent > 0 || errno == EAGAIN;
  }
  void pass(int client, std::optional<Fault> fault, int moment) {
    const int engine = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const sockaddr_in address = at(engine_);
    bool goesOn = connect(engine, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
    std::size_t passed = 0;
    std::string buffer(65'536, '\0');
    while (goesOn && !ends_) {
      {
        const std::lock_guard lock(mutex_);
        if (moment != moment_) {
          moment = moment_;
          fault = now_;
          fault->after = passed;
        }
      }
      if (fault && passed >= fault->after) {
        goesOn = fault->says.empty() || say(client, fault->says);
        while (goesOn && fault->withoutEnd && !ends_) goesOn = say(client, fault->says);
        while (goesOn && fault->isSilentThen && !ends_) goesOn = !isReadable(client) || recv(client, buffer.data(), buffer.size(), 0) > 0;
        break;
      }
      for (const auto& [from, to] : {std::pair(client, engine), std::pair(engine, client)}) {
        if (!goesOn || !isReadable(from)) continue;
        const ssize_t got = recv(from, buffer.data(), buffer.size(), 0);
        if (got <= 0) {
          goesOn = false;
          break;
        }
        std::size_t bytes = static_cast<std::size_t>(got);
        if (from == engine && fault) bytes = std::min(bytes, fault->after - passed);
        if (from == engine) passed += bytes;
        for (std::size_t sent = 0; sent < bytes && goesOn;) {
          const ssize_t more = send(to, buffer.data() + sent, bytes - sent, MSG_NOSIGNAL);
          goesOn = more > 0;
          sent += static_cast<std::size_t>(std::max<ssize_t>(more, 0));
        }
      }
    }
    close(engine);
    close(client);
  }

  const std::uint16_t engine_;
  std::uint16_t port_ = 0;
  int listener_ = -1;
  std::atomic<bool> ends_ = false;
  std::atomic<std::size_t> said_ = 0;
  std::mutex mutex_;
  int left_ = 0, moment_ = 0;
  Fault fault_, now_;
  std::vector<std::thread> threads_;
};

const std::vector<std::string> kGarbage{
    "",
    std::string(100, '\xff'),
    "$9223372036854775807\r\nx",
    "*2147483647\r\n",
    "*65000\r\n*65000\r\n",
    ":x\r\n",
    "-ERR no\r\n-LOADING\r\n-READONLY\r\n",
    "*3\r\n$7\r\nmessage\r\n$1\r\nx\r\n$1\r\ny\r\n",
    "*3\r\n$7\r\nmessage\r\n*0\r\n$-1\r\n",
    "+OK\r\n+OK\r\n+OK\r\n+OK\r\n+OK\r\n+OK\r\n+OK\r\n+OK\r\n+OK\r\n+OK\r\n+OK\r\n+OK\r\n+OK\r\n+OK\r\n+OK\r\n",
    "HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n"};

// Replies break off anywhere while a bus connects, and something else may follow. The next connections are whole: it connects, unless what
// it heard was a refusal.
TEST(MeddledBus, SurvivesWhateverIsSaidWhileItConnects) {
  const RedisServer redis;
  std::mt19937 random(7);
  int connected = 0;
  for (int round = 0; round < testing_support::rounds(80); ++round) {
    Meddler meddler(redis.port());
    meddler.spoil(2, {random() % (round % 2 ? 200 : 7000), kGarbage[static_cast<std::size_t>(round) % kGarbage.size()]});
    const auto bus = Redis::connect({meddler.url(), {}, {}}, std::make_shared<metrics::Metrics>());
    connected += bus ? 1 : 0;
    if (!bus) {
      EXPECT_NE(bus.error().message, "");
    }
  }
  EXPECT_GT(connected, testing_support::rounds(80) / 2);
}

TEST(MeddledBus, ComesBackAfterWhateverIsSaidToIt) {
  const RedisServer redis;
  Meddler meddler(redis.port());
  const auto figures = std::make_shared<metrics::Metrics>();
  const auto bus = Redis::connect({meddler.url(), {}, {}}, figures);
  ASSERT_TRUE(bus) << bus.error().message;
  std::uint64_t last = 0;
  std::vector<std::string> done;
  const Heard<std::uint64_t> changed;
  const auto watching = (*bus)->watch("log", changed.take());
  for (const std::string& garbage : kGarbage) {
    meddler.spoilOpen({0, garbage});
    // Its answers, and what is there in the end, are right.
    for (int i = 0; i < 5; ++i) {
      const Answer<Appended> answer;
      const std::string entry = std::to_string(done.size()) + " " + std::to_string(i);
      (*bus)->append("log", last, {entry}, Bus::Origin::kNew, answer.take());
      ASSERT_TRUE(await([&] { return answer.has(); }));
      if (answer.get().kind == Appended::Kind::kDone && answer.get().last == last + 1) last = answer.get().last;
    }
    ASSERT_TRUE(await([&] { return !(*bus)->isAway(); }));
    const Answer<Outcome<std::vector<Entry>>> page;
    (*bus)->read("log", 0, 1 << 20, page.take());
    ASSERT_TRUE(await([&] { return page.has(); }));
    if (page.get()) last = page.get()->size();
  }
  EXPECT_TRUE(await([&] { return !(*bus)->isAway() && changed.size() > 1; }));
}

// It was away, though perhaps for a few milliseconds, and is there again.
bool hasComeBack(const metrics::Metrics& figures) {
  return figures.registry.text().find("ridgecast_bus_reconnects_total 1\n") != std::string::npos;
}

// A reply without end is cut off, whatever it is made of.
TEST(MeddledBus, EndsAConnectionThatSaysTooMuch) {
  const RedisServer redis;
  std::string oks;
  while (oks.size() < 1 << 16) oks += "+OK\r\n";
  for (const std::string& says : {"$9000000000000000000\r\n" + std::string(1 << 16, 'x'), oks}) {
    Meddler meddler(redis.port());
    const auto figures = std::make_shared<metrics::Metrics>();
    const auto bus = Redis::connect({meddler.url(), {}, {}}, figures);
    ASSERT_TRUE(bus) << bus.error().message;
    meddler.spoilOpen({0, says, true});
    ASSERT_TRUE(await([&] { return hasComeBack(*figures) || meddler.said() > (1u << 30); }));
    EXPECT_LT(meddler.said(), std::size_t{200} << 20);
  }
}

// Silence in the midst of a greeting, or of a reply, is not waited out.
TEST(MeddledBus, LeavesAnEngineThatFallsSilent) {
  const RedisServer redis;
  Meddler meddler(redis.port());
  meddler.spoil(2, {100, "", false, true});
  const auto figures = std::make_shared<metrics::Metrics>();
  const auto bus = Redis::connect({meddler.url(), {}, {}}, figures);
  ASSERT_TRUE(bus) << bus.error().message;  // by the second try
  meddler.spoilOpen({0, "*3\r\n$1000\r\nx", false, true});
  ASSERT_TRUE(await([&] { return hasComeBack(*figures); }));
}

}  // namespace
}  // namespace ridgecast::bus
