// Members that only say where they are, each with a state, ten times a second: what one is sent, and what that costs.
//
//   ridgecast-bench presence [--count N] [--seconds S] [--state BYTES] [--side METRES] [--ports A,B,...]
//
// First the session alone, in simulated time (`room_`): two of them with half of the members each, over an engine in memory. Then a real
// server over loopback sockets; --ports: servers that run already, with the members spread over them. Members walk at 2 m/s on a square of
// this side. The clients count what comes; every sixteenth decodes it, and takes the time that a near member's move took by the clock that
// it put into its state.
#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <map>
#include <memory>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "common/wire/wire.h"
#include "server/presence/presence.h"
#include "tests/bench/bench.h"
#include "tests/bench/frames.h"
#include "tests/bench/usage.h"
#include "tests/support/bytes.h"
#include "tests/support/server_process.h"
#include "tests/support/simulated_bus.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::bench {
namespace {

using namespace std::chrono_literals;
using Time = std::chrono::steady_clock;

struct Town {
  int count = 2000;
  double seconds = 10;
  std::size_t state = 256;
  double side = 4000;
  std::vector<std::uint16_t> ports;
};

// One that walks, and turns now and then.
class Walker {
 public:
  Walker(double side, std::uint64_t seed) : random_(seed), side_(side) { x_ = side * unit(), z_ = side * unit(); }
  wire::PoseMessage next(double seconds, std::size_t state) {
    if (unit() < 0.05) yaw_ = 6.28 * unit();
    x_ = std::fmod(x_ - 2 * seconds * std::sin(yaw_) + side_, side_);
    z_ = std::fmod(z_ - 2 * seconds * std::cos(yaw_) + side_, side_);
    wire::PoseMessage pose{++sequence_, {}, std::vector<std::uint8_t>(state)};
    pose.camera.pose = {.x = std::llround(x_ * 256), .z = std::llround(z_ * 256), .y = 1.7, .yaw = yaw_};
    const std::int64_t now = Time::now().time_since_epoch().count();
    if (state >= sizeof now) std::memcpy(pose.state.data(), &now, sizeof now);
    return pose;
  }

