#include "tests/support/socket_client.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <cerrno>
#include <exception>
#include <utility>

#include "tests/support/waiting.h"

namespace ridgecast::testing_support {

SocketClient::SocketClient(std::uint16_t port, const char* from) {
  socket_ = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = inet_addr(from);
  ::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const timeval timeout{kTimeout.count(), 0};
  setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout);
  setsockopt(socket_, SOL_SOCKET, SO_SNDTIMEO, &timeout, sizeof timeout);
  if (::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
    ::close(socket_);
    socket_ = -1;
  }
}

SocketClient::~SocketClient() {
  if (socket_ >= 0) ::close(socket_);
}

bool SocketClient::send(std::string_view bytes) {
  while (!bytes.empty()) {
    const auto n = ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (n <= 0) return false;
    bytes.remove_prefix(static_cast<std::size_t>(n));
  }
  return true;
}

bool SocketClient::fill(std::size_t bytes) {
  char chunk[65536];
  while (buffer_.size() < bytes) {
    const auto n = ::recv(socket_, chunk, sizeof chunk, 0);
    if (n <= 0) return false;
    buffer_.append(chunk, static_cast<std::size_t>(n));
  }
  return true;
}

std::string SocketClient::answer(bool hasBody) {
  std::size_t end = std::string::npos;
  while ((end = buffer_.find("\r\n\r\n")) == std::string::npos)
    if (!fill(buffer_.size() + 1)) return {};
  end += 4;
  auto length = buffer_.find("Content-Length: ");
  if (length >= end) length = buffer_.find("content-length: ");  // as balancers write it
  if (hasBody && length < end) end += std::stoul(buffer_.substr(length + 16));
  if (!fill(end)) return {};
  std::string answer = buffer_.substr(0, end);
  buffer_.erase(0, end);
  return answer;
}

bool SocketClient::closed() {
  buffer_.clear();
  while (fill(1)) buffer_.clear();
  return errno != EAGAIN && errno != EWOULDBLOCK;
}

bool SocketClient::upgrade(std::string_view target, std::string_view headers) {
  send("GET " + std::string(target) +
       " HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: "
       "dGhlIHNhbXBsZSBub25jZQ==\r\n" +
       std::string(headers) + "\r\n");
  const std::string a = answer();
  // The answer to this key is the example of RFC 6455, section 1.3.
  if (a.starts_with("HTTP/1.1 101 ") && a.find("s3pPLMBiTxaQ9kYGzzhZRbK+xOo=") != std::string::npos) return true;
  refusal_ = a;
  return false;
}

bool SocketClient::frame(int opcode, std::string_view payload, bool final, std::optional<std::uint64_t> announced) {
  const std::uint64_t length = announced.value_or(payload.size());
  std::string bytes(1, static_cast<char>((final ? 0x80 : 0) | opcode));
  if (length < 126) {
    bytes += static_cast<char>(0x80 | length);
  } else if (length < 65536) {
    bytes += static_cast<char>(0x80 | 126);
    for (int shift = 8; shift >= 0; shift -= 8) bytes += static_cast<char>(length >> shift);
  } else {
    bytes += static_cast<char>(0x80 | 127);
    for (int shift = 56; shift >= 0; shift -= 8) bytes += static_cast<char>(length >> shift);
  }
  const char mask[4] = {0x12, 0x34, 0x56, 0x78};
  bytes.append(mask, 4);
  for (std::size_t k = 0; k < payload.size(); ++k) bytes += static_cast<char>(payload[k] ^ mask[k % 4]);
  return send(bytes);
}

std::optional<SocketClient::Frame> SocketClient::receive() {
  for (;;) {
    if (!fill(2)) return {};
    const auto byte = [this](std::size_t k) { return static_cast<std::uint64_t>(static_cast<unsigned char>(buffer_[k])); };
    std::size_t header = 2;
    std::uint64_t length = byte(1) & 0x7f;
    if (length >= 126) {
      const std::size_t extra = length == 126 ? 2 : 8;
      if (!fill(2 + extra)) return {};
      length = 0;
      for (std::size_t k = 0; k < extra; ++k) length = length << 8 | byte(2 + k);
      header += extra;
    }
    if (!fill(header + length)) return {};
    Frame f{static_cast<int>(byte(0) & 0x0f), buffer_.substr(header, length)};
    buffer_.erase(0, header + length);
    if (f.opcode != 9) return f;
    frame(10, f.payload);
  }
}

int SocketClient::awaitClose() {
  while (auto f = receive())
    if (f->opcode == 8) {
      frame(8, f->payload);
      return f->closeCode();
    }
  return 0;
}

std::string ask(std::uint16_t port, std::string_view line, std::string_view body, std::string_view headers) {
  std::string request = std::string(line) + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" + std::string(headers);
  if (!body.empty()) request += "Content-Type: application/json\r\nContent-Length: " + std::to_string(body.size()) + "\r\n";
  try {
    SocketClient client(port);
    client.send(request + "\r\n" + std::string(body));
    return client.answer();
  } catch (const std::exception&) {
    return "";
  }
}

}  // namespace ridgecast::testing_support
