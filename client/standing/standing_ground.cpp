#include "client/standing/standing_ground.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "common/outcome/contract.h"

namespace ridgecast::standing {

using namespace std::chrono_literals;

namespace {

constexpr std::size_t kSide = kCells + 1;
constexpr std::int64_t kFiner = 4;  // samples along a square's side that judge it
constexpr auto kPause = 100ms;      // after heights failed

std::int64_t floorDivide(std::int64_t a, std::int64_t b) { return a / b - (a % b < 0 ? 1 : 0); }

// How far the samples over a tile, kFiner a square's side, are from its squares split along either diagonal; and half of how much that
// differs between neighbours, for what lies between.
float deviation(const std::vector<float>& heights, const std::vector<float>& samples) {
  constexpr std::size_t kRow = kCells * kFiner + 1;
  std::vector<float> below(kRow), row(kRow);
  float most = 0, step = 0;
  for (std::size_t b = 0; b < kRow; ++b) {
    const std::size_t j = std::min<std::size_t>(b / kFiner, kCells - 1);
    const float v = static_cast<float>(b - j * kFiner) / kFiner;
    for (std::size_t a = 0; a < kRow; ++a) {
      const std::size_t i = std::min<std::size_t>(a / kFiner, kCells - 1);
      const float u = static_cast<float>(a - i * kFiner) / kFiner;
      const float* h = &heights[j * kSide + i];
      const float h00 = h[0], h10 = h[1], h01 = h[kSide], h11 = h[kSide + 1];
      const float rising = u >= v ? h00 + u * (h10 - h00) + v * (h11 - h10) : h00 + v * (h01 - h00) + u * (h11 - h01);
      const float falling = u + v <= 1 ? h00 + u * (h10 - h00) + v * (h01 - h00) : h11 + (1 - u) * (h01 - h11) + (1 - v) * (h10 - h11);
      const float sample = samples[b * kRow + a];
      row[a] = std::max(std::abs(sample - rising), std::abs(sample - falling));
      most = std::max(most, row[a]);
      if (a > 0) step = std::max(step, std::abs(row[a] - row[a - 1]));
      if (b > 0) step = std::max(step, std::abs(row[a] - below[a]));
    }
    std::swap(below, row);
  }
  return most + step / 2;
}

}  // namespace

Source sourceOf(query::Ground ground) {
  const auto shared = std::make_shared<const query::Ground>(std::move(ground));
  return {[shared](auto x, auto z, auto out) -> Outcome<std::uint64_t> {
            std::uint64_t edit = 0;
            if (auto known = shared->heights(x, z, out, &edit); !known) return known.error();
            return edit;
          },
          [shared](std::uint64_t edit) { return shared->since(edit); },
          [shared](std::chrono::milliseconds timeout) { static_cast<void>(shared->hear(timeout)); }};
}

Outcome<std::unique_ptr<StandingGround>> StandingGround::open(Source source, const Options& options) {
  if (options.spacing < kFiner || options.spacing > 1 << 20 || options.spacing % kFiner != 0)
    return Error{"heights are 1/64 to 4096 metres apart, in steps of 1/64 m"};
  if (options.radius < 0 || options.radius > 64 * kCells * options.spacing)
    return Error{"the radius of ground around a body is at most 2048 times the heights' spacing"};
  return std::unique_ptr<StandingGround>(new StandingGround(std::move(source), options));
}

StandingGround::StandingGround(Source source, const Options& options)
    : source_(std::move(source)),
      options_(options),
      most_(std::max<std::size_t>(1, options.memory / (sizeof(Tile) + kSide * kSide * sizeof(float)))),
      thread_([this] { run(); }) {}

StandingGround::~StandingGround() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  work_.notify_one();
  thread_.join();
}

StandingGround::Window StandingGround::around(lattice::Point body, lattice::Step radius) const {
  const lattice::Step side = kCells * options_.spacing;
  return {floorDivide(body.x - radius, side), floorDivide(body.z - radius, side), floorDivide(body.x + radius, side),
          floorDivide(body.z + radius, side)};
}

