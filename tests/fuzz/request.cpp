// HTTP requests, a line for each part (method, target, host, origin, authorization, subprotocols, X-Forwarded-For, Content-Type) and then a
// body, through filter and routes; and the target as a URL and as a snapshot's question. Every refusal has a sentence.
#include <array>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <string_view>

#include "client/core/conversation/url.h"
#include "server/access/network.h"
#include "server/directory/directory.h"
#include "server/http/queries.h"
#include "server/http/request_filter.h"
#include "server/http/routes.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"
#include "server/snapshot/question.h"

namespace {

using namespace ridgecast;

void require(bool ok) {
  if (!ok) std::abort();
}

struct Server {
  Server() : executor(1), resources(std::make_shared<session::Resources>()) {
    resources->executor = &executor;
    resources->makeMesh = session::pipelineMeshes();
    directory = std::make_shared<directory::Directory>(resources, terrain::create("alpine", 1).value());
    routes.push_back(http::queryRoute(directory));
  }
  scheduling::Executor executor;
  std::shared_ptr<session::Resources> resources;
  std::shared_ptr<directory::Directory> directory;
  std::vector<http::Route> routes;
  const http::RequestFilter filter{http::Access{}};
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static Server server;
  std::array<std::string_view, 8> lines;
  std::string_view rest(reinterpret_cast<const char*>(data), size);
  for (std::string_view& line : lines) {
    line = rest.substr(0, rest.find('\n'));
    rest.remove_prefix(std::min(line.size() + 1, rest.size()));
  }
  http::Request request;
  request.method = lines[0];
  request.target = lines[1];
  request.host = lines[2];
  request.origin = lines[3];
  request.authorization = lines[4];
  request.subprotocols = lines[5];
  request.contentType = lines[7];
  const auto judged = server.filter.judge(request);
  if (const auto* refused = std::get_if<http::Answer>(&judged)) require(refused->status >= 400 && !refused->body.empty());
  http::Reply reply = http::answer(request, *server.directory, "1", server.routes);
  if (const auto* body = std::get_if<http::BodyHandler>(&reply)) reply = http::Reply(body->answer(std::string(rest)));
  if (const auto* later = std::get_if<http::DeferredResponse>(&reply)) later->work({});
  if (const auto* answer = std::get_if<http::Answer>(&reply); answer && answer->status >= 400) require(!answer->body.empty());
  if (const auto url = core::parseUrl(lines[1]); !url) require(!url.error().message.empty());
  for (const auto format : {snapshot::Format::kGlb, snapshot::Format::kTiff, snapshot::Format::kTiles, snapshot::Format::kArchive}) {
    const auto question = snapshot::parse(request.query(), {}, nullptr, format);
    require(question ? !snapshot::canonical(*question).empty() : !question.error().message.empty());
  }
  access::clientAddress({}, lines[6], {access::Network::parse("::/0").value()});
  return 0;
}
