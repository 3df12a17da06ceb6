#include "client/core/conversation/session_clock.h"

#include <algorithm>
#include <cmath>

#include "common/wire/wire.h"

namespace ridgecast::core {

namespace {

double microseconds(SessionClock::Instant::duration d) { return std::chrono::duration<double, std::micro>(d).count(); }
constexpr double kDrift = 100e-6;     // two machines' clocks, at worst
constexpr double kUnrequested = 1e6;  // how long a message without a request may have been on its way

}  // namespace

double SessionClock::spreadOf(const Sample& sample, Instant now) {
  return sample.spread + kDrift * std::max(0.0, microseconds(now - sample.at));
}

std::uint64_t SessionClock::time(Instant now) const {
  if (said_.mode == wire::ClockMode::kStepped || !best_) return said_.time;
  const double time = best_->time + microseconds(now - best_->at) * said_.rate;
  const double most = static_cast<double>(said_.end == 0 ? wire::kMaxTime : said_.end);  // where it stands
  return static_cast<std::uint64_t>(std::clamp(time, 0.0, most));
}

std::chrono::microseconds SessionClock::uncertainty(Instant now) const {
  if (said_.mode == wire::ClockMode::kStepped || !best_) return std::chrono::microseconds(0);
  return std::chrono::microseconds(static_cast<std::int64_t>(std::ceil(spreadOf(*best_, now) * std::max(1.0, said_.rate))));
}

bool SessionClock::waitsFor(std::uint64_t camera) const {
  return std::find(said_.waitsFor.begin(), said_.waitsFor.end(), camera) != said_.waitsFor.end();
}

wire::AskClock SessionClock::ask(Instant now) {
  askedAt_ = now;
  return {++asked_};
}

void SessionClock::hear(const wire::Clock& clock, Instant now) {
  const bool goesOn = version_ != 0 && clock.mode == said_.mode && clock.rate == said_.rate;
  said_ = clock;
  if (!clock.notice.empty()) notice_ = clock.notice;
  ++version_;
  if (clock.refuses) refused_ = version_;
  answered_ = std::max(answered_, clock.echo);
  if (!goesOn) best_.reset();
  Sample sample{now, static_cast<double>(clock.time), kUnrequested};
  if (clock.echo != 0 && clock.echo == asked_ && askedAt_) {
    const auto trip = now - *askedAt_;
    askedAt_.reset();
    sample.at = now - trip / 2;
    sample.spread = microseconds(trip) / 2;
    halfTrip_ = halfTrip_ == 0 ? sample.spread : std::min(halfTrip_, sample.spread);
  } else {
    sample.time += halfTrip_ * clock.rate;
  }
  // A clock that was set without another rate shows as a contradiction.
  const bool contradicts = best_ && std::abs(best_->time + microseconds(sample.at - best_->at) * clock.rate - sample.time) >
                                        (spreadOf(*best_, now) + sample.spread) * std::max(1.0, clock.rate) + 1;
  if (!best_ || contradicts || sample.spread <= spreadOf(*best_, now)) best_ = sample;
}

}  // namespace ridgecast::core
