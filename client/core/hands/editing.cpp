#include "client/core/hands/editing.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <string_view>
#include <utility>

#include "common/edits/json.h"
#include "common/outcome/contract.h"
#include "common/text/text.h"

namespace ridgecast::core {
namespace {

using lattice::Step;

constexpr double kNotch = 1.15;
constexpr double kSameCorner = 128;  // steps: the second click of a double click
constexpr std::uint32_t kPasses = 8;

Step mostRadius(Tool tool) {
  return tool == Tool::kSmooth ? edits::kMaxRadius / 4 : tool == Tool::kRoad ? edits::kMaxRadius / 8 : edits::kMaxRadius;
}

double apart(const lattice::Vertex& a, const lattice::Vertex& b) {
  return std::hypot(static_cast<double>(a.x - b.x), static_cast<double>(a.z - b.z));
}

// Two digits that count.
std::string metres(double steps) {
  const double length = steps * lattice::kMetresPerStep, unit = std::pow(10, std::floor(std::log10(length)) - 1);
  return text::rounded(std::round(length / unit) * unit, 6) + " m";
}

// Somebody else undid it, or nobody can any more.
bool isOver(const std::string& refusal) {
  constexpr std::string_view kEdit = "Edit ";
  if (!refusal.starts_with(kEdit)) return false;
  const std::string_view rest =
      std::string_view(refusal).substr(std::min(refusal.find_first_not_of("0123456789", kEdit.size()), refusal.size()));
  return rest.starts_with(" is undone already") || rest.starts_with(" was compacted");
}

}  // namespace

std::string randomKey() {
  std::uint64_t random[2];
  if (getentropy(random, sizeof random) != 0) std::abort();
  return text::hexadecimal(random[0]) + text::hexadecimal(random[1]);
}

std::int32_t Editing::depth() const { return static_cast<std::int32_t>(std::max<Step>(1, std::llround(static_cast<double>(radius_) / 3))); }
std::int32_t Editing::rise() const { return static_cast<std::int32_t>(std::llround(static_cast<double>(radius_) / 4)); }

std::string Editing::words() const {
  std::string radius = "radius " + metres(static_cast<double>(radius_));
  switch (tool_) {
    case Tool::kCrater:
      return radius + ", " + metres(depth()) + " deep";
    case Tool::kRaise:
      return radius + ", up " + metres(rise());
    case Tool::kLower:
      return radius + ", down " + metres(rise());
    case Tool::kLevel:
      return radius + ", at the height of its middle";
    case Tool::kSmooth:
      return radius;
    case Tool::kRoad:
      break;
  }
  return metres(2 * static_cast<double>(radius_)) + " wide, " + (corners_.empty() ? "click its corners" : "double click ends it");
}

void Editing::choose(Tool tool) {
  expects(tool >= Tool::kCrater && tool <= Tool::kRoad, "a tool has a name");
  tool_ = tool;
  corners_.clear();
  widen(0);
}

void Editing::widen(double notches) {
  radius_ = std::clamp<Step>(std::llround(std::min(static_cast<double>(radius_) * std::pow(kNotch, notches), 1e9)), edits::kMinRadius,
                             mostRadius(tool_));
}

void Editing::use(const lattice::Vertex& at) {
  if (tool_ != Tool::kRoad) return void(ask(operationAt(at)));
  if (!corners_.empty() && apart(corners_.back(), at) < kSameCorner) return;
  if (corners_.size() == edits::kMaxCorners)
    return to_.say("A road has at most " + std::to_string(edits::kMaxCorners) + " corners; end it and go on from there.");
  corners_.push_back(at);
}

void Editing::endRoad() {
  if (tool_ != Tool::kRoad) return;
  expects(corners_.size() <= edits::kMaxCorners, "a road that is drawn has no more corners than one that is made");
  if (corners_.size() < 2) return to_.say("A road has at least two corners: click where it begins, and where it goes.");
  edits::Road road;
  road.line = corners_;
  road.width = 2 * radius_;
  if (ask({road, material_})) corners_.clear();
}

void Editing::undo() { corners_.empty() ? undoEdit() : corners_.pop_back(); }

void Editing::undoEdit() {
  if (made_.empty()) return to_.say("You have no edit to undo.");
  const std::uint64_t edit = made_.back();
  if (ask({edits::Undo{edit}, 0}, edit)) made_.pop_back();
}

void Editing::keep(std::uint64_t number) {
  made_.insert(std::ranges::lower_bound(made_, number), number);
  if (made_.size() > kMaxUndone) made_.erase(made_.begin());
}

void Editing::hear(std::uint64_t id, const Outcome<std::uint64_t>& made) {
  const auto found = std::ranges::find(open_, id, [](const Open& o) { return o.edit.id; });
  if (found == open_.end()) return;  // answered twice
  const auto [edit, undoes, done, times] = std::move(*found);
  open_.erase(found);
  if (done) return done(made);
  if (made) {
    if (undoes == 0) keep(*made);
    return to_.say(undoes > 0 ? "Edit " + std::to_string(undoes) + " undone." : "Edit " + std::to_string(*made) + " made.");
  }
  const std::string& refusal = made.error().message;
  if (undoes > 0 && isOver(refusal)) return undoEdit();  // the one before is the last that counts
  if (undoes > 0) keep(undoes);
  to_.say(refusal);
}

void Editing::connected() {
  const Error lost{"The connection was lost again and again before an edit was answered; check whether it was made."};
  const auto dropped = std::ranges::stable_partition(open_, [](const Open& o) { return o.times < kMaxTimes; });
  const std::vector<Open> over(std::move_iterator(dropped.begin()), std::move_iterator(dropped.end()));
  open_.erase(dropped.begin(), dropped.end());
  for (const Open& open : over) open.done ? open.done(lost) : to_.say(lost.message);
  std::vector<wire::Edit> again;
  for (Open& open : open_) ++open.times, again.push_back(open.edit);
  for (const wire::Edit& edit : again) to_.send(edit);
}

edits::Operation Editing::operationAt(const lattice::Vertex& at) const {
  const lattice::Point place{at.x, at.z};
  edits::Operation out;
  out.material = material_;
  if (tool_ == Tool::kCrater)
    out.what = edits::Crater{place, radius_, depth()};
  else if (tool_ == Tool::kLevel)
    out.what = edits::Level{{place}, radius_, at.y};
  else if (tool_ == Tool::kSmooth)
    out.what = edits::Smooth{place, radius_, kPasses};
  else
    out.what = edits::Raise{place, radius_, 0, tool_ == Tool::kLower ? -rise() : rise()};
  return out;
}

bool Editing::ask(const edits::Operation& operation, std::uint64_t undoes) {
  if (open_.size() >= kMaxOpen) {
    to_.say("The server has not answered " + std::to_string(kMaxOpen) + " edits yet; try again in a moment.");
    return false;
  }
  send(edits::toJson(operation), undoes, {});
  return true;
}

void Editing::make(std::string operation, Done done) {
  expects(done != nullptr, "a program hears what became of its edit");
  if (open_.size() >= kMaxWaiting) return done(Error{"More than " + std::to_string(kMaxWaiting) + " edits wait for the server."});
  send(std::move(operation), 0, std::move(done));
}

void Editing::send(std::string operation, std::uint64_t undoes, Done done) {
  const wire::Edit edit{++ids_, to_.newKey(), std::move(operation)};
  expects(!edit.key.empty(), "an edit that may be sent twice has a key");
  open_.push_back({edit, undoes, std::move(done)});
  to_.send(edit);
}

void Editing::leave() {
  for (const Open& open : std::exchange(open_, {}))
    if (open.done) open.done(Error{"The client is in another session now; whether the edit was made is not known."});
}

}  // namespace ridgecast::core
