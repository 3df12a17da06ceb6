#pragma once
// A member's edits over HTTP, by the product's route. No connection of it can be lost, but the server can fall: then it asks again, with
// the same key.

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/edits/operation.h"
#include "server/http/routes.h"
#include "tests/simulation/cluster.h"
#include "tests/simulation/truth.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::simulation {

class Poster {
 public:
  // All must outlive it.
  Poster(std::string client, std::string session, Cluster& cluster, Truth& truth, testing_support::SimulatedTimer& timer, Random& random)
      : client_(std::move(client)), session_(std::move(session)), cluster_(cluster), truth_(truth), timer_(timer), random_(random) {}

  void post(edits::Operation operation);  // or once more what has no answer
  void fall(const Server& of);            // will: whatever it was asked has no answer
  bool waits() const;
  void judgeWait() const;  // the server's answers come

 private:
  struct Request {
    Truth::Asked asked;
    std::uint64_t sent = 0;
    std::shared_ptr<const http::DeferredResponse> work{};  // while it waits
    Time since{};
    Server* at = nullptr;
  };
  void send(const std::shared_ptr<Request>& request);
  void turn(const std::shared_ptr<Request>& request);
  void take(const http::Answer& answer, const std::shared_ptr<Request>& request);
  std::string nameOf(const Request& request) const { return request.asked.key.empty() ? "" : client_ + '\n' + request.asked.key; }

  const std::string client_, session_;
  Cluster& cluster_;
  Truth& truth_;
  testing_support::SimulatedTimer& timer_;
  Random& random_;
  std::vector<std::shared_ptr<Request>> open_;  // without an answer, or asked for once more
  std::uint64_t keys_ = 0;
};

}  // namespace ridgecast::simulation