Outcome<void> StandingGround::move(std::span<const lattice::Point> bodies) {
  if (bodies.size() > kMaxBodies) return Error{"there is ground for at most " + std::to_string(kMaxBodies) + " bodies"};
  // A tile and a quarter on: what is made ahead, and what is kept behind.
  const lattice::Step ahead = kCells * options_.spacing / 4, kept = 2 * ahead;
  const lattice::Step end = lattice::kMaxPosition - options_.radius - kept - kCells * options_.spacing;
  for (std::size_t k = 0; k < bodies.size(); ++k)
    if (std::min(bodies[k].x, bodies[k].z) < -end || std::max(bodies[k].x, bodies[k].z) > end)
      return Error{"body " + std::to_string(k) + " is beyond the lattice, or too near its end, 4.398e12 m from the origin"};
  const auto each = static_cast<std::size_t>((2 * (options_.radius + ahead)) / (kCells * options_.spacing)) + 2;
  if (bodies.size() * each * each > kMaxPlaces)
    return Error{"there is too much ground around " + std::to_string(bodies.size()) +
                 " bodies: a wider spacing, or a smaller radius, fits"};
  hear();
  const std::lock_guard lock(mutex_);
  for (std::size_t k = bodies.size(); k < windows_.size(); ++k) remove(windows_[k]);
  windows_.resize(bodies.size());
  bodies_.assign(bodies.begin(), bodies.end());
  for (std::size_t k = 0; k < bodies.size(); ++k) {
    const Window window = windows_[k];
    if (window.holds(around(bodies[k], options_.radius)) && around(bodies[k], options_.radius + kept).holds(window)) continue;
    const Window wanted = around(bodies[k], options_.radius + ahead);
    add(wanted, bodies[k]);
    windows_[k] = wanted;
    remove(window);
  }
  work_.notify_one();
  return {};
}

void StandingGround::ready(std::span<std::uint8_t> out) const {
  expects(out.size() == bodies_.size(), "each body has its answer");
  const std::lock_guard lock(mutex_);
  const bool areAll = wanted_.empty() && stale_.empty();
  for (std::size_t k = 0; k < out.size(); ++k) out[k] = areAll || isReady(around(bodies_[k], options_.radius));
}

bool StandingGround::isReady(const Window& window) const {
  for (std::int64_t i = window.i0; i <= window.i1; ++i)
    for (std::int64_t j = window.j0; j <= window.j1; ++j) {
      const Place& place = places_.at({i, j});
      if (!place.tile || stale_.contains({place.distance, {i, j}})) return false;
    }
  return true;
}

void StandingGround::add(const Window& window, lattice::Point body) {
  const double side = static_cast<double>(kCells * options_.spacing);
  for (std::int64_t i = window.i0; i <= window.i1; ++i)
    for (std::int64_t j = window.j0; j <= window.j1; ++j) {
      Place& place = places_[{i, j}];
      if (place.bodies++ > 0) continue;
      const double x = (static_cast<double>(i) + 0.5) * side - static_cast<double>(body.x);
      const double z = (static_cast<double>(j) + 0.5) * side - static_cast<double>(body.z);
      place.distance = std::hypot(x, z);
      wanted_.insert({place.distance, {i, j}});
    }
}

void StandingGround::remove(const Window& window) {
  for (std::int64_t i = window.i0; i <= window.i1; ++i)
    for (std::int64_t j = window.j0; j <= window.j1; ++j) {
      const auto at = places_.find({i, j});
      expects(at != places_.end() && at->second.bodies > 0, "a window that goes was added before");
      if (--at->second.bodies > 0) continue;
      wanted_.erase({at->second.distance, at->first});
      stale_.erase({at->second.distance, at->first});
      if (at->second.tile) {
        if (at->second.told)
          gone_.push_back(at->second.tile);
        else
          came_.erase(at->first);
        expects(made_ > 0, "a tile that goes was counted");
        --made_;
      }
      places_.erase(at);
      failed_.reset();
    }
}

std::uint64_t StandingGround::hear() {
  const std::lock_guard lock(mutex_);
  const query::News news = source_.since(heard_);
  if (std::exchange(heard_, news.heard) > news.heard)  // a recording has gone back
    for (const auto& [key, place] : places_)
      if (place.tile) stale_.insert({place.distance, key});
  const lattice::Step side = kCells * options_.spacing;
  for (const query::Change& change : news.changes) {
    const lattice::Area& a = change.area;
    const Window window{floorDivide(a.x0 - 1, side), floorDivide(a.z0 - 1, side), floorDivide(a.x1, side), floorDivide(a.z1, side)};
    if (window.count() > static_cast<double>(places_.size())) {
      for (const auto& [key, place] : places_) age(key, change);
    } else {
      for (std::int64_t i = window.i0; i <= window.i1; ++i)
        for (std::int64_t j = window.j0; j <= window.j1; ++j) age({i, j}, change);
    }
  }
  if (!stale_.empty()) work_.notify_one();
  return news.awaited > news.heard ? news.awaited : 0;
}

