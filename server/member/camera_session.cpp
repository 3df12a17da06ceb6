#include "server/member/camera_session.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <optional>
#include <utility>

#include "common/outcome/contract.h"
#include "common/terrain/raster.h"
#include "common/wire/wire.h"
#include "server/memory/memory.h"
#include "server/pipeline/pipeline.h"
#include "server/recording/events.h"
#include "server/replica/replica.h"

namespace ridgecast::member {

namespace {

using wire::ErrorCode;
using wire::ErrorMessage;

double millisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

// A closed camera leaves freed memory scattered in the allocator's arenas, which keep it until told. Returning it takes milliseconds: once
// for all cameras that close within a second.
void giveMemoryBackSoon(const session::Resources& resources) {
  if (resources.givesMemoryBack.exchange(true)) return;
  resources.timer->at(resources.timer->now() + std::chrono::seconds(1), [&resources] {  // the resources own the timer
    resources.givesMemoryBack = false;
    memory::giveBack();
  });
}

wire::Settings grant(const wire::Settings& requested, const session::Limits& limits, bool hasColours, session::CameraQuota::Share& quota) {
  wire::Settings out = pipeline::grant(requested, limits.mesh);
  if (!hasColours) out.colourError = 0;
  out.triangleBudget = quota.grant(out.triangleBudget);
  const std::uint64_t most = limits.maxBytesPerSecond;
  if (out.bytesPerSecond == 0 || (most != 0 && out.bytesPerSecond > most)) out.bytesPerSecond = most;
  if (out.bytesPerSecond != 0) out.bytesPerSecond = std::max(out.bytesPerSecond, session::kMinBytesPerSecond);
  return out;
}

conversation::Terms termsOf(const session::Session& session, const session::Membership& member) {
  const session::Limits& limits = session.resources().limits;
  const bool hasColours = static_cast<bool>(session.terrain()->colours());
  conversation::Terms terms{
      [limits, hasColours, quota = member.quota](const wire::Settings& requested) { return grant(requested, limits, hasColours, *quota); },
      limits.window,
      limits.maxQueuedBytes,
      {},
      {member.budgets, &member.budgets->repairs}};
  const auto terrain = session.terrain();
  if (const terrain::Raster* raster = terrain->raster(); raster && limits.sendsTerrain) terms.heightMap = raster->shape();
  terms.sendsEdits = limits.sendsTerrain;
  return terms;
}

wire::World worldOf(const session::Session& session, const wire::Settings& granted, std::uint64_t camera, const std::string& key) {
  const auto ground = session.ground();
  const terrain::Terrain& terrain = *ground.terrain;
  const session::Resources& resources = session.resources();
  wire::World world;
  world.edit = ground.edit;
  world.compacted = session.edits().compacted();
  world.serverName = resources.serverName;
  world.session = session.name();
  world.terrainName = terrain.name();
  if (resources.limits.sendsTerrain) {
    world.terrainSource = terrain.source();
    if (terrain.raster()) world.heightMap = terrain.raster()->shape();
  } else {
    world.shadedVertices = static_cast<bool>(terrain.colours());
  }
  for (const std::string& material : terrain.ownMaterials()) world.materials += (world.materials.empty() ? "" : " ") + material;
  world.known = terrain.relief().known;
  world.seed = terrain.seed();
  world.contentHash = session.contentHash();
  world.horizon = pipeline::Pipeline::kHorizon;
  world.settings = granted;
  world.window = resources.limits.window;
  world.camera = camera;
  world.resumeKey = key;
  return world;
}

// What keeps the mesh from its threshold, as the next iteration's room (pipeline).
metrics::Withheld withheldBy(const settings::IterationStats& figures, const wire::Settings& granted, bool isHurried) {
  if (figures.effectiveThreshold <= granted.threshold) return metrics::Withheld::kNone;
  const std::uint32_t budgeted = granted.triangleBudget > figures.triangles ? (granted.triangleBudget - figures.triangles) / 2 : 0;
  if (budgeted < figures.insertionLimit) return metrics::Withheld::kTriangles;
  return isHurried ? metrics::Withheld::kProcessor : metrics::Withheld::kBytes;
}

void noteQuestion(const session::Session& session, std::uint64_t camera, std::size_t places, const wire::ClientMessage& question) {
  recording::Asked asked{camera, static_cast<std::uint32_t>(places)};
  if (places <= 64) asked.message = wire::encode(question);
  if (asked.message.size() > recording::Asked::kMaxBytes) asked.message.clear();
  session.note(std::move(asked));
}

}  // namespace

CameraSession::CameraSession(std::shared_ptr<session::Session> session, session::Membership membership, std::uint64_t id,
                             std::shared_ptr<conversation::Sender> sender)
    : session_(std::move(session)),
      membership_(std::move(membership)),
      id_(id),
      sender_(std::move(sender)),
      pool_(session_->resources().executor->makePool(0, membership_.client)),
      conversation_(termsOf(*session_, membership_)),
      figures_(session_->resources().figures, *session_->resources().timer) {
  expects(sender_ && membership_.quota && id_ != 0, "a camera is a member with a number, and a way to its client");
}

void CameraSession::receive(wire::ClientMessage message) {
  const std::lock_guard lock(mutex_);
  if (conversation_.closed()) return;
  metrics::Metrics& all = *session_->resources().figures;
  const std::uint64_t mismatches = conversation_.mismatches();
  Refusal refusal = conversation_.receive(message, session_->resources().timer->now());
  all.mismatches.Increment(static_cast<double>(conversation_.mismatches() - mismatches));
  if (std::holds_alternative<wire::ResendLeaves>(message)) all.resends.Increment();
  if (const auto* pose = std::get_if<wire::PoseMessage>(&message); pose && !refusal) figures_.arrived(pose->sequence);
  if (!refusal) refusal = std::visit([this](auto& m) { return attend(m); }, message);
  if (std::holds_alternative<wire::ChangeSettings>(message) && !refusal) watchRoom();
  if (!refusal && !wake()) refusal = ErrorMessage{ErrorCode::kInternal, "The server is shutting down."};
  if (refusal) refuse(std::move(*refusal));
}

CameraSession::Refusal CameraSession::attend(const wire::ClockStep& step) {
  const clock::Clock::Stepped stepped = session_->presence().step(id_, step);
  std::string why = clock::sentenceOf(stepped);  // of kNotYours none: that is answered with the clock, which names its owner
  if (why.empty()) return {};
  return ErrorMessage{stepped == clock::Clock::Stepped::kTooMany ? ErrorCode::kLimit : ErrorCode::kInvalid, std::move(why)};
}

CameraSession::Refusal CameraSession::attend(const wire::StepDone& done) {
  session_->presence().done(id_, done);
  return {};
}

CameraSession::Refusal CameraSession::attend(wire::Query& query) {
  if (session_->observer()) noteQuestion(*session_, id_, query.rays.size() + query.x.size(), query);
  if (!queries_) queries_ = std::make_shared<questions::Queries>(session_, sender_, membership_.budgets);
  if (queries_->ask(std::move(query))) return {};
  return ErrorMessage{ErrorCode::kLimit, "More than " + std::to_string(wire::kMaxQueries) +
                                             " queries wait for their answers: send the next when one has arrived."};
}

CameraSession::Refusal CameraSession::attend(const wire::AskGround& ask) {
  if (session_->observer()) noteQuestion(*session_, id_, 1, ask);
  const std::uint32_t most =
      conversation_.hello().placesOnly ? session_->resources().limits.mesh.defaultBudget : conversation_.granted().triangleBudget;
  if (!grounds_)
    grounds_ = std::make_shared<questions::Grounds>([session = session_] { return session->ground(); }, most,
                                                    session_->resources().queryQueues().grounds, sender_, questions::Grounds::kTimeout,
                                                    session_->resources().limits.turn);
  if (grounds_->ask(ask)) return {};
  return ErrorMessage{ErrorCode::kLimit,
                      "More than " + std::to_string(wire::kMaxGrounds) + " grounds are open; request the next when one has arrived."};
}

void CameraSession::close() {
  const std::lock_guard lock(mutex_);
  end();
}

void CameraSession::end() {
  conversation_.close();
  session_->presence().leave(id_);
  session_->live().remove(id_);
  if (grounds_) grounds_->close();
  grounds_.reset();
  if (queries_) queries_->close();
  queries_.reset();
  wake();
}

void CameraSession::refuse(ErrorMessage message) {
  end();
  sender_->fail(std::move(message));
}

bool CameraSession::wake() {
  if (scheduled_) return true;
  if (!conversation_.closed() && copies_.empty() && !handOver_ && resume_.key.empty()) {
    const scheduling::Timer& timer = *session_->resources().timer;
    auto due = conversation_.due(sender_->queuedBytes());
    // Answers and tiles may be what is queued, and nobody tells when they have left.
    if (!due && conversation_.due(0)) due = timer.now() + kQueueRetry;
    if (!due) return watchAcknowledgements(), true;
    if (*due > timer.now()) return workAlarm_.set(timer, *due, weak_from_this(), mutex_, &CameraSession::wake), true;
  }
  scheduled_ = pool_->post([self = shared_from_this()] { self->run(); });
  return scheduled_;
}

void CameraSession::watchAcknowledgements() {
  if (!conversation_.runs() || conversation_.replica().hasRoom()) return;
  const scheduling::Timer::Time now = session_->resources().timer->now();
  if (std::exchange(watched_.iteration, conversation_.replica().lastSent()) != conversation_.replica().lastSent()) watched_.since = now;
  if (now < watched_.since + kAcknowledgeTimeout)
    return watched_.alarm.set(*session_->resources().timer, watched_.since + kAcknowledgeTimeout, weak_from_this(), mutex_,
                              &CameraSession::watchAcknowledgements);
  refuse({ErrorCode::kLimit, "No iteration was acknowledged for " + std::to_string(kAcknowledgeTimeout.count()) +
                                 " minutes: no other is sent before; acknowledge each when it was applied."});
}

void CameraSession::watchRoom() {
  const scheduling::Timer& timer = *session_->resources().timer;
  const std::uint32_t wanted = pipeline::grant(conversation_.requested(), session_->resources().limits.mesh).triangleBudget;
  if (!conversation_.runs() || conversation_.isLockstep() || conversation_.newestGrant().triangleBudget >= wanted) return;
  room_.alarm.set(timer, timer.now() + kSeeksRoom, weak_from_this(), mutex_, &CameraSession::seekRoom);
}

void CameraSession::seekRoom() {
  if (!conversation_.runs()) return;
  const std::uint32_t wanted = pipeline::grant(conversation_.requested(), session_->resources().limits.mesh).triangleBudget,
                      granted = conversation_.newestGrant().triangleBudget;
  const bool isThere = granted < wanted && membership_.quota->offer(wanted) >= std::min<std::uint64_t>(wanted, 2ull * granted);
  if (std::exchange(room_.isThere, isThere) && isThere) {
    conversation_.grantAgain();
    room_.isThere = false;
    wake();
  }
  watchRoom();
}

void CameraSession::run() {
  bool failed = false;
  try {
    std::unique_lock lock(mutex_);
    expects(scheduled_, "one task runs at a time, and was scheduled");
    const bool copies = !copies_.empty() && conversation_.runs(), leaves = handOver_ && conversation_.runs();
    const bool looksUp = !resume_.key.empty() && !conversation_.closed();
    const auto due = conversation_.due(sender_->queuedBytes());  // messages that came since may have put it off
    const bool isDue = due && *due <= session_->resources().timer->now();
    const bool isOther = copies || leaves || looksUp;
    const conversation::Work next = isOther || !isDue ? conversation::Work{} : conversation_.next(sender_->queuedBytes());
    lock.unlock();
    if (looksUp)
      lookUpCheckpoint();
    else if (leaves)
      workOnHandOver();
    else if (copies)
      workOnCopy();
    else
      std::visit([this](const auto& order) { work(order); }, next);
  } catch (const std::exception& e) {
    failed = true;
    task_ = {};  // first, so that the refusal finds memory
    const std::lock_guard lock(mutex_);
    refuse(conversation::failureOf(e));
  }
  // Moved out under the lock, because another task may follow; destroyed after unlocking.
  Task freed;
  std::vector<session::TakeCopy> disappointed;
  {
    const std::lock_guard lock(mutex_);
    scheduled_ = false;
    if (!conversation_.closed()) {
      wake();
      return;
    }
    freed = std::exchange(task_, {});
    disappointed.swap(copies_);
    figures_.holds(0, metrics::Withheld::kNone);
  }
  for (const session::TakeCopy& done : disappointed) done(nullptr);
  if (!freed.mesh && !failed) return;
  session_->note(recording::Left{id_});
  giveMemoryBackSoon(session_->resources());
}

void CameraSession::work(const conversation::Greet&) {
  expects(!task_.mesh, "a client is greeted once");
  task_.ground = session_->ground();
  const auto& terrain = task_.ground.terrain;
  const wire::Hello& hello = conversation_.hello();
  const wire::Settings& granted = conversation_.granted();
  const bool shades = !session_->resources().limits.sendsTerrain && terrain->colours();
  if (!hello.placesOnly) {
    task_.mesh = session_->resources().makeMesh(terrain, granted, pool_);
    task_.encoder = std::make_unique<encoding::Encoder>(terrain, pool_, encoding::Form{hello.points, hello.errors, shades});
    session_->note(recording::Joined{id_, hello.clientName, hello.role, hello.pacing, granted, task_.ground.edit});
  }
  // Under the lock: once it has received the world, a client may send anything.
  const std::lock_guard lock(mutex_);
  chooseKey();
  conversation_.greeted();
  if (!conversation_.runs()) return;
  session_->use();
  session_->live().add(id_, weak_from_this());
  session_->presence().join(id_, hello, sender_, conversation_.newestPose(), worldOf(*session_, granted, id_, key_));
  session_->presence().setBudget(id_, granted.bytesPerSecond);
  news_.told = std::max(hello.editsAfter, session_->edits().compacted());
  tellEdits();
  watchRoom();
}

void CameraSession::goAway() { sender_->fail({ErrorCode::kGoingAway, "The session begins again; connect again.", {}}); }

bool CameraSession::copy(session::TakeCopy done) {
  expects(done != nullptr, "a copy goes to somebody");
  const std::lock_guard lock(mutex_);
  if (!conversation_.runs() || conversation_.replica().lastSent() == 0 || copies_.size() >= kMaxCopies) return false;
  copies_.push_back(std::move(done));
  return wake();
}

void CameraSession::workOnCopy() {
  expects(task_.mesh != nullptr, "what is copied is there");
  const scheduling::Timer& timer = *session_->resources().timer;
  const auto end = timer.now() + session_->resources().limits.turn;
  if (!task_.copy) task_.copy = std::make_shared<session::MeshCopy>();
  const auto& leaves = task_.mesh->leaves();
  while (task_.copy->leaves.size() < leaves.size()) {
    if (timer.now() >= end) return;
    task_.copy->leaves.push_back(task_.mesh->extract(leaves[task_.copy->leaves.size()].address));
  }
  std::vector<session::TakeCopy> copies;
  {
    const std::lock_guard lock(mutex_);
    task_.copy->iteration = conversation_.replica().lastSent();
    task_.copy->meshHash = conversation_.replica().meshHash();
    task_.copy->settings = conversation_.granted();
    task_.copy->camera = conversation_.pose().camera;
    copies.swap(copies_);
  }
  task_.copy->effectiveThreshold = task_.effectiveThreshold;
  task_.copy->ground = task_.ground;
  const std::shared_ptr<const session::MeshCopy> made = std::exchange(task_.copy, nullptr);
  for (const session::TakeCopy& done : copies) done(made);
}

void CameraSession::work(const conversation::SendTiles& wanted) {
  const auto terrain = session_->terrain();
  expects(terrain->raster(), "tiles are those of a height map");
  const terrain::Raster& raster = *terrain->raster();
  wire::HeightTiles message;
  message.tiles.resize(wanted.tiles.size());
  pool_->forEach(wanted.tiles.size(), 2, [&](std::size_t k) {
    const auto tile = std::make_unique<terrain::Tile>();
    raster.tile(wanted.tiles[k], *tile);
    message.tiles[k] = {wanted.tiles[k], terrain::encodeTile(*tile), raster.tileColours(wanted.tiles[k])};
  });
  {
    const std::lock_guard lock(mutex_);
    conversation_.sent(message, session_->resources().timer->now());
  }
  sender_->send(std::move(message));
}

std::vector<lattice::Area> CameraSession::followGround() {
  auto [ground, changed] = session_->edits().since(task_.ground.edit);
  if (ground.edit == task_.ground.edit) return {};
  expects(ground.edit > task_.ground.edit, "ground goes on");
  task_.ground = std::move(ground);
  task_.mesh->setGround(task_.ground.terrain, changed);
  task_.encoder->setTerrain(task_.ground.terrain);
  return std::move(changed);
}

void CameraSession::work(const conversation::Iterate& order) {
  expects(task_.mesh && task_.encoder, "a camera iterates once its client is greeted");
  metrics::Metrics& figures = *session_->resources().figures;
  if (order.granted) {
    task_.mesh->change(*order.granted);
    session_->presence().setBudget(id_, order.granted->bytesPerSecond);
    sender_->send(wire::Granted{*order.granted});
  }
  if (order.insertions) task_.mesh->setInsertionLimit(*order.insertions);
  std::vector<lattice::Area> changed;
  wire::Iteration iteration;
  if (const auto restored = restore(order.pose.camera)) {
    iteration.figures = *restored;
  } else {
    changed = followGround();
    iteration.figures = task_.mesh->iterate(order.pose.camera);
  }
  iteration.edit = task_.ground.edit;
  figures_.holds(iteration.figures.triangles, withheldBy(iteration.figures, conversation_.granted(), order.isHurried));
  iteration.poseSequence = order.pose.sequence;
  iteration.settled = task_.mesh->settled();
  task_.effectiveThreshold = iteration.figures.effectiveThreshold;
  std::optional<replica::Changes> changes;
  std::uint32_t candidates = 0;
  {
    const std::lock_guard lock(mutex_);
    changes = conversation_.iterated(task_.mesh->leaves(), iteration.settled);
    candidates = conversation_.granted().candidates;
  }
  if (session_->observer())
    session_->note(recording::Iterated{id_, order.granted, iteration.figures.insertionLimit, task_.ground.edit, std::move(changed),
                                       order.pose.sequence, order.pose.camera, iteration.settled,
                                       changes ? changes->meshHash : recording::hashOf(task_.mesh->leaves())});
  if (!changes) return figures.iterated(iteration.figures);
  const auto start = std::chrono::steady_clock::now();
  task_.encoder->encode(std::move(*changes), *task_.mesh, iteration);
  if (candidates > 0) iteration.candidates = task_.mesh->candidates(candidates);
  iteration.figures.encodeMs = millisecondsSince(start);
  figures.iterated(iteration.figures);
  bool late = false;
  {
    const std::lock_guard lock(mutex_);
    const auto now = session_->resources().timer->now();
    conversation_.sent(iteration, now);
    conversation_.sent(session_->presence().takeBytes(id_), now);
    late = conversation_.isLate();
  }
  const std::uint64_t pose = iteration.poseSequence;
  sender_->send(std::move(iteration), figures_.sent(pose, late));
}

}  // namespace ridgecast::member
