// A camera's mesh on its way from one server to another (server/handover).
#include <random>
#include <string>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"
#include "server/bus/bus.h"
#include "server/handover/checkpoint.h"
#include "server/member/camera_session.h"
#include "server/recording/events.h"

namespace ridgecast::member {

namespace {

std::string recordOf(const std::string& key) {
  std::string name = "camera/";
  for (const char c : key)
    for (const int half : {c >> 4 & 15, c & 15}) name += "0123456789abcdef"[half];
  return name;
}

// Whether its mesh can go to another server, or come from one.
bool movesTo(const session::Session& session, const wire::Hello& hello) {
  return session.resources().bus->server() != 0 && hello.points && hello.pacing == wire::Pacing::kFree && !session.observer();
}

}  // namespace

// Whoever knows it can have the mesh, and nothing else.
void CameraSession::chooseKey() {
  if (!movesTo(*session_, conversation_.hello())) return;
  std::random_device random;
  while (key_.size() < wire::kMaxResumeKeyBytes) key_.push_back(static_cast<char>(random()));
}

CameraSession::Refusal CameraSession::attend(const wire::Resume& resume) {
  if (resume.meshHash == 0 || resume.key.size() != wire::kMaxResumeKeyBytes || !movesTo(*session_, conversation_.hello())) return {};
  resume_.key = resume.key;
  conversation_.awaitCheckpoint(true);
  const scheduling::Timer& timer = *session_->resources().timer;
  resume_.alarm.set(timer, timer.now() + kCheckpointTimeout, weak_from_this(), mutex_, &CameraSession::giveUpCheckpoint);
  return {};
}

bool CameraSession::handOver(std::function<void()> done) {
  expects(done != nullptr, "whoever waits for a handover is called");
  const std::lock_guard lock(mutex_);
  if (!conversation_.runs() || key_.empty() || handOver_ || conversation_.replica().lastSent() == 0) return false;
  handOver_ = std::move(done);
  conversation_.leave();
  return wake();
}

void CameraSession::workOnHandOver() {
  handover::Checkpoint checkpoint;
  bool isHeld = false;  // by the client, as it is
  std::function<void()> done;
  {
    const std::lock_guard lock(mutex_);
    done = std::exchange(handOver_, nullptr);
    isHeld = task_.mesh && !conversation_.replica().differs(task_.mesh->leaves());
    checkpoint.meshHash = conversation_.replica().meshHash();
  }
  std::optional<std::string> bytes;
  if (auto state = isHeld ? task_.mesh->state() : std::nullopt) {
    checkpoint.contentHash = session_->contentHash();
    checkpoint.edit = task_.ground.edit;
    checkpoint.mesh = std::move(*state);
    bytes = handover::encode(checkpoint, *task_.ground.terrain);
  }
  if (!bytes) return done();
  const session::Resources& resources = session_->resources();
  resources.checkpoints->hold(resources.bus, recordOf(key_), std::move(*bytes), resources.timer->now(),
                              [done](const Outcome<bus::Bus::Held>&) { done(); });
}

// A record of ours in its place expires soon.
void CameraSession::lookUpCheckpoint() {
  std::string key;
  {
    const std::lock_guard lock(mutex_);
    key = recordOf(std::exchange(resume_.key, {}));
  }
  const std::shared_ptr<bus::Bus> bus = session_->resources().bus;
  bus->hold(key, {}, 0, std::chrono::seconds(1), [weak = weak_from_this(), engine = std::weak_ptr(bus), key](Outcome<bus::Bus::Held> held) {
    if (const auto there = engine.lock(); there && held) there->drop(key, held->record.epoch);
    if (const auto self = weak.lock()) self->found(held && !held->isYours ? std::move(held->record.value) : std::string());
  });
}

void CameraSession::found(std::string checkpoint) {
  const std::lock_guard lock(mutex_);
  if (!conversation_.awaitsCheckpoint()) return;  // too late
  resume_.checkpoint = std::move(checkpoint);
  giveUpCheckpoint();
}

void CameraSession::giveUpCheckpoint() {
  if (conversation_.closed() || !conversation_.awaitsCheckpoint()) return;
  conversation_.awaitCheckpoint(false);
  wake();
}

// The mesh that the client holds, from a checkpoint that was found. Nothing: it begins anew.
std::optional<settings::IterationStats> CameraSession::restore(const camera::Camera& camera) {
  std::string bytes;
  std::uint64_t hash = 0;
  wire::Settings granted;
  {
    const std::lock_guard lock(mutex_);
    bytes = std::exchange(resume_.checkpoint, {});
    hash = conversation_.replica().resumedHash();
    granted = conversation_.granted();
  }
  if (bytes.empty()) return {};
  followGround();
  const auto checkpoint = handover::decode(bytes, session_->contentHash(), *task_.ground.terrain, granted.triangleBudget);
  // An edit that has not come here yet would have to be taken back.
  if (!checkpoint || checkpoint->meshHash != hash || checkpoint->edit > task_.ground.edit) return {};
  const auto figures = task_.mesh->restore(checkpoint->mesh, camera);
  if (!figures) return {};
  if (recording::hashOf(task_.mesh->leaves()) != hash) {
    task_.mesh = session_->resources().makeMesh(task_.ground.terrain, granted, pool_);
    return {};
  }
  task_.ground.edit = checkpoint->edit;  // the next iteration knows the others
  const std::lock_guard lock(mutex_);
  conversation_.restored(task_.mesh->leaves());
  return figures;
}

}  // namespace ridgecast::member
