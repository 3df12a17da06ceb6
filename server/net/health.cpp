#include "server/net/health.h"

#include <boost/asio/ip/tcp.hpp>
#include <chrono>
#include <string>

namespace ridgecast::net {

std::optional<Error> checkHealth(const Settings& settings) {
  const bool admin = settings.adminPort != 0;
  if (!admin && !settings.tlsCertificate.empty())
    return Error{"This command requests plain HTTP, and the server has TLS: give the server a plain port with --admin-port."};
  std::string host = admin && !settings.adminHost.empty() ? settings.adminHost : settings.host;
  if (host == "0.0.0.0") host = "127.0.0.1";
  if (host == "::") host = "::1";
  const std::string port = std::to_string(admin ? settings.adminPort : settings.port);
  boost::asio::ip::tcp::iostream server;
  server.expires_after(std::chrono::seconds(2));
  server.connect(host, port);
  server << "GET /healthz HTTP/1.0\r\nHost: localhost\r\n\r\n" << std::flush;
  std::string status;
  std::getline(server, status);
  if (status.starts_with("HTTP/1.1 200")) return {};
  return Error{"No server answers at " + host + ", port " + port + (status.empty() ? "." : ", but '" + status.substr(0, 80) + "'.")};
}

}  // namespace ridgecast::net