 private:
  double unit() { return std::uniform_real_distribution<double>(0, 1)(random_); }
  std::mt19937_64 random_;
  double side_, x_ = 0, z_ = 0, yaw_ = 1;
  std::uint64_t sequence_ = 0;
};

wire::Hello helloOf(int index) {
  wire::Hello hello;
  hello.clientName = "walker " + std::to_string(index);
  hello.members = hello.states = hello.placesOnly = true;
  hello.near = 24;
  return hello;
}

struct Counting final : conversation::Sender {
  void send(wire::ServerMessage, std::shared_ptr<const void>) override {}
  void sendShared(std::shared_ptr<const std::string> encoded, std::shared_ptr<const void>) override { bytes += encoded->size(); }
  std::size_t queuedBytes() const override { return 0; }
  void fail(wire::ErrorMessage) override {}
  std::size_t bytes = 0;
};

void measureRoom(const Town& plan, Report& report) {
  testing_support::SimulatedTimer timer;
  testing_support::SimulatedEngine engine(timer);
  std::vector<std::shared_ptr<presence::Presence>> sessions;
  for (int k = 0; k < 2; ++k) {
    sessions.push_back(std::make_shared<presence::Presence>(timer, std::make_shared<clock::SessionClock>(timer)));
    sessions.back()->share(engine.connect(), "members/default");
  }
  std::vector<std::shared_ptr<Counting>> senders;
  std::vector<Walker> walkers;
  const auto pass = [&](double seconds) {
    for (int tick = 0; tick < std::lround(seconds * 100); ++tick) {
      for (std::size_t k = static_cast<std::size_t>(tick % 10); k < walkers.size(); k += 10)
        sessions[k % 2]->receive(k + 1, walkers[k].next(0.1, plan.state));
      timer.advance(10ms);
    }
  };
  for (int k = 0; k < plan.count; ++k) {
    const auto at = static_cast<std::size_t>(k);
    senders.push_back(std::make_shared<Counting>());
    walkers.emplace_back(plan.side, at + 1);
    sessions[at % 2]->join(at + 1, helloOf(k), senders.back(), walkers.back().next(0.1, plan.state));
  }
  pass(3);
  for (const auto& sender : senders) sender->bytes = 0;
  const double seconds = std::min(plan.seconds, 3.0), before = cpuSeconds();
  const auto told = engine.traffic().toldBytes;
  pass(seconds);
  std::vector<double> rates;
  for (const auto& sender : senders) rates.push_back(static_cast<double>(sender->bytes) / seconds);
  report.add("room_cores", (cpuSeconds() - before) / seconds, "both servers");
  report.add("room_bytes_per_second", median(rates), "B/s a client");
  report.add("room_bytes_per_second_worst", std::ranges::max(rates), "B/s a client");
  report.add("room_bus_bytes_per_second", static_cast<double>(engine.traffic().toldBytes - told) / seconds, "B/s");
}

// ---- sockets ----

class Client {
 public:
  Client(std::uint16_t port, int index, const Town& plan)
      : decodes_(index % 16 == 0), state_(plan.state), walker_(plan.side, static_cast<std::uint64_t>(index) + 1) {
    socket_ = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) throw std::runtime_error("cannot connect");
    const int yes = 1;
    ::setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    write(
        "GET /v1/stream?session=default HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n");
    hello_ = wire::encode(wire::ClientMessage(helloOf(index)));
  }
  ~Client() { ::close(socket_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  int socket() const { return socket_; }
  void place(double seconds) {
    if (open_) frame(2, wire::encode(wire::ClientMessage(walker_.next(seconds, state_))));
  }
  void receive() {
    char piece[65'536];
    for (;;) {
      const ssize_t n = ::recv(socket_, piece, sizeof piece, MSG_DONTWAIT);
      if (n == 0) throw std::runtime_error("the server hung up");
      if (n < 0) return;
      in_.append(piece, static_cast<std::size_t>(n));
      if (!open_) {
        const std::size_t end = in_.find("\r\n\r\n");
        if (end == std::string::npos) continue;
        if (!in_.starts_with("HTTP/1.1 101")) throw std::runtime_error(in_);
        in_.erase(0, end + 4);
        open_ = true;
        frame(2, hello_);
      }
      takeFrames();
    }
  }

  std::size_t bytes = 0, messages = 0;
  std::vector<double> delays;  // ms, of moves of near members
  std::uint32_t others = 0;

 private:
  void takeFrames() {
    std::size_t at = 0;
    while (const auto next = firstFrame(std::string_view(in_).substr(at))) {
      at += next->bytes;
      bytes += next->bytes;
      ++messages;
      if (next->opcode == 9) frame(10, next->payload);
      if (next->opcode == 8) throw std::runtime_error("the server ends the stream: " + std::string(next->payload.substr(2)));
      if (next->opcode == 2 && decodes_) take(next->payload);
    }
    in_.erase(0, at);
  }
  void take(std::string_view payload) {
    const auto message = wire::decodeServer({reinterpret_cast<const std::uint8_t*>(payload.data()), payload.size()});
    if (!message) throw std::runtime_error(message.error().message);
    if (const auto* error = std::get_if<wire::ErrorMessage>(&*message)) throw std::runtime_error(error->message);
    const auto* members = std::get_if<wire::Members>(&*message);
    if (!members) return;
    others = members->others;
    // The nearest come first.
    for (std::size_t k = 0; k < std::min<std::size_t>(members->moved.size(), 12); ++k) {
      std::int64_t sent = 0;
      const auto& state = members->moved[k].pose.state;
      if (state.size() < sizeof sent) continue;
      std::memcpy(&sent, state.data(), sizeof sent);
      delays.push_back(static_cast<double>(Time::now().time_since_epoch().count() - sent) * 1e-6);
    }
  }
  void frame(int opcode, std::string_view payload) { write(maskedFrame(opcode, payload)); }
  void write(const std::string& out) {
    if (::send(socket_, out.data(), out.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(out.size()))
      throw std::runtime_error("cannot send: " + std::string(std::strerror(errno)));
  }

  const bool decodes_;
  const std::size_t state_;
  Walker walker_;
  int socket_ = -1;
  bool open_ = false;
  std::string in_, hello_;
};

void measureServer(const Town& plan, const Options& options, Report& report) {
  rlimit files{};
  ::getrlimit(RLIMIT_NOFILE, &files);
  files.rlim_cur = files.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &files);
  const std::string many = std::to_string(plan.count + 8);
  std::unique_ptr<testing_support::ServerProcess> server;
  std::vector<std::uint16_t> ports = plan.ports;
  if (ports.empty()) {
    server = std::make_unique<testing_support::ServerProcess>(
        options.programFolder + "/ridgecast-server",
        std::vector<std::string>{"--max-cameras", many, "--max-members", many, "--max-connections", many, "--max-connections-per-address",
                                 many, "--max-total-triangles", "1000000000000"});
    ports.push_back(server->port());
  }
  const int poll = ::epoll_create1(0);
  std::vector<std::unique_ptr<Client>> clients;
  const Clock clock;
  const double joining = plan.count / 400.0, warm = joining + 8;
  double next = 0, measuredFrom = 0, cpu = 0, own = 0;
  std::size_t placed = 0;
  for (;;) {
    const double now = clock.seconds();
    if (measuredFrom == 0 && now >= warm) {
      measuredFrom = now;
      own = cpuSeconds();
      if (server) cpu = cpuSeconds(server->process().id());
      for (const auto& client : clients) client->bytes = client->messages = 0, client->delays.clear();
    }
    if (measuredFrom != 0 && now - measuredFrom >= plan.seconds) break;
    while (static_cast<int>(clients.size()) < plan.count && now >= joining * static_cast<double>(clients.size()) / plan.count) {
      const int k = static_cast<int>(clients.size());
      clients.push_back(std::make_unique<Client>(ports[static_cast<std::size_t>(k) % ports.size()], k, plan));
      epoll_event event{};
      event.events = EPOLLIN;
      event.data.u32 = static_cast<std::uint32_t>(k);
      ::epoll_ctl(poll, EPOLL_CTL_ADD, clients.back()->socket(), &event);
    }
    // A tenth of the members every 10 ms.
    for (; next <= now; next += 0.01, ++placed)
      for (std::size_t k = placed % 10; k < clients.size(); k += 10) clients[k]->place(0.1);
    epoll_event events[256];
    const int n = ::epoll_wait(poll, events, 256, 2);
    for (int k = 0; k < n; ++k) clients[events[k].data.u32]->receive();
  }
  const double seconds = clock.seconds() - measuredFrom;
  std::vector<double> rates, delays;
  double messages = 0;
  for (const auto& client : clients) {
    rates.push_back(static_cast<double>(client->bytes) / seconds);
    delays.insert(delays.end(), client->delays.begin(), client->delays.end());
    messages += static_cast<double>(client->messages) / seconds / plan.count;
  }
  report.add("bytes_per_second", median(rates), "B/s a client");
  report.add("bytes_per_second_worst", std::ranges::max(rates), "B/s a client");
  report.add("messages_per_second", messages, "a client");
  if (server) report.add("server_cores", (cpuSeconds(server->process().id()) - cpu) / seconds);
  report.add("generator_cores", (cpuSeconds() - own) / seconds);
  report.add("others", clients.front()->others, "as told");
  if (!delays.empty()) {
    report.add("near_p50_ms", percentile(delays, 0.5), "ms");
    report.add("near_p99_ms", percentile(delays, 0.99), "ms");
    report.add("near_worst_ms", percentile(delays, 1), "ms");
  }
  clients.clear();
  ::close(poll);
}

}  // namespace

Report presence(const Options& options) {
  Town plan;
  if (options.quick) plan.count = 200, plan.seconds = 2;
  for (std::size_t k = 0; k + 1 < options.arguments.size(); k += 2) {
    const std::string &name = options.arguments[k], &value = options.arguments[k + 1];
    if (name == "--count") plan.count = std::stoi(value);
    if (name == "--seconds") plan.seconds = std::stod(value);
    if (name == "--state") plan.state = std::stoul(value);
    if (name == "--side") plan.side = std::stod(value);
    if (name == "--ports")
      for (std::istringstream in(value); in.good();) {
        std::string port;
        std::getline(in, port, ',');
        plan.ports.push_back(static_cast<std::uint16_t>(std::stoi(port)));
      }
  }
  Report report;
  report.note(std::to_string(plan.count) + " members at 10 Hz with " + std::to_string(plan.state) + " bytes of state, on " +
              std::to_string(std::lround(plan.side)) + " m");
  measureRoom(plan, report);
  measureServer(plan, options, report);
  return report;
}

}  // namespace ridgecast::bench
