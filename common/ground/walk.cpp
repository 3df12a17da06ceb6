#include "common/ground/walk.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/ground/direction.h"

namespace ridgecast::ground {

using lattice::Step;

namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();
constexpr std::int64_t kIn = kCells - 1;
constexpr double kShortest = 1.0 / 64;  // metres that a ray advances at least from stretch to stretch

// The finest cells looked at so far along a ray: those nearby are asked again and again, those far away would be too many. Tuned for a
// lidar of 64 beams on alpine and canyon.
int finestAt(double t) { return t < 32 ? 0 : t < 200 ? 1 : 2; }

}  // namespace

Walk::Walk(const Ray& ray, const Reader& reader) : x_(ray.x), z_(ray.z), y_(ray.y) {
  const Direction towards = directionOf(ray);
  dx_ = towards.x * lattice::kStepsPerMetre, dy_ = towards.y, dz_ = towards.z * lattice::kStepsPerMetre;
  perX_ = dx_ == 0 ? kNever : 1 / dx_, perZ_ = dz_ == 0 ? kNever : 1 / dz_;
  if (!lattice::positionIsValid(ray.x, ray.z)) return;
  end_ = ray.reach;
  const auto within = [&](Step from, double per) {
    if (per == kNever) return;
    const Step room = per > 0 ? lattice::kMaxPosition - from : -lattice::kMaxPosition - from;
    end_ = std::min(end_, static_cast<double>(room) * per);
  };
  within(x_, perX_), within(z_, perZ_);
  // What lies above all ground.
  const double over = y_ - reader.highest();
  if (over > 0) {
    if (dy_ >= 0)
      end_ = -1;
    else
      t_ = over / -dy_;
  } else if (dy_ > 0) {
    end_ = std::min(end_, -over / dy_);
  }
  if (t_ > end_) return;
  const double across = std::max(std::abs(dx_), std::abs(dz_)) * (end_ - t_);  // steps
  while (widest_ < reader.widest() && across > (widest_ < 3 ? 8 : 32) * static_cast<double>(Step{1} << cellBits(widest_))) ++widest_;
  const lattice::Point start = at(t_);
  const int level = t_ > 0 ? widest_ : std::min(widest_, 1);
  turnTo(level, start.x >> cellBits(level), start.z >> cellBits(level));
}

lattice::Point Walk::at(double t) const {
  const auto nearest = [](double v) {  // the floor of v + 1/2, without a call
    const double moved = v + 0.5;
    const auto cut = static_cast<Step>(moved);
    return cut - (static_cast<double>(cut) > moved ? 1 : 0);
  };
  return {x_ + nearest(dx_ * t), z_ + nearest(dz_ * t)};
}

void Walk::turnTo(int level, std::int64_t i, std::int64_t j) {
  level_ = level, i_ = i, j_ = j;
  const int bits = cellBits(level);
  const auto border = [bits](std::int64_t cell, double per) { return (cell + (per > 0 ? 1 : 0)) << bits; };
  leavesX_ = perX_ == kNever ? kNever : static_cast<double>(border(i, perX_) - x_) * perX_;
  leavesZ_ = perZ_ == kNever ? kNever : static_cast<double>(border(j, perZ_) - z_) * perZ_;
}

// Into the next cell, as wide as the one that the ray enters there.
void Walk::step() {
  t_ = leaves();
  std::int64_t i = i_, j = j_;
  if (alongX())
    i += dx_ > 0 ? 1 : -1;
  else
    j += dz_ > 0 ? 1 : -1;
  int level = level_;
  for (std::int64_t a = i_, b = j_; level < widest_; ++level) {
    a >>= kCellsBits, b >>= kCellsBits;
    if (i >> kCellsBits == a && j >> kCellsBits == b) break;
    i >>= kCellsBits, j >>= kCellsBits;
  }
  turnTo(level, i, j);
}

void Walk::descend() {
  const lattice::Point here = at(t_);
  const int bits = cellBits(level_ - 1);
  const auto within = [](std::int64_t cell, std::int64_t of) { return std::clamp(cell, kCells * of, kCells * of + kCells - 1); };
  turnTo(level_ - 1, within(here.x >> bits, i_), within(here.z >> bits, j_));
}

