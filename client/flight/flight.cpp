#include "client/flight/flight.h"

#include <algorithm>
#include <cmath>

#include "common/outcome/contract.h"

namespace ridgecast::flight {

using namespace std::chrono_literals;

namespace {

constexpr auto kTimeout = 120s;       // for one iteration in lock-step
constexpr auto kPoseInterval = 33ms;  // by the clock: poses a second at most 30
constexpr std::size_t kMaxSent = 4096;

double secondsSince(std::chrono::steady_clock::time_point began) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
}

}  // namespace

Flight::Flight(const Options& options, camera::Path path, link::Client& client, Ground ground, Observer& observer)
    : options_(options),
      path_(std::move(path)),
      client_(client),
      ground_(std::move(ground)),
      observer_(observer),
      duration_(std::min(path_.duration(), options.seconds.value_or(path_.duration()))) {}

Outcome<void> Flight::place(double t) {
  std::optional<Error> wrong;
  const auto ground = [&](lattice::Point p) {
    const auto height = ground_(p);
    if (!height && !wrong) wrong = height.error();
    return height ? *height : 0;
  };
  t_ = t;
  camera_.pose = camera::poseAt(path_, t, ground);
  camera_.projection = {path_.verticalFov, options_.width, options_.height};
  ground({camera_.pose.x, camera_.pose.z});  // also where the path needs none: what is drawn does
  if (wrong) return *wrong;
  return {};
}

Outcome<void> Flight::send(double t) {
  if (auto placed = place(t); !placed) return placed;
  sequence_ = client_.send(camera_);
  sent_[sequence_] = {Clock::now(), t};
  if (sent_.size() > kMaxSent) sent_.erase(sent_.begin());
  return {};
}

Outcome<void> Flight::take(const link::Update& update) {
  const std::uint64_t pose = update.iteration.poseSequence;
  expects(sent_.size() <= kMaxSent, "poses without an answer are forgotten in time");
  settled_ = update.iteration.settled && !update.wrong ? pose : 0;
  double t = 0, latencyMs = 0;
  if (const auto sent = sent_.find(pose); sent != sent_.end()) {
    latencyMs = secondsSince(sent->second.first) * 1e3 - update.milliseconds;
    t = sent->second.second;
    sent_.erase(sent_.begin(), sent);
  }
  return observer_.iterated(update, t, latencyMs);
}

// In lock-step.
Outcome<void> Flight::step(double t) {
  expects(!options_.realtime, "steps are for lock-step");
  const auto began = Clock::now();
  if (auto sent = send(t); !sent) return sent;
  const auto update = client_.await(sequence_, kTimeout);
  if (!update) return update.error();
  seconds_ += secondsSince(began);
  return take(*update);
}

// By the clock: takes what comes.
Outcome<void> Flight::receiveFor(std::chrono::milliseconds time) {
  const auto began = Clock::now();
  double observed = 0;
  do {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(began + time - Clock::now());
    const auto update = client_.receive(std::max(left, 0ms));
    if (!update) continue;
    const auto taking = Clock::now();
    if (auto taken = take(*update); !taken) return taken;
    observed += secondsSince(taking);
  } while (Clock::now() < began + time);
  seconds_ += secondsSince(began) - observed;
  return {};
}

Outcome<void> Flight::fly() {
  const auto steps = static_cast<std::uint64_t>(std::floor(duration_ * options_.rate + 1e-9));
  for (std::uint64_t k = 0; options_.realtime ? seconds_ < duration_ : k <= steps; ++k) {
    auto flown = options_.realtime ? send(seconds_) : step(static_cast<double>(k) / options_.rate);
    if (flown && options_.realtime) flown = receiveFor(kPoseInterval);
    if (!flown) return flown;
    if (auto observed = observer_.reached(); !observed) return observed;
  }
  return {};
}

Outcome<bool> Flight::settle() {
  const auto began = Clock::now();
  if (options_.realtime)
    if (auto sent = send(duration_); !sent) return sent.error();
  const auto rests = [&] { return sequence_ != 0 && settled_ == sequence_; };
  while (!rests() && secondsSince(began) < options_.settleLimit && !client_.connection().otherWorld())
    if (auto flown = options_.realtime ? receiveFor(50ms) : step(t_); !flown) return flown.error();
  if (const auto lost = client_.connection().error()) return *lost;
  return rests();
}

}  // namespace ridgecast::flight
