#pragma once
// An HTTP and WebSocket client on bare sockets for the tests: it shares no code with the server and can misbehave.

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace ridgecast::testing_support {

class SocketClient {
 public:
  // From this address of the loopback network: another one is another client.
  explicit SocketClient(std::uint16_t port, const char* from = "127.0.0.1");
  ~SocketClient();
  SocketClient(const SocketClient&) = delete;
  SocketClient& operator=(const SocketClient&) = delete;

  bool send(std::string_view bytes);  // false: the server has closed
  // An HTTP answer: header and body (by Content-Length). Empty: none came whole, for a server may fall in the midst of one.
  std::string answer(bool hasBody = true);
  bool closed();  // waits until the server closes; false: it does not

  // `headers`: further lines, each with its \r\n. False: another answer than the upgrade, kept in refusal().
  bool upgrade(std::string_view target = "/v1/stream?session=default", std::string_view headers = "");
  const std::string& refusal() const { return refusal_; }
  // One masked frame. `announced` replaces the length in its header.
  bool frame(int opcode, std::string_view payload, bool final = true, std::optional<std::uint64_t> announced = {});
  bool message(std::string_view payload) { return frame(2, payload); }

  struct Frame {
    int opcode = 0;
    std::string payload;
    int closeCode() const {
      return opcode == 8 && payload.size() >= 2 ? (static_cast<unsigned char>(payload[0]) << 8) + static_cast<unsigned char>(payload[1])
                                                : 0;
    }
  };
  std::optional<Frame> receive();  // pings are answered and passed over; nothing: the connection ended, or nothing came for long
  int awaitClose();                // the code of the close frame, after whatever else; 0: the connection ended without one

 private:
  bool fill(std::size_t bytes);  // until so many are there
  int socket_ = -1;
  std::string buffer_, refusal_;
};

// The answer to one request, `line` being "GET /path", on a connection of its own; a body is JSON. `headers`: further lines, each with its
// \r\n. Empty: nobody listens, or the server fell before it was whole.
std::string ask(std::uint16_t port, std::string_view line, std::string_view body = "", std::string_view headers = "");

}  // namespace ridgecast::testing_support
