#pragma once
// A server on a loopback port that plays a script over one connection with plain sockets: it shares no code with the client's WebSocket.

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <thread>

namespace ridgecast::test {

class RawConnection {
 public:
  explicit RawConnection(int socket) : socket_(socket) {}
  void send(std::string_view bytes);
  // Until the peer's request head is there; its text.
  std::string readHead();
  // Reads the head and answers the upgrade.
  void upgrade();
  // One unmasked frame; opcode 2 is binary, 1 text, 8 close, 9 ping.
  void sendFrame(std::string_view payload, int opcode = 2);
  void sendClose(std::uint16_t code, std::string_view reason);
  // The next data frame of the client, unmasked; empty when it closed or hung up.
  std::string readFrame();
  // Waits until the peer hangs up.
  void drain();

 private:
  bool readExactly(char* to, std::size_t size);
  int socket_;
};

class RawServer {
 public:
  // Plays the script with so many connections, one after the other.
  explicit RawServer(std::function<void(RawConnection&)> script, int connections = 1);
  ~RawServer();  // waits for the script
  RawServer(const RawServer&) = delete;
  RawServer& operator=(const RawServer&) = delete;
  std::string port() const { return port_; }

 private:
  std::string port_;
  int listener_ = -1;  // behind port_, which opening it fills in
  std::thread thread_;
};

// A port on which nobody listens.
std::string closedPort();

}  // namespace ridgecast::test
