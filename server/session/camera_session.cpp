#include "server/session/camera_session.h"

#include <chrono>
#include <exception>
#include <utility>

#include "common/codec/codec.h"

namespace ridgecast::session {

namespace {

using wire::ErrorCode;
using wire::ErrorMessage;

double millisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

ErrorMessage expectsHello(std::string_view what) {
  return {ErrorCode::kMalformed, "The first message must be a hello; a " + std::string(what) + " came first."};
}

}  // namespace

CameraSession::CameraSession(std::shared_ptr<Session> session, Place place, std::uint64_t id, std::shared_ptr<Sender> sender)
    : session_(std::move(session)),
      place_(std::move(place)),
      id_(id),
      sender_(std::move(sender)),
      pool_(session_->resources().machine->makePool()),
      replica_(session_->resources().limits.window) {}

void CameraSession::receive(wire::ClientMessage message) {
  Refusal refusal;
  {
    const std::lock_guard lock(mutex_);
    if (stage_ == Stage::kClosed) return;
    refusal = std::visit([this](auto& m) { return take(m); }, message);
    if (!refusal && !wake()) refusal = ErrorMessage{ErrorCode::kInternal, "The server is shutting down."};
  }
  if (refusal) refuse(std::move(*refusal));
}

CameraSession::Refusal CameraSession::take(wire::Hello& hello) {
  if (hello.protocolVersion != wire::kProtocolVersion)
    return ErrorMessage{ErrorCode::kVersion, "This server speaks protocol version " + std::to_string(wire::kProtocolVersion) +
                                                 " and the client version " + std::to_string(hello.protocolVersion) +
                                                 ": both must be the same."};
  if (stage_ != Stage::kExpectsHello) return ErrorMessage{ErrorCode::kMalformed, "A second hello came; a connection has exactly one."};
  granted_ = pipeline::grant(hello.settings, session_->resources().limits.mesh);
  lockstep_ = hello.pacing == wire::Pacing::kLockstep;
  stage_ = Stage::kRuns;
  return {};
}

CameraSession::Refusal CameraSession::take(wire::PoseMessage& pose) {
  if (stage_ == Stage::kExpectsHello) return expectsHello("pose");
  if (!camera::isValid(pose.camera)) return ErrorMessage{ErrorCode::kInvalid, "A pose has a value that is not finite or out of range."};
  if (pose.sequence <= lastSequence_)
    return ErrorMessage{ErrorCode::kInvalid, "Pose " + std::to_string(pose.sequence) + " came after pose " + std::to_string(lastSequence_) +
                                                 ": sequences start at 1 and ascend."};
  if (lockstep_ && poses_.size() >= kMaxQueuedPoses)
    return ErrorMessage{ErrorCode::kLimit, "More than " + std::to_string(kMaxQueuedPoses) +
                                               " poses wait in lock-step: send the next one when iterations have arrived."};
  lastSequence_ = pose.sequence;
  if (!lockstep_) poses_.clear();
  poses_.push_back(pose);
  return {};
}

CameraSession::Refusal CameraSession::take(const wire::Acknowledge& acknowledge) {
  if (stage_ == Stage::kExpectsHello) return expectsHello("acknowledgement");
  const std::string iteration = "Iteration " + std::to_string(acknowledge.iteration);
  switch (replica_.acknowledge(acknowledge.iteration, acknowledge.meshHash)) {
    case replica::Verdict::kAgrees:
    case replica::Verdict::kRepairs:
      return {};
    case replica::Verdict::kNeverSent:
      return ErrorMessage{ErrorCode::kInvalid, iteration + " was acknowledged but never sent."};
    case replica::Verdict::kOutOfOrder:
      return ErrorMessage{ErrorCode::kInvalid, iteration + " was acknowledged before; acknowledgements ascend."};
    case replica::Verdict::kHopeless:
      break;
  }
  return ErrorMessage{ErrorCode::kInvalid, "The client's mesh differs even after everything was sent again " +
                                               std::to_string(replica::kMaxRepairs) + " times: it must start afresh."};
}

CameraSession::Refusal CameraSession::take(const wire::ResendLeaves& resend) {
  if (stage_ == Stage::kExpectsHello) return expectsHello("request to resend leaves");
  replica_.resend(resend.leaves);
  return {};
}

void CameraSession::close() {
  const std::lock_guard lock(mutex_);
  stage_ = Stage::kClosed;
  poses_.clear();
  wake();
}

void CameraSession::refuse(ErrorMessage message) {
  close();
  sender_->fail(std::move(message));
}

// Whether a task has something to do now.
bool CameraSession::hasWork() const {
  if (stage_ == Stage::kExpectsHello) return false;
  if (stage_ == Stage::kClosed || !greeted_) return true;
  if (!replica_.hasRoom() || sender_->queuedBytes() > session_->resources().limits.maxQueuedBytes) return false;
  if (lockstep_) return !poses_.empty();
  return !poses_.empty() || (posed_ && (!atRest_ || replica_.owes()));
}

bool CameraSession::wake() {
  if (scheduled_ || !hasWork()) return true;
  scheduled_ = pool_->post([self = shared_from_this()] { self->run(); });
  return scheduled_;
}

void CameraSession::run() {
  try {
    work();
  } catch (const std::exception& e) {
    refuse({ErrorCode::kInternal, std::string("The server failed: ") + e.what()});
  }
  std::unique_ptr<IteratingMesh> freed;  // before the lock: destroyed after it
  const std::lock_guard lock(mutex_);
  scheduled_ = false;
  if (stage_ == Stage::kClosed)
    freed = std::move(mesh_);
  else
    wake();
}

void CameraSession::work() {
  bool greet = false;
  {
    const std::lock_guard lock(mutex_);
    if (stage_ == Stage::kClosed) return;
    greet = !greeted_;
  }
  if (!greet) return iterate();

  const Resources& resources = session_->resources();
  const terrain::Terrain& terrain = *session_->terrain();
  wire::World world;
  world.serverName = resources.serverName;
  world.session = session_->name();
  world.terrainName = terrain.name();
  world.terrainSource = terrain.source();
  world.seed = terrain.seed();
  world.contentHash = session_->contentHash();
  world.horizon = pipeline::Pipeline::kHorizon;
  world.settings = granted_;
  world.window = resources.limits.window;
  world.camera = id_;
  sender_->send(std::move(world));
  mesh_ = resources.makeMesh(session_->terrain(), granted_, pool_);
  const std::lock_guard lock(mutex_);
  greeted_ = true;
}

void CameraSession::iterate() {
  bool newPose = false;
  {
    const std::lock_guard lock(mutex_);
    if (!hasWork() || stage_ != Stage::kRuns) return;
    if (!poses_.empty()) {
      pose_ = poses_.front();
      poses_.pop_front();
      posed_ = newPose = true;
    }
  }
  wire::Iteration iteration;
  iteration.figures = mesh_->iterate(pose_.camera);
  iteration.poseSequence = pose_.sequence;
  iteration.settled = mesh_->settled();
  replica::Changes changes;
  {
    const std::lock_guard lock(mutex_);
    if (stage_ != Stage::kRuns) return;
    const bool tellsRest = iteration.settled && !atRest_;
    atRest_ = iteration.settled;
    if (!newPose && !tellsRest && !replica_.differs(mesh_->leaves())) return;
    changes = replica_.send(mesh_->leaves());
  }
  iteration.number = changes.number;
  iteration.gone = std::move(changes.gone);
  iteration.meshHash = changes.meshHash;
  const auto start = std::chrono::steady_clock::now();
  iteration.whole = encode(changes.whole);
  iteration.figures.encodeMs = millisecondsSince(start);
  sender_->send(std::move(iteration));
}

std::vector<wire::LeafWhole> CameraSession::encode(const std::vector<lattice::LeafAddress>& addresses) const {
  std::vector<wire::LeafWhole> whole(addresses.size());
  pool_->forEach(addresses.size(), 2, [&](std::size_t k) {
    const mesh::LeafMesh leaf = mesh_->extract(addresses[k]);
    whole[k].address = addresses[k];
    whole[k].vertices = static_cast<std::uint32_t>(leaf.vertices.size());
    whole[k].triangles = static_cast<std::uint32_t>(leaf.triangles.size());
    whole[k].payload = codec::encodeLeaf(leaf);
  });
  return whole;
}

}  // namespace ridgecast::session
