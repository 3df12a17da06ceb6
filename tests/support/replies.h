#pragma once
// Routes' replies, without a connection that follows them.

#include <future>
#include <memory>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>

#include "server/http/routes.h"

namespace ridgecast::testing_support {

// The work's reply, after as many turns as it takes.
inline http::Reply replyOf(const http::DeferredResponse& later, const std::stop_token& stop = {}, int* turns = nullptr) {
  for (;;) {
    const auto woken = std::make_shared<std::promise<void>>();
    http::Reply reply =
        later.work({stop, [woken, once = std::make_shared<std::once_flag>()] { std::call_once(*once, [&] { woken->set_value(); }); }});
    if (turns) ++*turns;
    const auto* retry = std::get_if<http::RetryAt>(&reply);
    if (!retry) return reply;
    if (retry->time == http::RetryAt::kWhenWoken)
      woken->get_future().wait();
    else
      std::this_thread::sleep_until(retry->time);
  }
}

// A reply, and the answer that it is: of work, that to a client which has its etag.
struct Replied : http::Answer {
  Replied(http::Reply reply) {  // NOLINT(google-explicit-constructor): what routes return
    if (auto* answer = std::get_if<http::Answer>(&reply)) static_cast<http::Answer&>(*this) = std::move(*answer);
    if (auto* upgrade = std::get_if<http::Upgrade>(&reply)) status = 101, upgradeTo = std::move(upgrade->session);
    if (auto* handler = std::get_if<http::BodyHandler>(&reply)) ofBody = std::make_shared<http::BodyHandler>(std::move(*handler));
    auto* work = std::get_if<http::DeferredResponse>(&reply);
    if (!work) return;
    static_cast<http::Answer&>(*this) = work->unchanged;
    later = std::make_shared<http::DeferredResponse>(std::move(*work));
  }
  // By its body and its work, if it takes any.
  Replied made(const std::stop_token& stop = {}, std::string sent = {}, int* turns = nullptr) const {
    if (ofBody) return Replied(ofBody->answer(std::move(sent))).made(stop, {}, turns);
    return later ? Replied(replyOf(*later, stop, turns)).made(stop, std::move(sent), turns) : *this;
  }

  std::shared_ptr<session::Session> upgradeTo;
  std::shared_ptr<const http::DeferredResponse> later;
  std::shared_ptr<const http::BodyHandler> ofBody;
};

}  // namespace ridgecast::testing_support
