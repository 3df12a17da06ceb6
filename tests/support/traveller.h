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

#include "client/connection/resuming.h"
#include "tests/support/flier.h"

namespace ridgecast::testing_support {

class Traveller {
 public:
  // Throws std::runtime_error when it cannot connect.
  Traveller(const std::string& url, const wire::Settings& settings) {
    wire::Hello hello;
    hello.clientName = "ridgecast tests";
    hello.settings = settings;
    auto opened = connection::Resuming::open(*connection::parseUrl(url), hello, [this](const wire::World& world) {
      if (world.contentHash != contentHash_) scene_.clear();
      scene_.reconnect();
      agrees_ = settled_ = false;
      auto held = scene_.held();
      resumed_ += held.size();
      return held;
    });
    if (!opened) throw std::runtime_error(opened.error().message);
    line_ = std::move(*opened);
    contentHash_ = line_->world().contentHash;
  }

  void send(const camera::Camera& camera) {
    line_->send({++sequence_, camera});
    settled_ = false;
    sent_.push_back({sequence_, std::chrono::steady_clock::now()});
  }
  // Takes what is there; false: something cannot be applied.
  bool take(std::chrono::milliseconds patience) {
    while (const auto received = line_->receive(patience)) {
      patience = std::chrono::milliseconds(0);
      const auto applied = scene_.apply(received->iteration);
      if (!applied) {
        failure_ = applied.error().message;
        return false;
      }
      agrees_ = scene_.hash() == received->iteration.meshHash;
      if (!agrees_) ++mismatches_;
      if (!sent_.empty() && sent_.front().first <= received->iteration.poseSequence) {
        while (sent_.size() > 1 && sent_[1].first <= received->iteration.poseSequence) sent_.pop_front();
        latencies_.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - sent_.front().second).count());
        sent_.pop_front();
      }
      settled_ = received->iteration.settled && received->iteration.poseSequence == sequence_;
      wholes_ += received->iteration.whole.size();
      line_->acknowledge({received->iteration.number, scene_.hash()});
    }
    return true;
  }

  connection::Resuming& line() { return *line_; }
  const scene::Scene& scene() const { return scene_; }
  bool agrees() const { return agrees_ && !line_->error(); }
  bool settled() const { return settled_; }
  const std::string& failure() const { return failure_; }
  std::size_t mismatches() const { return mismatches_; }
  std::size_t resumed() const { return resumed_; }
  std::size_t wholes() const { return wholes_; }
  std::size_t iterations() const { return latencies_.size(); }
  // Milliseconds from a pose to the first mesh for it or a later one.
  const std::vector<double>& latencies() const { return latencies_; }
  void forgetLatencies() { latencies_.clear(); }

 private:
  scene::Scene scene_;
  std::string failure_;
  std::unique_ptr<connection::Resuming> line_;
  std::uint64_t contentHash_ = 0, sequence_ = 0;
  bool agrees_ = false, settled_ = false;
  std::deque<std::pair<std::uint64_t, std::chrono::steady_clock::time_point>> sent_;
  std::vector<double> latencies_;
  std::size_t mismatches_ = 0, resumed_ = 0, wholes_ = 0;
};

}  // namespace ridgecast::testing_support
