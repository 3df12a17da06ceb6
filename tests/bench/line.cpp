#include "tests/bench/line.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <stdexcept>

#include "common/wire/wire.h"
#include "tests/bench/frames.h"

namespace ridgecast::bench {

Line::Line(std::uint16_t port, std::string name, std::uint32_t triangleBudget, std::uint64_t bytesPerSecond)
    : name_(std::move(name)), triangleBudget_(triangleBudget), bytesPerSecond_(bytesPerSecond) {
  socket_ = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0)
    throw std::runtime_error("cannot connect to the server");
  const int one = 1;
  setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
  write(
      "GET /v1/stream HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: "
      "13\r\nSec-WebSocket-Key: "
      "dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n");
}

Line::~Line() { ::close(socket_); }

double Line::age() const { return opened_.seconds(); }

void Line::pose(const camera::Camera& camera) {
  wire::PoseMessage p;
  p.sequence = ++sequence_;
  p.camera = camera;
  waiting_.push_back({sequence_, Clock()});
  frame(2, wire::encode(wire::ClientMessage(p)));
}

void Line::receive() {
  char chunk[65536];
  for (;;) {
    const auto n = ::recv(socket_, chunk, sizeof chunk, MSG_DONTWAIT);
    if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) break;
    if (n <= 0) throw std::runtime_error("the server hung up on " + name_);
    in_.append(chunk, static_cast<std::size_t>(n));
    if (static_cast<std::size_t>(n) < sizeof chunk) break;
  }
  if (!open_) {
    const auto end = in_.find("\r\n\r\n");
    if (end == std::string::npos) return;
    if (in_.compare(0, 12, "HTTP/1.1 101") != 0) throw std::runtime_error("refused: " + in_.substr(0, 200));
    in_.erase(0, end + 4);
    open_ = true;
    wire::Hello hello;
    hello.points = true;
    hello.clientName = "bench";
    hello.settings.triangleBudget = triangleBudget_;
    hello.settings.bytesPerSecond = bytesPerSecond_;
    frame(2, wire::encode(wire::ClientMessage(hello)));
  }
  std::size_t at = 0;
  while (const auto next = firstFrame(std::string_view(in_).substr(at))) {
    at += next->bytes;
    if (next->opcode == 2) take({reinterpret_cast<const std::uint8_t*>(next->payload.data()), next->payload.size()});
    if (next->opcode == 9) frame(10, next->payload);
    if (next->opcode == 8) throw std::runtime_error("the server closed " + name_ + ": " + std::string(next->payload.substr(2)));
  }
  in_.erase(0, at);
}

void Line::restart() {
  iterations = 0;
  bytes = 0;
  latencies.clear();
  thresholds.clear();
  encodeMs = totalMs = 0;
}

void Line::take(std::span<const std::uint8_t> payload) {
  const auto message = wire::decodeServer(payload);
  if (!message) throw std::runtime_error(message.error().message);
  if (const auto* error = std::get_if<wire::ErrorMessage>(&*message)) throw std::runtime_error(error->message);
  const auto* it = std::get_if<wire::Iteration>(&*message);
  if (!it) return;
  if (coarseMs == 0) coarseMs = opened_.seconds() * 1e3;
  ++iterations;
  bytes += payload.size();
  const settings::IterationStats& f = it->figures;
  encodeMs += f.encodeMs;
  totalMs += f.selectMs + f.generateMs + f.refineMs + f.triangulateMs + f.encodeMs;
  thresholds.push_back(f.effectiveThreshold);
  settled = it->settled;
  while (!waiting_.empty() && waiting_.front().first <= it->poseSequence) {
    latencies.push_back(waiting_.front().second.seconds() * 1e3);
    waiting_.pop_front();
  }
  frame(2, wire::encode(wire::ClientMessage(wire::Acknowledge{it->number, it->meshHash})));
}

void Line::frame(int opcode, std::string_view payload) { write(maskedFrame(opcode, payload)); }

void Line::write(std::string_view out) {
  while (!out.empty()) {
    const auto n = ::send(socket_, out.data(), out.size(), MSG_NOSIGNAL);
    if (n <= 0) throw std::runtime_error("the server hung up");
    out.remove_prefix(static_cast<std::size_t>(n));
  }
}

}  // namespace ridgecast::bench
