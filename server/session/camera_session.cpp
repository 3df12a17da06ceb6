#include "server/session/camera_session.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <optional>
#include <span>
#include <utility>

#include "common/codec/codec.h"
#include "common/codec/delta.h"
#include "common/mesh/gather.h"
#include "common/terrain/shades.h"
#include "common/wire/wire.h"
#include "server/memory/memory.h"
#include "server/query/query.h"

namespace ridgecast::session {

namespace {

using wire::ErrorCode;
using wire::ErrorMessage;

double millisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

// What cameras leave behind lies scattered in the allocator's arenas, which keep it until they are told. It takes milliseconds: once for all
// cameras that close within a second.
void giveMemoryBackSoon(const Resources& resources) {
  if (resources.givesMemoryBack.exchange(true)) return;
  resources.alarm.at(std::chrono::steady_clock::now() + std::chrono::seconds(1), [&resources] {  // they own the alarm
    resources.givesMemoryBack = false;
    memory::giveBack();
  });
}

constexpr std::size_t kBytesACandidate = 15;  // about

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

wire::Settings CameraSession::granted(const wire::Settings& asked) const {
  wire::Settings out = pipeline::grant(asked, session_->resources().limits.mesh);
  const std::uint64_t most = session_->resources().limits.maxBytesPerSecond;
  if (out.bytesPerSecond == 0 || (most != 0 && out.bytesPerSecond > most)) out.bytesPerSecond = most;
  if (out.bytesPerSecond != 0) out.bytesPerSecond = std::max(out.bytesPerSecond, kLeastBytesPerSecond);
  return out;
}

CameraSession::Refusal CameraSession::take(wire::Hello& hello) {
  if (hello.protocolVersion != wire::kProtocolVersion)
    return ErrorMessage{ErrorCode::kVersion, "This server speaks protocol version " + std::to_string(wire::kProtocolVersion) +
                                                 " and the client version " + std::to_string(hello.protocolVersion) +
                                                 ": both must be the same."};
  if (stage_ != Stage::kExpectsHello) return ErrorMessage{ErrorCode::kMalformed, "A second hello came; a connection has exactly one."};
  granted_ = granted(hello.settings);
  pace_.setRate(granted_.bytesPerSecond);
  replica_.setDeltas(hello.deltas);
  if (hello.deltas) bases_.setBudget(kBaseBytesPerTriangle * granted_.triangleBudget);
  lockstep_ = hello.pacing == wire::Pacing::kLockstep;
  hello_ = hello;
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
  if (greeted_) session_->presence().moved(id_, pose);
  return {};
}

CameraSession::Refusal CameraSession::expectsWorld(std::string_view what) const {
  if (stage_ == Stage::kExpectsHello) return expectsHello(what);
  if (greeted_) return {};
  return ErrorMessage{ErrorCode::kMalformed, "A " + std::string(what) + " came before the world was sent; wait for the world."};
}

CameraSession::Refusal CameraSession::take(const wire::AskClock& ask) {
  if (auto refusal = expectsWorld("question for the clock")) return refusal;
  session_->presence().ask(id_, ask);
  return {};
}

CameraSession::Refusal CameraSession::take(const wire::SetClock& set) {
  if (auto refusal = expectsWorld("clock")) return refusal;
  session_->presence().set(id_, set);
  return {};
}

CameraSession::Refusal CameraSession::take(const wire::Step& step) {
  if (auto refusal = expectsWorld("step")) return refusal;
  switch (session_->presence().step(id_, step)) {
    case Clock::Stepped::kBegins:
    case Clock::Stepped::kQueues:
    case Clock::Stepped::kNotYours:  // answered with the clock, which says whose it is
      return {};
    case Clock::Stepped::kNotStepped:
      return ErrorMessage{ErrorCode::kInvalid, "A step came while the clock runs by itself; set it to stepped first."};
    case Clock::Stepped::kTooMany:
      break;
  }
  return ErrorMessage{ErrorCode::kLimit, "More than " + std::to_string(Clock::kMaxQueuedSteps) +
                                             " steps wait for the members: send the next when the clock says that one has begun."};
}

CameraSession::Refusal CameraSession::take(wire::Query& query) {
  if (auto refusal = expectsWorld("query")) return refusal;
  if (*queries_ >= wire::kMaxQueries)
    return ErrorMessage{ErrorCode::kLimit, "More than " + std::to_string(wire::kMaxQueries) +
                                               " queries wait for their answers: send the next when one has arrived."};
  ++*queries_;
  // Open until the answer has left.
  std::shared_ptr<const void> ticket(nullptr, [open = queries_](const void*) { --*open; });
  pool_->post([terrain = session_->terrain(), sender = sender_, query = std::move(query), ticket = std::move(ticket)]() mutable {
    sender->send(query::answer(*terrain, query), std::move(ticket));
  });
  return {};
}

CameraSession::Refusal CameraSession::take(const wire::AskGround& ask) {
  if (auto refusal = expectsWorld("question for the ground")) return refusal;
  if (!grounds_) grounds_ = std::make_shared<Grounds>(session_->terrain(), granted_.triangleBudget, pool_, sender_);
  if (grounds_->ask(ask)) return {};
  return ErrorMessage{ErrorCode::kLimit,
                      "More than " + std::to_string(wire::kMaxGrounds) + " grounds were asked for: ask for the next when one has arrived."};
}

CameraSession::Refusal CameraSession::take(const wire::StepDone& done) {
  if (auto refusal = expectsWorld("step done")) return refusal;
  session_->presence().done(id_, done);
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

CameraSession::Refusal CameraSession::take(const wire::Resume& resume) {
  if (stage_ == Stage::kExpectsHello) return expectsHello("resume");
  if (lastSequence_ != 0)
    return ErrorMessage{ErrorCode::kMalformed, "A resume came after a pose; it belongs between hello and the first pose."};
  if (!replica_.resume(resume.leaves))
    return ErrorMessage{ErrorCode::kInvalid, "A resume names a leaf twice, or more than " + std::to_string(wire::kMaxResumed) + " in all."};
  return {};
}

CameraSession::Refusal CameraSession::take(const wire::WantTiles& wanted) {
  if (stage_ == Stage::kExpectsHello) return expectsHello("wish for tiles");
  const terrain::Raster* raster = session_->terrain()->raster();
  if (!raster || !session_->resources().limits.sendsTerrain)
    return ErrorMessage{ErrorCode::kInvalid, "Tiles are wanted of a world that has no height map."};
  if (tiles_.size() + wanted.tiles.size() > wire::kMaxWantedTiles)
    return ErrorMessage{ErrorCode::kLimit,
                        "More than " + std::to_string(wire::kMaxWantedTiles) + " tiles wait to be sent: want fewer at a time."};
  for (const terrain::TileAddress& tile : wanted.tiles)
    if (!terrain::tileIsValid(raster->shape(), tile))
      return ErrorMessage{ErrorCode::kInvalid, "A tile is wanted that lies beyond the lattice."};
  tiles_.insert(tiles_.end(), wanted.tiles.begin(), wanted.tiles.end());
  return {};
}

CameraSession::Refusal CameraSession::take(const wire::ChangeSettings& change) {
  if (auto refusal = expectsWorld("change of settings")) return refusal;
  if (!lockstep_) changes_.clear();
  if (changes_.size() >= kMaxQueuedPoses)
    return ErrorMessage{ErrorCode::kLimit, "More than " + std::to_string(kMaxQueuedPoses) +
                                               " changes of settings wait for their poses: change them when iterations have arrived."};
  changes_.push_back({lastSequence_, granted(change.settings)});
  return {};
}

void CameraSession::close() {
  const std::lock_guard lock(mutex_);
  stage_ = Stage::kClosed;
  poses_.clear();
  session_->presence().leave(id_);
  session_->live().remove(id_);
  if (grounds_) grounds_->close();
  grounds_.reset();
  wake();
}

void CameraSession::refuse(ErrorMessage message) {
  close();
  sender_->fail(std::move(message));
}

// Whether a task has something to do now.
bool CameraSession::hasWork() const {
  if (stage_ == Stage::kExpectsHello) return false;
  if (stage_ == Stage::kClosed || !greeted_ || !holds_.empty()) return true;
  if (sender_->queuedBytes() > session_->resources().limits.maxQueuedBytes) return false;
  if (!tiles_.empty()) return true;
  if (!replica_.hasRoom()) return false;
  if (lockstep_) return !poses_.empty();
  return !poses_.empty() || (posed_ && (!atRest_ || !changes_.empty() || replica_.owes()));
}

bool CameraSession::wake() {
  if (scheduled_ || !hasWork()) return true;
  if (stage_ == Stage::kRuns && greeted_ && holds_.empty() && pace_.limits() && Pace::Clock::now() < pace_.free()) {
    if (alarmSet_) return true;
    alarmSet_ = true;
    session_->resources().alarm.at(pace_.free(), [weak = weak_from_this()] {
      const auto self = weak.lock();
      if (!self) return;
      const std::lock_guard lock(self->mutex_);
      self->alarmSet_ = false;
      self->wake();
    });
    return true;
  }
  scheduled_ = pool_->post([self = shared_from_this()] { self->run(); });
  return scheduled_;
}

void CameraSession::run() {
  try {
    work();
  } catch (const std::exception& e) {
    refuse({ErrorCode::kInternal, std::string("The server failed: ") + e.what()});
  }
  // Taken under the lock, for another task may follow; destroyed after it.
  std::unique_ptr<IteratingMesh> freed;
  std::vector<Hold> disappointed;
  replica::Bases bases;
  {
    const std::lock_guard lock(mutex_);
    scheduled_ = false;
    if (stage_ != Stage::kClosed) {
      wake();
      return;
    }
    freed = std::move(mesh_);
    disappointed.swap(holds_);
    bases = std::exchange(bases_, replica::Bases());
    countTriangles(0);
  }
  for (const Hold& done : disappointed) done(nullptr);
  if (freed) giveMemoryBackSoon(session_->resources());
}

void CameraSession::work() {
  bool greet = false, copies = false, tiles = false;
  {
    const std::lock_guard lock(mutex_);
    if (stage_ == Stage::kClosed) return;
    greet = !greeted_;
    copies = !holds_.empty();
    tiles = !tiles_.empty();
  }
  if (!greet) return copies ? copy() : tiles ? sendTiles() : iterate();

  const Resources& resources = session_->resources();
  const terrain::Terrain& terrain = *session_->terrain();
  wire::World world;
  world.serverName = resources.serverName;
  world.session = session_->name();
  world.terrainName = terrain.name();
  if (session_->resources().limits.sendsTerrain) {
    world.terrainSource = terrain.source();
    if (terrain.raster()) world.heightMap = terrain.raster()->shape();
  } else {
    world.shadedVertices = static_cast<bool>(terrain.colours());
  }
  world.seed = terrain.seed();
  world.contentHash = session_->contentHash();
  world.horizon = pipeline::Pipeline::kHorizon;
  world.settings = granted_;
  world.window = resources.limits.window;
  world.camera = id_;
  mesh_ = resources.makeMesh(session_->terrain(), granted_, pool_);
  // Under the lock: whoever has received the world may say anything.
  const std::lock_guard lock(mutex_);
  greeted_ = true;
  if (stage_ == Stage::kClosed) return;
  session_->live().add(id_, weak_from_this());
  sender_->send(std::move(world));
  session_->presence().join(id_, hello_, sender_, poses_.empty() ? std::nullopt : std::optional(poses_.back()));
}

void CameraSession::countTriangles(std::uint32_t now) {
  session_->resources().figures->triangles.add(static_cast<std::int64_t>(now) - static_cast<std::int64_t>(counted_));
  counted_ = now;
}

bool CameraSession::hold(Hold done) {
  const std::lock_guard lock(mutex_);
  if (stage_ != Stage::kRuns || sentNumber_ == 0 || holds_.size() >= kMaxHolds) return false;
  holds_.push_back(std::move(done));
  return wake();
}

void CameraSession::copy() {
  constexpr std::chrono::milliseconds kTurn{2};
  const auto end = std::chrono::steady_clock::now() + kTurn;
  if (!copy_) copy_ = std::make_shared<HeldMesh>();
  const auto& leaves = mesh_->leaves();
  while (copy_->leaves.size() < leaves.size()) {
    if (std::chrono::steady_clock::now() >= end) return;
    copy_->leaves.push_back(mesh_->extract(leaves[copy_->leaves.size()].address));
  }
  std::vector<Hold> holds;
  {
    const std::lock_guard lock(mutex_);
    copy_->iteration = sentNumber_;
    copy_->meshHash = sentHash_;
    copy_->settings = granted_;
    holds.swap(holds_);
  }
  copy_->camera = pose_.camera;
  copy_->effectiveThreshold = effectiveThreshold_;
  const std::shared_ptr<const HeldMesh> made = std::move(copy_);
  copy_.reset();
  for (const Hold& done : holds) done(made);
}

// As many as one task should take; the rest of what is wanted goes with the next ones.
void CameraSession::sendTiles() {
  constexpr std::size_t kTilesATask = 16;
  std::vector<terrain::TileAddress> wanted;
  {
    const std::lock_guard lock(mutex_);
    const std::size_t n = std::min(tiles_.size(), kTilesATask);
    wanted.assign(tiles_.begin(), tiles_.begin() + static_cast<std::ptrdiff_t>(n));
    tiles_.erase(tiles_.begin(), tiles_.begin() + static_cast<std::ptrdiff_t>(n));
  }
  const terrain::Raster& raster = *session_->terrain()->raster();
  wire::HeightTiles message;
  message.tiles.resize(wanted.size());
  pool_->forEach(wanted.size(), 2, [&](std::size_t k) {
    const auto tile = std::make_unique<terrain::Tile>();
    raster.tile(wanted[k], *tile);
    message.tiles[k] = {wanted[k], terrain::encodeTile(*tile)};
  });
  if (pace_.limits()) {
    std::size_t bytes = 0;
    for (const wire::HeightTile& tile : message.tiles) bytes += tile.samples.size() + 16;
    const std::lock_guard lock(mutex_);
    pace_.sent(Pace::Clock::now(), bytes, 0);
  }
  sender_->send(std::move(message));
}

void CameraSession::iterate() {
  metrics::Figures& figures = *session_->resources().figures;
  bool newPose = false, changesSettings = false;
  wire::Settings settings;
  std::uint32_t candidates = 0, candidatesBefore = 0;
  {
    const std::lock_guard lock(mutex_);
    if (!hasWork() || stage_ != Stage::kRuns || !holds_.empty() || !tiles_.empty()) return;
    if (!poses_.empty()) {
      pose_ = poses_.front();
      poses_.pop_front();
      posed_ = newPose = true;
    }
    candidatesBefore = granted_.candidates;
    for (; !changes_.empty() && (!lockstep_ || changes_.front().after < pose_.sequence); changes_.pop_front()) {
      granted_ = settings = changes_.front().granted;
      changesSettings = true;
    }
    candidates = granted_.candidates;
    if (changesSettings) pace_.setRate(settings.bytesPerSecond);
  }
  if (changesSettings) {
    mesh_->change(settings);
    if (hello_.deltas) bases_.setBudget(kBaseBytesPerTriangle * settings.triangleBudget);
    sender_->send(wire::Granted{settings});
  }
  wire::Iteration iteration;
  if (changesSettings || pace_.limits()) mesh_->setInsertionLimit(pace_.insertions());
  iteration.figures = mesh_->iterate(pose_.camera);
  countTriangles(iteration.figures.triangles);
  iteration.poseSequence = pose_.sequence;
  iteration.settled = mesh_->settled();
  effectiveThreshold_ = iteration.figures.effectiveThreshold;
  replica::Changes changes;
  {
    const std::lock_guard lock(mutex_);
    if (stage_ != Stage::kRuns) return;
    const bool tellsRest = iteration.settled && !atRest_;
    atRest_ = iteration.settled;
    if (!lockstep_ && !pace_.limits() && !iteration.settled && unsent_ < kMostUnsent && replica_.resumes(mesh_->leaves())) {
      ++unsent_;
      figures.iterated(iteration.figures);
      return;
    }
    if (!newPose && !tellsRest && candidates <= candidatesBefore && !replica_.differs(mesh_->leaves())) {
      figures.iterated(iteration.figures);
      return;
    }
    changes = replica_.send(mesh_->leaves());
    sentNumber_ = changes.number;
    sentHash_ = changes.meshHash;
  }
  iteration.number = changes.number;
  iteration.meshHash = changes.meshHash;
  const auto start = std::chrono::steady_clock::now();
  encode(changes, iteration);
  if (candidates > 0) iteration.candidates = mesh_->candidates(candidates);
  iteration.gone = std::move(changes.gone);
  iteration.figures.encodeMs = millisecondsSince(start);
  figures.iterated(iteration.figures);
  figures.iterationsSent.add();
  if (pace_.limits()) {
    std::size_t bytes = 200 + 12 * iteration.gone.size();
    for (const wire::LeafWhole& leaf : iteration.whole) bytes += leaf.payload.size() + leaf.shades.size() + 24;
    for (const wire::LeafDelta& leaf : iteration.changed) bytes += leaf.payload.size() + leaf.shades.size() + 16;
    const std::lock_guard lock(mutex_);
    pace_.sent(Pace::Clock::now(), bytes, iteration.figures.inserted);
    if (iteration.candidates) pace_.sent(Pace::Clock::now(), kBytesACandidate * iteration.candidates->size(), 0);
  }
  sender_->send(std::move(iteration));
}

namespace {

// A delta of so few bytes a triangle is shorter than any whole leaf of more than a handful of triangles: not worth the comparison.
constexpr std::size_t kSurelyCheaper = 1;
// A leaf starts from others when these have at most so many triangles for each of its own: the receiver looks at all of them.
constexpr std::size_t kMostGathered = 16;

// Of the leaf's vertices, in order, that the base does not have (same position); of all without one.
std::vector<std::uint8_t> shadesOf(const terrain::Terrain& terrain, const mesh::LeafMesh& leaf, const mesh::LeafMesh* base) {
  std::vector<lattice::Step> x, z;
  auto old = base ? base->vertices.begin() : leaf.vertices.end();
  const auto end = base ? base->vertices.end() : leaf.vertices.end();
  for (const mesh::LocalVertex& v : leaf.vertices) {  // both ascend by x, then z
    while (old != end && (old->x < v.x || (old->x == v.x && old->z < v.z))) ++old;
    if (old != end && *old == v) continue;
    x.push_back(leaf.address.x() + v.x);
    z.push_back(leaf.address.z() + v.z);
  }
  std::vector<terrain::Shade> shades(x.size());
  terrain::shadesAt(terrain, x, z, leaf.address.level, shades);
  std::vector<std::uint8_t> out;
  out.reserve(shades.size() * terrain::kShadeBytes);
  for (const terrain::Shade& s : shades)
    out.insert(out.end(), {static_cast<std::uint8_t>(s.normalX), static_cast<std::uint8_t>(s.normalZ), s.red, s.green, s.blue});
  return out;
}

}  // namespace

// Each leaf in the cheaper of its forms.
void CameraSession::encode(const replica::Changes& changes, wire::Iteration& iteration) {
  struct Encoded {
    mesh::LeafMesh leaf;
    std::vector<std::uint8_t> payload, shades;
    bool delta = false;
    float error = 0;
  };
  const terrain::Terrain& terrain = *session_->terrain();
  const bool shades = !session_->resources().limits.sendsTerrain && terrain.colours();
  const std::size_t whole = changes.whole.size(), count = whole + changes.changed.size();
  std::vector<Encoded> encoded(count);
  // Null: not all of it is known, or it is too much. Valid until the same thread asks again.
  const auto baseOf = [&](const replica::Derived& derived, std::size_t triangles) -> const mesh::LeafMesh* {
    const auto sources = std::span(changes.sources).subspan(derived.first, derived.count);
    thread_local mesh::LeafMesh base;
    if (sources.size() == 1 && sources.front() == derived.address) return bases_.find(derived.address, base) ? &base : nullptr;
    std::size_t looked = 0;
    for (const lattice::LeafAddress& source : sources) looked += bases_.triangles(source);
    if (looked > kMostGathered * triangles) return nullptr;
    std::vector<mesh::LeafMesh> meshes(sources.size());
    std::vector<const mesh::LeafMesh*> pointers;
    for (std::size_t k = 0; k < sources.size(); ++k) {
      if (!bases_.find(sources[k], meshes[k])) return nullptr;
      pointers.push_back(&meshes[k]);
    }
    base = mesh::gather(derived.address, pointers);
    return &base;
  };
  pool_->forEach(count, 2, [&](std::size_t k) {
    Encoded& out = encoded[k];
    const replica::Derived* derived = k < whole ? nullptr : &changes.changed[k - whole];
    out.leaf = mesh_->extract(derived ? derived->address : changes.whole[k]);
    if (hello_.errors) out.error = query::deviation(*session_->terrain(), out.leaf);
    if (derived && !out.leaf.triangles.empty()) {
      const mesh::LeafMesh* const base = baseOf(*derived, out.leaf.triangles.size());
      if (base && !base->triangles.empty()) {
        if (auto payload = codec::encodeDelta(*base, out.leaf, derived->hash)) {
          out.payload = std::move(*payload);
          out.delta = true;
          if (shades) out.shades = shadesOf(terrain, out.leaf, base);
          if (out.payload.size() <= kSurelyCheaper * out.leaf.triangles.size()) return;
        }
      }
    }
    auto payload = codec::encodeLeaf(out.leaf);
    if (out.delta && out.payload.size() <= payload.size()) return;
    out.payload = std::move(payload);
    out.delta = false;
    if (shades) out.shades = shadesOf(terrain, out.leaf, nullptr);
  });

  for (const lattice::LeafAddress& address : changes.gone) bases_.erase(address);
  for (Encoded& e : encoded) {
    if (e.delta)
      iteration.changed.push_back({e.leaf.address, std::move(e.payload), e.error, std::move(e.shades)});
    else
      iteration.whole.push_back({e.leaf.address, static_cast<std::uint32_t>(e.leaf.vertices.size()),
                                 static_cast<std::uint32_t>(e.leaf.triangles.size()), std::move(e.payload), e.error, std::move(e.shades)});
    if (bases_.budget() > 0) bases_.put(std::move(e.leaf));
  }
  std::sort(iteration.whole.begin(), iteration.whole.end(), [](const auto& a, const auto& b) { return a.address < b.address; });
}

}  // namespace ridgecast::session
