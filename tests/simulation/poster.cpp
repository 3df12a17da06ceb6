#include "tests/simulation/poster.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <utility>

#include "common/edits/json.h"
#include "server/http/edits.h"
#include "tests/simulation/world.h"

namespace ridgecast::simulation {

using namespace std::chrono_literals;

void Poster::post(edits::Operation operation) {
  if (!cluster_.next().runs()) return;
  std::shared_ptr<Request> request;
  if (!open_.empty() && random_() % 2 == 0) request = open_[random_() % open_.size()];
  if (!request || request->asked.key.empty()) {
    const bool hasKey = random_() % 4 != 0;
    request = std::make_shared<Request>(Request{{hasKey ? "post " + std::to_string(++keys_) : "", std::move(operation)}});
    open_.push_back(request);
  }
  send(request);
}

void Poster::send(const std::shared_ptr<Request>& request) {
  if (request->work) return;
  const std::string target = "/v1/sessions/" + session_ + "/edits";
  http::Request asked;
  asked.method = "POST";
  asked.target = target;
  asked.contentType = "application/json";
  asked.idempotencyKey = request->asked.key;
  asked.client = client_;
  Server& server = cluster_.next();
  if (!server.runs()) return;
  const auto reply = http::editsRoute(server.directory())(asked);
  ASSERT_TRUE(reply);
  if (const auto* answer = std::get_if<http::Answer>(&*reply)) {  // the session does not live, or has not lived since the server fell
    EXPECT_TRUE(answer->status == 404 || answer->status == 503) << answer->body;
    return;
  }
  if (std::holds_alternative<http::DeferredResponse>(*reply)) return;  // it does not know yet what other servers have made
  http::Reply made = std::get<http::BodyHandler>(*reply).answer(edits::toJson(request->asked.operation));
  auto* later = std::get_if<http::DeferredResponse>(&made);
  ASSERT_TRUE(later) << std::get<http::Answer>(made).body;
  ++request->sent;
  request->work = std::make_shared<http::DeferredResponse>(std::move(*later));
  request->since = timer_.now();
  request->at = &server;
  server.openEdits(session_).open(nameOf(*request));
  turn(request);
}

void Poster::turn(const std::shared_ptr<Request>& request) {
  const auto isSaid = [this, weak = std::weak_ptr(request), sent = request->sent] {
    auto one = weak.lock();
    if (!one || !one->work || one->sent != sent) return std::shared_ptr<Request>();  // the server fell
    one->at->openEdits(session_).close(nameOf(*one));
    return one;
  };
  const auto waits = std::make_shared<bool>(false);  // the first turn was not enough
  const http::Reply reply = request->work->work({{}, [this, isSaid, waits] {
                                                   if (const auto one = *waits ? isSaid() : nullptr)
                                                     timer_.at(timer_.now(), [this, weak = std::weak_ptr(one), sent = one->sent] {
                                                       const auto it = weak.lock();
                                                       if (it && it->work && it->sent == sent)
                                                         take(std::get<http::Answer>(it->work->work({})), it);
                                                     });
                                                 }});
  if (const auto* answer = std::get_if<http::Answer>(&reply)) return take(*answer, isSaid());
  *waits = true;
}

void Poster::take(const http::Answer& answer, const std::shared_ptr<Request>& request) {
  request->work.reset();
  const auto forget = [&] { std::erase(open_, request); };
  if (answer.status == 201) {
    ++met.posted;
    truth_.acknowledged(std::stoull(answer.body.substr(answer.body.find(':') + 1)), client_, request->asked);
    if (request->asked.key.empty() || random_() % 2 == 0) forget();
    return;
  }
  static constexpr std::pair<unsigned, const char*> kReasons[] = {{429, "Too many or too large edits"},
                                                                  {429, "edits of this session wait"},
                                                                  {429, "of your edits wait"},
                                                                  {422, "There is no edit"},
                                                                  {422, "is undone already"},
                                                                  {422, "is that of another edit"},
                                                                  {507, "no room on the disk"},
                                                                  {507, "ran out of memory"},
                                                                  {404, "has ended"},
                                                                  // Of several servers:
                                                                  {429, "cannot be reached"},
                                                                  {429, "wait for the first one"},
                                                                  {429, "no room"},
                                                                  {507, "no room for edits"}};
  EXPECT_TRUE(std::ranges::any_of(
      kReasons, [&](const auto& r) { return answer.status == r.first && answer.body.find(r.second) != std::string::npos; }))
      << answer.status << ": " << answer.body;
  if (answer.body.find("before it was known") != answer.body.npos) return;  // it asks again, if it has a key
  if (request->sent == 1) truth_.refused(client_, request->asked.key);
  forget();
}

void Poster::fall(const Server& of) {
  std::erase_if(open_, [&](const auto& request) { return request->asked.key.empty() && (request->at == &of || !request->at); });
  for (const auto& request : open_)
    if (request->at == &of) request->work.reset();
}

bool Poster::waits() const {
  return std::ranges::any_of(open_, [](const auto& request) { return request->work != nullptr; });
}

void Poster::judgeWait() const {
  for (const auto& request : open_)
    EXPECT_TRUE(!request->work || timer_.now() - std::max(request->since, cluster_.calmFrom()) < 4s) << client_ << " waits for its answer";
}

}  // namespace ridgecast::simulation
