#include "server/presence/crowd.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"

namespace ridgecast::presence {

namespace {

constexpr double kSide = static_cast<double>(std::int64_t{1} << wire::kCellBits);  // of a cell, steps

Crowd::Cell cellOf(const camera::Pose& pose) { return {pose.x >> wire::kCellBits, pose.z >> wire::kCellBits}; }

}  // namespace

const std::string& Crowd::Participant::moved(bool withState) const {
  std::string& bytes = moved_[withState];
  if (!bytes.empty()) return bytes;
  expects(member_.moved.has_value(), "only what has moved is told as moved");
  wire::Members part;
  part.moved.push_back(*member_.moved);
  if (!withState) part.moved.front().pose.state.clear();
  return bytes = wire::encodePart(part);
}

Crowd::Participant& Crowd::add(wire::Member member) {
  const auto [it, isNew] = all_.try_emplace(member.camera);
  expects(isNew, "a member joins once");
  Participant& who = it->second;
  who.member_ = std::move(member);
  who.version_ = ++version_;
  if (who.member_.moved) place(who);
  return who;
}

void Crowd::move(Participant& who, wire::Moved moved) {
  unplace(who);
  who.member_.moved = std::move(moved);
  who.version_ = ++version_;
  who.moved_ = {};
  place(who);
}

void Crowd::remove(std::uint64_t camera) {
  const auto it = all_.find(camera);
  if (it == all_.end()) return;
  unplace(it->second);
  all_.erase(it);
  ++version_;
}

const Crowd::Participant* Crowd::find(std::uint64_t camera) const {
  const auto it = all_.find(camera);
  return it == all_.end() ? nullptr : &it->second;
}

void Crowd::place(Participant& who) {
  const camera::Pose& pose = who.member_.moved->pose.camera.pose;
  who.cell_ = cellOf(pose);
  std::vector<Spot>& spots = cells_[who.cell_];
  who.index_ = spots.size();
  spots.push_back({static_cast<double>(pose.x), static_cast<double>(pose.z), std::ldexp(pose.y, lattice::kStepBits), &who});
  ++placed_;
}

void Crowd::unplace(Participant& who) {
  if (!who.member_.moved) return;
  const auto cell = cells_.find(who.cell_);
  expects(cell != cells_.end() && cell->second[who.index_].who == &who, "a member lies in its cell");
  std::vector<Spot>& spots = cell->second;
  spots[who.index_] = spots.back();
  spots[who.index_].who->index_ = who.index_;
  spots.pop_back();
  if (spots.empty()) cells_.erase(cell);
  --placed_;
}

// The nearest of those that were offered.
class Crowd::Search {
 public:
  Search(const Participant& to, std::size_t count) : to_(to), count_(count) {
    const camera::Pose& pose = to.member_.moved->pose.camera.pose;
    x_ = static_cast<double>(pose.x), z_ = static_cast<double>(pose.z), y_ = std::ldexp(pose.y, lattice::kStepBits);
    found_.reserve(count + 1);
  }
  void offer(const std::vector<Spot>& spots) {
    for (const Spot& spot : spots) {
      const double x = spot.x - x_, z = spot.z - z_, y = spot.y - y_;
      const Found found{x * x + z * z + y * y, spot.who};
      if (found_.size() == count_ && !(found < found_.front())) continue;
      if (spot.who == &to_) continue;
      found_.push_back(found);
      std::push_heap(found_.begin(), found_.end());
      if (found_.size() <= count_) continue;
      std::pop_heap(found_.begin(), found_.end());
      found_.pop_back();
    }
  }
  // Nobody at least this far away is among the nearest.
  bool isFull(double reach) const {
    reach *= 1 - 1e-9;  // squares are rounded
    return found_.size() == count_ && reach > 0 && found_.front().square < reach * reach;
  }
  std::vector<const Participant*> take() {
    std::sort_heap(found_.begin(), found_.end());
    std::vector<const Participant*> out;
    out.reserve(found_.size());
    for (const Found& found : found_) out.push_back(found.who);
    return out;
  }

 private:
  struct Found {
    double square = 0;
    const Participant* who = nullptr;
    bool operator<(const Found& other) const {
      return square != other.square ? square < other.square : who->member_.camera < other.who->member_.camera;
    }
  };
  const Participant& to_;
  const std::size_t count_;
  double x_ = 0, z_ = 0, y_ = 0;
  std::vector<Found> found_;  // a heap, the farthest first
};

std::vector<const Crowd::Participant*> Crowd::nearest(const Participant& to, std::size_t count) const {
  std::vector<const Participant*> out;
  if (count == 0) return out;
  const bool hasPlace = to.member_.moved.has_value();
  if (hasPlace && placed_ > 1) {
    Search search(to, count);
    const Cell at = to.cell_;
    const camera::Pose& pose = to.member_.moved->pose.camera.pose;
    const double west = static_cast<double>(pose.x - (at.i << wire::kCellBits)),
                 north = static_cast<double>(pose.z - (at.j << wire::kCellBits));
    const double margin = std::min({west, kSide - west, north, kSide - north});  // to the edge of its own cell
    std::size_t seen = 0;
    const auto offer = [&](Cell cell) {
      const auto it = cells_.find(cell);
      if (it == cells_.end()) return;
      search.offer(it->second);
      seen += it->second.size();
    };
    for (std::int64_t ring = 0; seen < placed_ && !search.isFull(margin + static_cast<double>(ring - 1) * kSide); ++ring) {
      const auto width = static_cast<std::size_t>(2 * ring + 1);
      if (width * width > cells_.size() + 8) {
        for (const auto& [cell, spots] : cells_)
          if (std::max(std::abs(cell.i - at.i), std::abs(cell.j - at.j)) >= ring) search.offer(spots);
        break;
      }
      for (std::int64_t k = -ring; k <= ring; ++k) {
        offer({at.i + k, at.j - ring});
        if (ring == 0) break;
        offer({at.i + k, at.j + ring});
        if (std::abs(k) == ring) continue;
        offer({at.i - ring, at.j + k});
        offer({at.i + ring, at.j + k});
      }
    }
    out = search.take();
  }
  if (out.size() == count || (hasPlace && placed_ == all_.size())) return out;
  for (const auto& [camera, who] : all_) {
    if (out.size() == count) break;
    if (&who != &to && !(hasPlace && who.member_.moved)) out.push_back(&who);
  }
  return out;
}

wire::Crowd Crowd::counts(std::size_t most) const {
  expects(most > 0, "a crowd has cells");
  std::vector<std::pair<Cell, std::uint32_t>> cells;
  cells.reserve(cells_.size());
  for (const auto& [cell, spots] : cells_) cells.emplace_back(cell, static_cast<std::uint32_t>(spots.size()));
  wire::Crowd out;
  for (;; ++out.level) {
    std::ranges::sort(cells);
    std::size_t kept = 0;
    for (std::size_t k = 0; k < cells.size(); ++k)
      if (kept > 0 && cells[kept - 1].first == cells[k].first)
        cells[kept - 1].second += cells[k].second;
      else
        cells[kept++] = cells[k];
    cells.resize(kept);
    // Four quadrants around the origin never become one cell.
    if (kept <= std::max<std::size_t>(most, 4)) break;
    for (auto& [cell, count] : cells) cell = {cell.i >> 1, cell.j >> 1};
  }
  expects(out.level <= wire::kMaxCrowdLevel, "the lattice has an end");
  for (const auto& [cell, count] : cells) out.i.push_back(cell.i), out.j.push_back(cell.j), out.count.push_back(count);
  return out;
}

}  // namespace ridgecast::presence
