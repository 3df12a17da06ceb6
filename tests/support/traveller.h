#pragma once
// A client without pictures that flies by the clock and comes back by itself when its line breaks.

#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "client/link/client.h"
#include "tests/support/flier.h"

namespace ridgecast::testing_support {

class Traveller {
 public:
  // Throws std::runtime_error when it cannot connect.
  Traveller(const std::string& url, const wire::Settings& settings) {
    wire::Hello hello;
    hello.clientName = "ridgecast tests";
    hello.settings = settings;
    client_ = link::Client::open(core::parseUrl(url).value(), hello).value();
  }

  void send(const camera::Camera& camera) { sent_.push_back({client_->send(camera), std::chrono::steady_clock::now()}); }
  // Takes what is there; false: something cannot be applied.
  bool take(std::chrono::milliseconds timeout) {
    while (const auto update = client_->receive(timeout)) {
      timeout = std::chrono::milliseconds(0);
      const wire::Iteration& iteration = update->iteration;
      if (update->wrong) {
        ++mismatches_;
        failure_ = update->wrong->message;
      }
      if (!sent_.empty() && sent_.front().first <= iteration.poseSequence) {
        while (sent_.size() > 1 && sent_[1].first <= iteration.poseSequence) sent_.pop_front();
        latencies_.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - sent_.front().second).count());
        sent_.pop_front();
      }
      agrees_ = !update->wrong;
      heardOf_ = line().reconnections();
      if (scene().iteration() == 0) return false;
    }
    return true;
  }

  const link::Connection& line() const { return client_->connection(); }
  const core::Scene& scene() const { return client_->scene(); }
  bool agrees() const { return agrees_ && heardOf_ == line().reconnections() && !line().error(); }
  const std::string& failure() const { return failure_; }
  std::size_t mismatches() const { return mismatches_; }
  std::size_t resumed() const { return client_->resumed(); }
  std::size_t iterations() const { return latencies_.size(); }
  // Milliseconds from a pose to the first mesh for it or a later one.
  const std::vector<double>& latencies() const { return latencies_; }
  void forgetLatencies() { latencies_.clear(); }

 private:
  std::unique_ptr<link::Client> client_;
  std::string failure_;
  std::uint64_t heardOf_ = 0;  // reconnections before the newest iteration
  bool agrees_ = false;
  std::deque<std::pair<std::uint64_t, std::chrono::steady_clock::time_point>> sent_;
  std::vector<double> latencies_;
  std::size_t mismatches_ = 0;
};

}  // namespace ridgecast::testing_support
