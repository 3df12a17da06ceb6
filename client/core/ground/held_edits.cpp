#include "client/core/ground/held_edits.h"

#include <algorithm>
#include <cmath>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"

namespace ridgecast::core {

using edits::SquareAddress;

namespace {

constexpr double kSlack = 1500;           // metres that the camera may move before squares are looked for again
constexpr std::int64_t kMaxNamed = 1024;  // squares of a changed area; more are looked for

constexpr lattice::Step kSquare = lattice::Step{1} << edits::kSquareStepBits, kHalf = kSquare / 2;

}  // namespace

double HeldEdits::distance(SquareAddress a) const {
  const auto away = [](std::int64_t side, lattice::Step from) { return static_cast<double>(side * kSquare + kHalf - from); };
  return std::hypot(away(a.i, camera_.x), away(a.j, camera_.z)) * lattice::kMetresPerStep;
}

void HeldEdits::moveTo(lattice::Point camera) {
  if (edits::squareOf(camera) != edits::squareOf(camera_)) sorted_ = false;
  camera_ = camera;
  if (foundAt_ && std::hypot(static_cast<double>(camera.x - foundAt_->x), static_cast<double>(camera.z - foundAt_->z)) >
                      kSlack * lattice::kStepsPerMetre)
    foundAt_.reset();
}

void HeldEdits::know(std::uint64_t edit) { last_ = std::max(last_, edit); }

void HeldEdits::reconnected(std::uint64_t edit) {
  pending_.clear();
  finding_ = named_ = false;
  foundAt_.reset();
  last_ = edit;
  edit_ = 0;
  for (auto& [address, known] : known_) {
    known.needs = 0;
    known.isOld = true;
  }
  if (edit == 0)
    while (!known_.empty()) drop(known_.begin()->first);
}

HeldEdits::Questions HeldEdits::take() {
  Questions out;
  if (last_ == 0) return out;
  if (!finding_ && (!foundAt_ || edit_ < last_)) {
    finding_ = true;
    named_ = !foundAt_;
    if (named_) foundAt_ = camera_;
    out.find = wire::FindEdits{camera_, named_ ? reach_ + kSlack : 0, edit_};
  }
  sort();
  expects(nearest_.size() <= kMaxHeld, "no more squares are wanted than are held");
  for (const SquareAddress a : nearest_) {
    if (pending_.size() >= kMaxPending || out.want.squares.size() >= wire::kMaxSquares) break;
    if (const auto known = known_.find(a); known == known_.end() || known->second.good() || pending_.contains(a)) continue;
    pending_.insert(a);
    out.want.squares.push_back(a);
  }
  return out;
}

// Those to be held, the nearest first; what is held of others goes.
void HeldEdits::sort() {
  if (std::exchange(sorted_, true)) return;
  std::vector<std::pair<double, SquareAddress>> all;
  for (const auto& [a, known] : known_) all.emplace_back(distance(a), a);
  std::ranges::sort(all);
  nearest_.clear();
  for (std::size_t k = 0; k < all.size(); ++k) {
    if (k < kMaxHeld)
      nearest_.push_back(all[k].second);
    else if (Known& known = known_[all[k].second]; known.held) {
      const std::uint64_t needs = known.needs;
      drop(all[k].second);
      known_[all[k].second].needs = needs;
      sorted_ = true;
    }
  }
}

void HeldEdits::drop(SquareAddress address) {
  known_.erase(address);
  sorted_ = false;
  if (squares_.erase(address) == 0) return;
  layer_ = edits::withSquare(*layer_, address, nullptr);
  ++version_;
}

Outcome<void> HeldEdits::put(const wire::FoundEdits& found) {
  if (!finding_) return Error{"the server says where edits are without being asked"};
  finding_ = false;
  edit_ = std::max(edit_, found.edit);
  last_ = std::max(last_, edit_);
  const bool named = std::exchange(named_, false);
  if (named) {
    const std::set<SquareAddress> there(found.squares.begin(), found.squares.end());
    std::vector<SquareAddress> gone;
    for (const auto& [a, known] : known_)
      if (!there.contains(a)) gone.push_back(a);
    for (const SquareAddress a : gone) drop(a);
    for (const SquareAddress a : there) known_.try_emplace(a);
    sorted_ = false;
  }
  for (const lattice::Area& area : found.changed) {
    changed(area, found.edit);
    if (!named) name(area, found.edit);
  }
  return {};
}

void HeldEdits::changed(const lattice::Area& area, std::uint64_t edit) {
  for (auto& [a, known] : known_)
    if (area.meets({a.i * kSquare, a.j * kSquare, (a.i + 1) * kSquare, (a.j + 1) * kSquare})) known.needs = edit;
}

// A changed area may have edits now; where it is large, the squares are looked for.
void HeldEdits::name(const lattice::Area& area, std::uint64_t edit) {
  const auto reach = static_cast<lattice::Step>((reach_ + kSlack) * lattice::kStepsPerMetre);
  const SquareAddress first = edits::squareOf({std::max(area.x0, camera_.x - reach), std::max(area.z0, camera_.z - reach)}),
                      last = edits::squareOf({std::min(area.x1 - 1, camera_.x + reach), std::min(area.z1 - 1, camera_.z + reach)});
  if (last.i < first.i || last.j < first.j) return;
  if ((last.i - first.i + 1) * (last.j - first.j + 1) > kMaxNamed || known_.size() > wire::kMaxFoundSquares) {
    foundAt_.reset();
    return;
  }
  for (std::int64_t j = first.j; j <= last.j; ++j)
    for (std::int64_t i = first.i; i <= last.i; ++i)
      if (known_.try_emplace({i, j}, Known{edit, {}}).second) sorted_ = false;
}

Outcome<void> HeldEdits::put(const wire::Squares& squares) {
  for (const wire::Square& square : squares.squares) {
    if (pending_.erase(square.address) == 0) return Error{"the server sent a square of edits that was not requested"};
    const auto decoded = edits::decodeSquare(square.rises, square.materials);
    if (!decoded) return decoded.error();
    const auto known = known_.find(square.address);
    if (known == known_.end()) continue;
    if (!*decoded && squares.edit >= known->second.needs) {
      drop(square.address);
      continue;
    }
    known->second.held = squares.edit;
    known->second.isOld = false;
    layer_ = edits::withSquare(*layer_, square.address, *decoded ? &**decoded : nullptr);
    ++version_;
    if (*decoded)
      squares_[square.address] = version_;
    else
      squares_.erase(square.address);
  }
  return {};
}

bool HeldEdits::complete() const {
  if (last_ == 0) return true;
  if (finding_ || !foundAt_ || edit_ < last_ || !sorted_ || !pending_.empty()) return false;
  return std::ranges::all_of(nearest_, [this](SquareAddress a) {
    const auto known = known_.find(a);
    return known == known_.end() || known->second.good();
  });
}

}  // namespace ridgecast::core
