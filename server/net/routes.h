#pragma once
// What the server answers over HTTP: pure functions from a request to an answer, without sockets.
//
//   GET /                           what this is and how to connect, as a page
//   GET /healthz                    "ok"
//   GET /version                    {"name": ..., "version": ..., "protocol": ...}
//   GET /v1/stream?session=NAME     upgrades to a WebSocket
// HEAD is answered where GET is. Everything else is refused in one plain sentence.

#include <string>
#include <string_view>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/session/session.h"

namespace ridgecast::net {

struct Request {
  std::string_view method;
  std::string_view target;  // path and query
  std::string_view host;    // the Host header; untrusted
  bool upgrade = false;     // asks for a WebSocket
  std::string_view webSocketVersion;
};

struct Answer {
  unsigned status = 200;
  std::string type = "text/plain; charset=utf-8";
  std::string body;
  std::vector<std::pair<std::string, std::string>> headers;
  std::shared_ptr<session::Session> upgradeTo;  // set: answer with the upgrade instead
};

Answer answer(const Request& request, const session::Directory& directory, std::string_view version);

// The value of a query's parameter, percent-decoded; empty when it is absent. Error: an escape that is none.
Outcome<std::string> queryParameter(std::string_view query, std::string_view name);

}  // namespace ridgecast::net
