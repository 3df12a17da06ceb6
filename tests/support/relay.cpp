#include "tests/support/relay.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <deque>
#include <list>
#include <random>
#include <stdexcept>
#include <thread>
#include <vector>

namespace ridgecast::testing_support {

namespace {

using Clock = std::chrono::steady_clock;

sockaddr_in loopback(std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

}  // namespace

struct Relay::Impl {
  // One way of one connection.
  struct Way {
    struct Chunk {
      Clock::time_point due;
      std::string bytes;
    };
    std::deque<Chunk> line;
    std::size_t waiting = 0;
    Clock::time_point lastDue{};
    bool ended = false;  // nothing more comes
  };

  struct Pair {
    int client = -1, server = -1;
    Way up, down;
  };

  Line line;
  std::uint16_t target = 0, port = 0;
  int listener = -1;
  int wakeup[2] = {-1, -1};
  std::atomic<bool> ends{false}, breaks{false}, held{false};
  std::atomic<std::uint64_t> down{0};
  std::list<Pair> pairs;
  Clock::time_point upSent{}, downSent{};  // when all that was put on the line has left
  std::minstd_rand random{7};
  std::thread thread;

  std::size_t capacity() const {
    const double seconds = std::chrono::duration<double>(line.delay + line.jitter).count() + 0.05;
    return std::max<std::size_t>(
        65536, static_cast<std::size_t>(static_cast<double>(line.bytesPerSecond ? line.bytesPerSecond : 200'000'000) * seconds));
  }

  void wake() {
    const char byte = 0;
    if (::write(wakeup[1], &byte, 1) < 0) return;
  }

  void receive(int from, Way& way, Clock::time_point& sent) {
    char bytes[16384];
    const auto n = ::recv(from, bytes, sizeof bytes, MSG_DONTWAIT);
    if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return;
    if (n <= 0) {
      way.ended = true;
      return;
    }
    const auto now = Clock::now();
    sent = std::max(sent, now);
    if (line.bytesPerSecond)
      sent += std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 * static_cast<double>(n) / static_cast<double>(line.bytesPerSecond)));
    const auto jitter = line.jitter.count() ? std::chrono::microseconds(random() % static_cast<unsigned>(line.jitter.count()))
                                            : std::chrono::microseconds(0);
    way.lastDue = std::max(way.lastDue, sent + line.delay + jitter);
    way.line.push_back({way.lastDue, std::string(bytes, static_cast<std::size_t>(n))});
    way.waiting += static_cast<std::size_t>(n);
  }

  // False: the receiver is gone.
  bool deliver(int to, Way& way, std::atomic<std::uint64_t>* count) {
    const auto now = Clock::now();
    while (!way.line.empty() && way.line.front().due <= now) {
      std::string& bytes = way.line.front().bytes;
      const auto n = ::send(to, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
      if (n < 0) return errno == EAGAIN || errno == EWOULDBLOCK;
      way.waiting -= static_cast<std::size_t>(n);
      if (count) *count += static_cast<std::uint64_t>(n);
      if (static_cast<std::size_t>(n) < bytes.size()) {
        bytes.erase(0, static_cast<std::size_t>(n));
        return true;
      }
      way.line.pop_front();
    }
    return !(way.ended && way.line.empty());
  }

  static void reset(Pair& pair) {
    const linger now{1, 0};
    for (int s : {pair.client, pair.server}) {
      setsockopt(s, SOL_SOCKET, SO_LINGER, &now, sizeof now);
      ::close(s);
    }
  }

  void accept() {
    Pair pair;
    pair.client = ::accept(listener, nullptr, nullptr);
    if (pair.client < 0) return;
    pair.server = ::socket(AF_INET, SOCK_STREAM, 0);
    const sockaddr_in address = loopback(target);
    if (::connect(pair.server, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) return reset(pair);
    const int one = 1;
    for (int s : {pair.client, pair.server}) setsockopt(s, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    pairs.push_back(std::move(pair));
  }

  void run() {
    while (!ends) {
      if (breaks.exchange(false)) {
        for (Pair& pair : pairs) reset(pair);
        pairs.clear();
      }
      std::vector<pollfd> polled{{listener, POLLIN, 0}, {wakeup[0], POLLIN, 0}};
      auto next = Clock::now() + std::chrono::milliseconds(100);
      const std::size_t room = capacity();
      for (Pair& pair : pairs)
        for (auto [socket, in, out] : {std::tuple{pair.client, &pair.up, &pair.down}, std::tuple{pair.server, &pair.down, &pair.up}}) {
          short events = 0;
          if (!held && !in->ended && in->waiting < room) events |= POLLIN;
          if (!held && !out->line.empty()) {
            if (out->line.front().due <= Clock::now())
              events |= POLLOUT;
            else
              next = std::min(next, out->line.front().due);
          }
          polled.push_back({events ? socket : -1, events, 0});
        }
      const auto wait = std::max<std::int64_t>(0, std::chrono::duration_cast<std::chrono::nanoseconds>(next - Clock::now()).count());
      const timespec timeout{wait / 1'000'000'000, wait % 1'000'000'000};
      ::ppoll(polled.data(), polled.size(), &timeout, nullptr);
      if (polled[1].revents) {
        char drain[64];
        if (::read(wakeup[0], drain, sizeof drain) < 0) continue;
      }
      std::size_t k = 2;
      for (auto it = pairs.begin(); it != pairs.end();) {
        if (polled[k].revents) receive(it->client, it->up, upSent);
        if (polled[k + 1].revents) receive(it->server, it->down, downSent);
        k += 2;
        const bool alive = held || (deliver(it->server, it->up, nullptr) && deliver(it->client, it->down, &down));
        if (!alive) {
          ::close(it->client);
          ::close(it->server);
          it = pairs.erase(it);
        } else {
          ++it;
        }
      }
      if (polled[0].revents) accept();
    }
    for (Pair& pair : pairs) reset(pair);
  }
};

Relay::Relay(std::uint16_t port, const Line& line) : impl_(std::make_unique<Impl>()) {
  impl_->line = line;
  impl_->target = port;
  impl_->listener = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address = loopback(0);
  socklen_t size = sizeof address;
  if (::bind(impl_->listener, reinterpret_cast<const sockaddr*>(&address), size) != 0 || ::listen(impl_->listener, 64) != 0 ||
      ::pipe(impl_->wakeup) != 0 || ::getsockname(impl_->listener, reinterpret_cast<sockaddr*>(&address), &size) != 0)
    throw std::runtime_error("the relay cannot listen");
  impl_->port = ntohs(address.sin_port);
  impl_->thread = std::thread([impl = impl_.get()] { impl->run(); });
}

Relay::~Relay() {
  impl_->ends = true;
  impl_->wake();
  impl_->thread.join();
  for (int f : {impl_->listener, impl_->wakeup[0], impl_->wakeup[1]}) ::close(f);
}

std::uint16_t Relay::port() const { return impl_->port; }
void Relay::breakAll() {
  impl_->breaks = true;
  impl_->wake();
}
void Relay::hold(bool held) {
  impl_->held = held;
  impl_->wake();
}
std::uint64_t Relay::bytesDown() const { return impl_->down; }

}  // namespace ridgecast::testing_support
