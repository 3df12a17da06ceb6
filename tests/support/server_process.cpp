#include "tests/support/server_process.h"

#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <stdexcept>
#include <thread>

#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast::testing_support {

using namespace std::chrono_literals;

namespace {

std::vector<std::string> commandLine(const std::string& program, const std::string& portFile, std::uint16_t port,
                                     const std::vector<std::string>& arguments) {
  std::vector<std::string> command{program};
  command.insert(command.end(), arguments.begin(), arguments.end());
  command.insert(command.end(), {"--port", std::to_string(port), "--port-file", portFile});
  if (std::find(arguments.begin(), arguments.end(), "--log-level") == arguments.end()) command.push_back("--quiet");
  return command;
}

}  // namespace

std::uint16_t freePort() {
  const int socket = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  const bool bound = bind(socket, reinterpret_cast<sockaddr*>(&address), size) == 0 &&
                     getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size) == 0;
  close(socket);
  if (!bound) throw std::runtime_error("loopback has no free port");
  return ntohs(address.sin_port);
}

ServerProcess::ServerProcess(const std::string& program, const std::vector<std::string>& arguments, std::uint16_t port,
                             const Environment& environment)
    : process_(commandLine(program, (folder_ / "port").string(), port, arguments), environment) {
  const auto until = std::chrono::steady_clock::now() + kTimeout;
  std::string text;
  while ((text = readText(folder_ / "port")).empty()) {
    if (!process_.running() || std::chrono::steady_clock::now() > until)
      throw std::runtime_error("the server did not start: " + process_.output());
    std::this_thread::sleep_for(10ms);
  }
  port_ = static_cast<std::uint16_t>(std::stoul(text));
}

bool ServerProcess::healthy() {
  if (!process_.running()) return false;
  SocketClient client(port_);
  client.send("GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  const std::string answer = client.answer();
  return answer.starts_with("HTTP/1.1 200 ") && answer.ends_with("\r\n\r\nok\n");
}

std::optional<int> ServerProcess::stop() {
  process_.signal(SIGTERM);
  return process_.wait(kTimeout);
}

}  // namespace ridgecast::testing_support