bool Walk::next(Near& near, Stretch& out) {
  const Reader& reader = near.reader();
  while (t_ < end_ || (t_ == 0 && end_ == 0)) {
    const Near::Entry& entry = near.at({i_ >> kCellsBits, j_ >> kCellsBits, level_});
    const double until = std::min(leaves(), end_);
    const int finest = std::min(finestAt(t_), reader.coarsestWithCorners());
    const float high = level_ > finest ? entry.bounds->lowered[slot()].metres() : entry.bounds->high[slot()];
    const double lowest = y_ + std::min(dy_ * t_, dy_ * until);
    const bool narrows = level_ > finest && level_ <= reader.coarsestWithCorners();
    if (lowest > static_cast<double>(high) + entry.rises.highest || (narrows && !inCell(entry, until, reader, out))) {
      if (until >= end_) return t_ = end_, false;
      step();
      continue;
    }
    if (level_ > finest) {
      if (narrows) t_ = std::max(t_, out.from);
      const Lowered& bound = entry.bounds->lowered[slot()];
      bound.lower(near.at({i_, j_, level_ - 1}).highest());
      descend();
      continue;
    }
    const bool found = inCell(entry, until, reader, out);
    const double to = found ? out.to : until;
    if (to < until)
      t_ = to;
    else if (until >= end_)
      t_ = end_, end_ = -1;
    else
      step();
    if (found) return true;
  }
  return false;
}

// In a cell whose corners are known: the ground lies around the bilinear surface through them.
bool Walk::inCell(const Near::Entry& entry, double until, const Reader& reader, Stretch& out) {
  const auto k = static_cast<std::size_t>((j_ & kIn) * (kCells + 1) + (i_ & kIn));
  const float* const c = &entry.bounds->corner[k];
  const double h00 = c[0], h10 = c[1], h01 = c[kCells + 1], h11 = c[kCells + 2];
  const int bits = cellBits(level_);
  const double scale = 1 / static_cast<double>(Step{1} << bits), twist = h11 - h10 - h01 + h00;
  const double x = static_cast<double>(x_ - (i_ << bits)), z = static_cast<double>(z_ - (j_ << bits));
  const auto gap = [&](double t) {
    const double u = std::clamp((x + dx_ * t) * scale, 0.0, 1.0), v = std::clamp((z + dz_ * t) * scale, 0.0, 1.0);
    return y_ + dy_ * t - (h00 + (h10 - h00) * u + (h01 - h00) * v + twist * (u * v));
  };
  const double bend = entry.bounds->high[slot()] - std::max({h00, h10, h01, h11});
  // Along a ray a bilinear surface is a parabola, at most a quarter of the twist from its chord; places are rounded by half a step.
  const double rounded = (std::abs(h10 - h00) + std::abs(h01 - h00) + 2 * std::abs(twist)) * scale;
  const double margin = bend + 0.25 * std::abs(twist) + rounded;
  const double over = margin + entry.rises.highest, under = margin - entry.rises.lowest;
  const double first = gap(t_), last = gap(until);
  if (std::min(first, last) > over) return false;
  const auto cross = [&](double level) { return t_ + (until - t_) * ((first - level) / (first - last)); };
  out.from = first > over ? std::clamp(cross(over), t_, until) : t_;
  out.to = until;
  out.guess = first > 0 && last < 0 ? cross(0) : -1;
  out.slope = (first - last) / (until - t_);
  if (first > -under && last < -under) out.to = std::clamp(std::max(cross(-under), out.from + kShortest), out.from, until);
  out.side =
      reader.isMap() ? std::min(cellMetres(level_), reader.finestOfMap() / 2) : cellMetres(level_);  // a bicubic bends as much on half
  // Wider cells hide steeper octaves.
  out.bend = (reader.isMap() || level_ == 0 ? 1 : 2) * bend + 0.25 * std::abs(twist);
  // A bicubic is at most 15/8 of its samples' range steep, a post; half of that lies between it and a chord.
  out.steep = 1.875 * (static_cast<double>(entry.rises.highest) - entry.rises.lowest);
  return true;
}

}  // namespace ridgecast::ground
