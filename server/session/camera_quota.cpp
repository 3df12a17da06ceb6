#include "server/session/camera_quota.h"

#include <algorithm>
#include <string>

#include "common/outcome/contract.h"
#include "common/settings/settings.h"

namespace ridgecast::session {

using settings::kMinBudget;

Outcome<std::shared_ptr<CameraQuota::Share>> CameraQuota::take() {
  auto share = std::make_shared<Share>(shared_from_this());
  const std::lock_guard lock(mutex_);
  if (cameras_ >= maxCameras_) return Error{"This server is full: it has " + std::to_string(maxCameras_) + " cameras; try again later."};
  if (maxTriangles_ != 0 && triangles_ + kMinBudget > maxTriangles_)
    return Error{"This server is full: its cameras have all " + std::to_string(maxTriangles_) +
                 " triangles that it has memory for; try again later."};
  ++cameras_;
  triangles_ += share->triangles_ = kMinBudget;
  return share;
}

CameraQuota::Share::~Share() {
  const std::lock_guard lock(quota_->mutex_);
  if (triangles_ == 0) return;  // it was not given
  expects(quota_->cameras_ > 0 && quota_->triangles_ >= triangles_, "a share that is given back was taken");
  --quota_->cameras_;
  quota_->triangles_ -= triangles_;
}

std::uint32_t CameraQuota::Share::offerNow(std::uint32_t requested) const {
  const CameraQuota& all = *quota_;
  expects(triangles_ > 0, "who is granted triangles has a share");
  if (all.maxTriangles_ == 0) return requested;
  expects(all.triangles_ <= all.maxTriangles_ && all.cameras_ <= all.maxCameras_, "no more is granted than there is");
  const std::uint64_t left = all.maxTriangles_ - all.triangles_;
  const std::uint64_t kept = std::min<std::uint64_t>(std::uint64_t{kMinBudget} * (all.maxCameras_ - all.cameras_), all.maxTriangles_ / 2);
  const std::uint64_t most = triangles_ + (left > kept ? left - kept : 0);
  return static_cast<std::uint32_t>(std::min<std::uint64_t>(requested, most));
}

std::uint32_t CameraQuota::Share::offer(std::uint32_t requested) const {
  const std::lock_guard lock(quota_->mutex_);
  return offerNow(requested);
}

std::uint32_t CameraQuota::Share::grant(std::uint32_t requested) {
  CameraQuota& all = *quota_;
  const std::lock_guard lock(all.mutex_);
  const std::uint32_t granted = offerNow(requested);
  if (all.maxTriangles_ != 0 && granted > triangles_) {
    all.triangles_ += granted - triangles_;
    triangles_ = granted;
  }
  return granted;
}

std::uint64_t CameraQuota::triangles() const {
  const std::lock_guard lock(mutex_);
  return triangles_;
}

std::uint32_t CameraQuota::cameras() const {
  const std::lock_guard lock(mutex_);
  return cameras_;
}

}  // namespace ridgecast::session