bool StandingGround::age(Key key, const query::Change& change) {
  const auto at = places_.find(key);
  const Tile* const tile = at == places_.end() ? nullptr : at->second.tile.get();
  if (!tile || tile->edit >= change.edit || change.area == lattice::Area() || !tile->area().meets(change.area)) return false;
  stale_.insert({at->second.distance, key});
  return true;
}

Changes StandingGround::changes() {
  hear();
  const std::lock_guard lock(mutex_);
  Changes changes{std::exchange(gone_, {}), {}};
  for (const Key& key : came_) {
    Place& place = places_.at(key);
    expects(place.tile && !place.told, "a tile that came is there, and was not told of");
    place.told = true;
    changes.came.push_back(place.tile);
  }
  came_.clear();
  return changes;
}

bool StandingGround::full() const {
  const std::lock_guard lock(mutex_);
  return made_ >= most_ && !wanted_.empty();
}

std::size_t StandingGround::bytes() const {
  const std::lock_guard lock(mutex_);
  return made_ * (sizeof(Tile) + kSide * kSide * sizeof(float));
}

Outcome<void> StandingGround::wait(std::chrono::milliseconds timeout) {
  const auto until = std::chrono::steady_clock::now() + timeout;
  if (hear() > 0) source_.hear(timeout);
  if (const std::uint64_t awaited = hear()) return Error{"edit " + std::to_string(awaited) + " was not heard of in time"};
  std::unique_lock lock(mutex_);
  done_.wait_until(lock, until, [&] { return isDone(); });
  if (wanted_.empty() && stale_.empty()) return {};
  if (isDone()) return Error{"the ground around the bodies takes more memory than it may: a wider spacing, or a smaller radius, fits"};
  return failed_ ? *failed_ : Error{"the ground around the bodies was not made in time"};
}

void StandingGround::run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    work_.wait(lock, [&] { return ends_ || next(); });
    if (ends_) return;
    const Key key = next()->begin()->second;
    const std::uint64_t before = heard_;
    lock.unlock();
    const auto made = make(key);
    lock.lock();
    failed_.reset();
    if (made && heard_ < before) continue;  // of edits that are void
    if (made) {
      keep(key, *made);
      for (const query::Change& change : source_.since((*made)->edit).changes)
        if (age(key, change) && change.edit <= before) failed_ = Error{"the server does not know an edit that it has told of"};
    } else {
      failed_ = made.error();
    }
    if (isDone()) done_.notify_all();
    if (failed_) work_.wait_for(lock, kPause, [&] { return ends_; });
  }
}

const StandingGround::Queue* StandingGround::next() const {
  const bool hasRoom = !wanted_.empty() && made_ < most_;
  if (!hasRoom) return stale_.empty() ? nullptr : &stale_;
  return stale_.empty() || *wanted_.begin() < *stale_.begin() ? &wanted_ : &stale_;
}

void StandingGround::keep(Key key, std::shared_ptr<const Tile> tile) {
  expects(tile != nullptr, "a tile that is kept was made");
  const auto at = places_.find(key);
  if (at == places_.end()) return;  // not wanted any more
  Place& place = at->second;
  wanted_.erase({place.distance, key});
  stale_.erase({place.distance, key});
  if (!place.tile) ++made_;
  if (place.told) gone_.push_back(std::move(place.tile));
  place.tile = std::move(tile);
  place.told = false;
  came_.insert(key);
}

Outcome<std::shared_ptr<const Tile>> StandingGround::make(Key key) {
  Tile tile{.i = key.first, .j = key.second, .spacing = options_.spacing, .version = ++version_, .edit = 0};
  constexpr std::int64_t side = kCells * kFiner + 1;
  const lattice::Step apart = options_.spacing / kFiner;
  std::vector<lattice::Step> x, z;
  for (std::int64_t b = 0; b < side; ++b)
    for (std::int64_t a = 0; a < side; ++a) {
      x.push_back(tile.x() + a * apart);
      z.push_back(tile.z() + b * apart);
    }
  std::vector<float> samples(x.size());
  const auto known = source_.heights(x, z, samples);
  if (!known) return known.error();
  tile.edit = *known;
  tile.heights.reserve(kSide * kSide);
  for (std::int64_t b = 0; b < side; b += kFiner)
    for (std::int64_t a = 0; a < side; a += kFiner) tile.heights.push_back(samples[static_cast<std::size_t>(b * side + a)]);
  const auto [low, high] = std::ranges::minmax(tile.heights);
  tile.lowest = low;
  tile.highest = high;
  tile.error = deviation(tile.heights, samples);
  return std::make_shared<const Tile>(std::move(tile));
}

}  // namespace ridgecast::standing
