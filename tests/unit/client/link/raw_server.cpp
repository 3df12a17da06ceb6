#include "tests/unit/client/link/raw_server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <bit>
#include <cstring>
#include <stdexcept>
#include <vector>

namespace ridgecast::test {
namespace {

// RFC 3174, for the WebSocket handshake's accept key.
std::array<std::uint8_t, 20> sha1(std::string text) {
  std::array<std::uint32_t, 5> h{0x67452301, 0xEFCDAB89, 0x98BADCFE, 0x10325476, 0xC3D2E1F0};
  const std::uint64_t bits = text.size() * 8;
  text += '\x80';
  while (text.size() % 64 != 56) text += '\0';
  for (int k = 7; k >= 0; --k) text += static_cast<char>(bits >> (8 * k));
  for (std::size_t block = 0; block < text.size(); block += 64) {
    std::array<std::uint32_t, 80> w{};
    for (std::size_t k = 0; k < 64; ++k) w[k / 4] = w[k / 4] << 8 | static_cast<std::uint8_t>(text[block + k]);
    for (std::size_t k = 16; k < 80; ++k) w[k] = std::rotl(w[k - 3] ^ w[k - 8] ^ w[k - 14] ^ w[k - 16], 1);
    auto [a, b, c, d, e] = h;
    for (std::size_t k = 0; k < 80; ++k) {
      const std::uint32_t f = k < 20   ? ((b & c) | (~b & d)) + 0x5A827999
                              : k < 40 ? (b ^ c ^ d) + 0x6ED9EBA1
                              : k < 60 ? ((b & c) | (b & d) | (c & d)) + 0x8F1BBCDC
                                       : (b ^ c ^ d) + 0xCA62C1D6;
      const std::uint32_t next = std::rotl(a, 5) + f + e + w[k];
      e = d, d = c, c = std::rotl(b, 30), b = a, a = next;
    }
    h[0] += a, h[1] += b, h[2] += c, h[3] += d, h[4] += e;
  }
  std::array<std::uint8_t, 20> out{};
  for (std::size_t k = 0; k < 20; ++k) out[k] = static_cast<std::uint8_t>(h[k / 4] >> (24 - 8 * (k % 4)));
  return out;
}

std::string base64(const std::array<std::uint8_t, 20>& bytes) {
  static const char* const digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t k = 0; k < 21; k += 3) {
    const auto at = [&](std::size_t n) { return n < 20 ? std::uint32_t{bytes[n]} : 0u; };
    const std::uint32_t v = at(k) << 16 | at(k + 1) << 8 | at(k + 2);
    for (int shift : {18, 12, 6, 0}) out += digits[v >> shift & 63];
  }
  out.back() = '=';
  return out;
}

int loopbackListener(std::string& port) {
  const int listener = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  if (bind(listener, reinterpret_cast<sockaddr*>(&address), size) != 0 || listen(listener, 4) != 0 ||
      getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size) != 0)
    throw std::runtime_error("no loopback port");
  port = std::to_string(ntohs(address.sin_port));
  return listener;
}

}  // namespace

void RawConnection::send(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t sent = ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent <= 0) return;
    bytes.remove_prefix(static_cast<std::size_t>(sent));
  }
}

bool RawConnection::readExactly(char* to, std::size_t size) {
  while (size > 0) {
    const ssize_t got = recv(socket_, to, size, 0);
    if (got <= 0) return false;
    to += got;
    size -= static_cast<std::size_t>(got);
  }
  return true;
}

std::string RawConnection::readHead() {
  std::string head;
  char c = 0;
  while (!head.ends_with("\r\n\r\n") && readExactly(&c, 1)) head += c;
  return head;
}

void RawConnection::upgrade() {
  const std::string head = readHead(), name = "Sec-WebSocket-Key: ";
  const std::size_t at = head.find(name);
  const std::string key = at == std::string::npos ? "" : head.substr(at + name.size(), head.find("\r\n", at) - at - name.size());
  send("HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: " +
       base64(sha1(key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11")) + "\r\n\r\n");
}

void RawConnection::sendFrame(std::string_view payload, int opcode) {
  std::string frame(1, static_cast<char>(0x80 | opcode));
  const std::size_t size = payload.size();
  const int lengthBytes = size < 126 ? 0 : size < 65536 ? 2 : 8;
  frame += static_cast<char>(lengthBytes == 0 ? size : lengthBytes == 2 ? 126 : 127);
  for (int k = lengthBytes - 1; k >= 0; --k) frame += static_cast<char>(size >> (8 * k));
  send(frame.append(payload));
}

void RawConnection::sendClose(std::uint16_t code, std::string_view reason) {
  std::string payload{static_cast<char>(code >> 8), static_cast<char>(code)};
  sendFrame(payload.append(reason), 8);
}

std::string RawConnection::readFrame() {
  for (;;) {
    unsigned char head[2];
    if (!readExactly(reinterpret_cast<char*>(head), 2)) return {};
    std::uint64_t size = head[1] & 0x7f;
    unsigned char more[8];
    const std::size_t lengthBytes = size == 126 ? 2 : size == 127 ? 8 : 0;
    if (!readExactly(reinterpret_cast<char*>(more), lengthBytes)) return {};
    if (lengthBytes > 0) size = 0;
    for (std::size_t k = 0; k < lengthBytes; ++k) size = size << 8 | more[k];
    char mask[4]{};
    if ((head[1] & 0x80) != 0 && !readExactly(mask, 4)) return {};
    std::string payload(size, '\0');
    if (!readExactly(payload.data(), size)) return {};
    for (std::size_t k = 0; k < size; ++k) payload[k] ^= mask[k % 4];
    const int opcode = head[0] & 0x0f;
    if (opcode == 8) return {};
    if (opcode == 1 || opcode == 2) return payload;
  }
}

void RawConnection::drain() {
  char bytes[4096];
  while (recv(socket_, bytes, sizeof bytes, 0) > 0) {
  }
}

RawServer::RawServer(std::function<void(RawConnection&)> script, int connections) : listener_(loopbackListener(port_)) {
  thread_ = std::thread([this, connections, play = std::move(script)] {
    for (int k = 0; k < connections; ++k) {
      pollfd waiting{.fd = listener_, .events = POLLIN, .revents = 0};
      if (poll(&waiting, 1, 10'000) <= 0) return;
      const int peer = accept(listener_, nullptr, nullptr);
      RawConnection connection(peer);
      play(connection);
      close(peer);
    }
  });
}

RawServer::~RawServer() {
  thread_.join();
  close(listener_);
}

std::string closedPort() {
  std::string port;
  close(loopbackListener(port));
  return port;
}

}  // namespace ridgecast::test
