#include "server/session/places.h"

#include <algorithm>
#include <string>

#include "common/outcome/contract.h"
#include "common/settings/settings.h"

namespace ridgecast::session {

Outcome<std::uint64_t> Budgets::spendEdit(const edits::Operation& operation, std::size_t bytes,
                                          conversation::Budget::Clock::time_point now) {
  const auto owed = std::max(edits.free() - now - kEditDebt, editBytes.free() - now - kEditBytesDebt);
  if (owed.count() > 0)
    return Error{"Too many or too large edits at once; send it again in " +
                 std::to_string(std::chrono::ceil<std::chrono::milliseconds>(owed).count()) + " ms."};
  editBytes.spend(now, bytes);
  const auto area = static_cast<std::uint64_t>(std::min(edits::areaOf(operation).count(), edits::kMaxPosts));
  const std::uint64_t posts = std::max(area, kMinEditedPosts);
  edits.spend(now, posts);
  return posts;
}

using settings::kMinBudget;

Outcome<std::shared_ptr<Places::Place>> Places::enter() {
  auto place = std::make_shared<Place>(shared_from_this());
  const std::lock_guard lock(mutex_);
  if (cameras_ >= maxCameras_) return Error{"This server is full: it has " + std::to_string(maxCameras_) + " cameras; try again later."};
  if (maxTriangles_ != 0 && triangles_ + kMinBudget > maxTriangles_)
    return Error{"This server is full: its cameras have all " + std::to_string(maxTriangles_) +
                 " triangles that it has memory for; try again later."};
  ++cameras_;
  triangles_ += place->triangles_ = kMinBudget;
  return place;
}

std::shared_ptr<Budgets> Places::budgetsOf(const std::string& client, conversation::Budget::Clock::time_point now) {
  if (client.empty()) return std::make_shared<Budgets>();
  const std::lock_guard lock(mutex_);
  std::erase_if(budgets_, [&](const auto& entry) { return entry.second.use_count() == 1 && entry.second->areFull(now); });
  auto& own = budgets_[client];
  if (!own) own = std::make_shared<Budgets>();
  return own;
}

Places::Place::~Place() {
  const std::lock_guard lock(places_->mutex_);
  if (triangles_ == 0) return;  // it never entered
  expects(places_->cameras_ > 0 && places_->triangles_ >= triangles_, "a place that is left was taken");
  --places_->cameras_;
  places_->triangles_ -= triangles_;
}

std::uint32_t Places::Place::grant(std::uint32_t requested) {
  Places& all = *places_;
  const std::lock_guard lock(all.mutex_);
  if (all.maxTriangles_ == 0) return requested;
  expects(all.triangles_ <= all.maxTriangles_ && all.cameras_ <= all.maxCameras_, "no more is granted than there is");
  const std::uint64_t left = all.maxTriangles_ - all.triangles_;
  const std::uint64_t kept = std::min<std::uint64_t>(std::uint64_t{kMinBudget} * (all.maxCameras_ - all.cameras_), all.maxTriangles_ / 2);
  const std::uint64_t most = triangles_ + (left > kept ? left - kept : 0);
  const auto granted = static_cast<std::uint32_t>(std::min<std::uint64_t>(requested, most));
  if (granted > triangles_) {
    all.triangles_ += granted - triangles_;
    triangles_ = granted;
  }
  return granted;
}

std::uint64_t Places::triangles() const {
  const std::lock_guard lock(mutex_);
  return triangles_;
}

std::uint32_t Places::cameras() const {
  const std::lock_guard lock(mutex_);
  return cameras_;
}

}  // namespace ridgecast::session
