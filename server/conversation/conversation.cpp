#include "server/conversation/conversation.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <string>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"

namespace ridgecast::conversation {

namespace {

using wire::ErrorCode;
using wire::ErrorMessage;

// A message's name in a sentence, and the earliest stage it may arrive in; by index in wire::ClientMessage.
struct Kind {
  std::string_view name;
  bool needsWorld;
};
constexpr std::array<Kind, std::variant_size_v<wire::ClientMessage>> kKinds{{{"hello", false},
                                                                             {"pose", false},
                                                                             {"acknowledgement", false},
                                                                             {"request to resend leaves", false},
                                                                             {"resume", false},
                                                                             {"question for the clock", true},
                                                                             {"clock", true},
                                                                             {"step", true},
                                                                             {"step done", true},
                                                                             {"query", true},
                                                                             {"question for the ground", true},
                                                                             {"request for tiles", false},
                                                                             {"change of settings", true},
                                                                             {"request to pass over", true},
                                                                             {"edit", true},
                                                                             {"question for edits", true},
                                                                             {"request for squares", true}}};

constexpr std::size_t kBytesACandidate = 15;  // approximately

template <class Leaves>
std::size_t payloadBytes(const Leaves& leaves, std::size_t overhead) {
  std::size_t bytes = 0;
  for (const auto& leaf : leaves) bytes += leaf.payload.size() + leaf.shades.size() + overhead;
  return bytes;
}

// Of a member that has none.
wire::Settings leastMesh(wire::Settings settings) {
  settings.triangleBudget = settings::kMinBudget;
  return settings;
}

}  // namespace

Conversation::Conversation(Terms terms) : terms_(std::move(terms)), replica_(terms_.window) {
  expects(terms_.grant && terms_.repairs && terms_.window > 0, "who converses has terms");
}

Conversation::Refusal Conversation::receive(const wire::ClientMessage& message, Time now) {
  if (auto refusal = outOfPlace(message)) return refusal;
  return std::visit(
      [&](const auto& m) {
        if constexpr (requires { this->take(m, now); })
          return take(m, now);
        else
          return take(m);
      },
      message);
}

Conversation::Refusal Conversation::outOfPlace(const wire::ClientMessage& message) const {
  const auto& [name, needsWorld] = kKinds[message.index()];
  const bool isHello = std::holds_alternative<wire::Hello>(message);
  if (stage_ == Stage::kExpectsHello && !isHello)
    return ErrorMessage{ErrorCode::kMalformed, "The first message must be a hello; a " + std::string(name) + " came first."};
  if (stage_ == Stage::kExpectsWorld && needsWorld)
    return ErrorMessage{ErrorCode::kMalformed, "A " + std::string(name) + " came before the world was sent; wait for the world."};
  return {};
}

Conversation::Refusal Conversation::take(const wire::Hello& hello) {
  if (hello.protocolVersion != wire::kProtocolVersion)
    return ErrorMessage{ErrorCode::kVersion, "This server speaks protocol version " + std::to_string(wire::kProtocolVersion) +
                                                 " and the client version " + std::to_string(hello.protocolVersion) +
                                                 ": both must be the same."};
  if (stage_ != Stage::kExpectsHello) return ErrorMessage{ErrorCode::kMalformed, "A second hello came; a connection has exactly one."};
  requested_ = hello.placesOnly ? leastMesh(hello.settings) : hello.settings;
  granted_ = terms_.grant(requested_);
  byteRate_.setRate(granted_.bytesPerSecond);
  replica_.setFollowsPoints(hello.points);
  hello_ = hello;
  stage_ = Stage::kExpectsWorld;
  return {};
}

Conversation::Refusal Conversation::take(const wire::PoseMessage& pose, Time now) {
  if (pose.sequence <= lastSequence_)
    return ErrorMessage{ErrorCode::kInvalid, "Pose " + std::to_string(pose.sequence) + " came after pose " + std::to_string(lastSequence_) +
                                                 ": sequences start at 1 and ascend."};
  if (lockstep() && poses_.size() >= kMaxQueuedPoses)
    return ErrorMessage{ErrorCode::kLimit, "More than " + std::to_string(kMaxQueuedPoses) +
                                               " poses wait in lock-step: send the next one when iterations have arrived."};
  lastSequence_ = pose.sequence;
  if (!lockstep()) poses_.clear();
  poses_.push_back(pose);
  insertionRate_.pose(now);
  return {};
}

Conversation::Refusal Conversation::take(const wire::Acknowledge& acknowledge) {
  const std::string iteration = "Iteration " + std::to_string(acknowledge.iteration);
  switch (replica_.acknowledge(acknowledge.iteration, acknowledge.meshHash)) {
    case replica::Verdict::kAgrees:
      return {};
    case replica::Verdict::kRepairs:
      ++mismatches_;
      return {};
    case replica::Verdict::kNeverSent:
      return ErrorMessage{ErrorCode::kInvalid, iteration + " was acknowledged but never sent."};
    case replica::Verdict::kOutOfOrder:
      return ErrorMessage{ErrorCode::kInvalid, iteration + " was acknowledged before; acknowledgements ascend."};
    case replica::Verdict::kHopeless:
      ++mismatches_;
      break;
  }
  return ErrorMessage{ErrorCode::kInvalid, "The client's mesh differs even after everything was sent again " +
                                               std::to_string(replica::kMaxRepairs) + " times: it must start afresh."};
}

Conversation::Refusal Conversation::take(const wire::Resume& resume) {
  if (lastSequence_ != 0)
    return ErrorMessage{ErrorCode::kMalformed, "A resume came after a pose; it belongs between hello and the first pose."};
  if (resume.meshHash != 0) {
    if (hello_.points && resume.leaves.empty() && replica_.resume(resume.meshHash)) return {};
    return ErrorMessage{ErrorCode::kInvalid,
                        "A resume says the hash of leaves that it does not name: only a client that follows points may, "
                        "once, and without naming others."};
  }
  if (!replica_.resume(resume.leaves))
    return ErrorMessage{ErrorCode::kInvalid, "A resume names a leaf twice, or more than " + std::to_string(wire::kMaxResumed) + " in all."};
  return {};
}

Conversation::Refusal Conversation::take(const wire::WantTiles& request) {
  if (!terms_.heightMap) return ErrorMessage{ErrorCode::kInvalid, "Tiles were requested, but this world has no height map."};
  if (tiles_.size() + request.tiles.size() > wire::kMaxWantedTiles)
    return ErrorMessage{ErrorCode::kLimit,
                        "More than " + std::to_string(wire::kMaxWantedTiles) + " tiles wait to be sent; request fewer at a time."};
  for (const terrain::TileAddress& tile : request.tiles)
    if (!terrain::tileIsValid(*terms_.heightMap, tile))
      return ErrorMessage{ErrorCode::kInvalid, "A requested tile lies beyond the lattice."};
  tiles_.insert(tiles_.end(), request.tiles.begin(), request.tiles.end());
  return {};
}

Conversation::Refusal Conversation::take(const wire::FindEdits& find) {
  if (!terms_.sendsEdits) return ErrorMessage{ErrorCode::kInvalid, "Edits were asked for, but this world's terrain is private."};
  if (finds_.size() >= wire::kMaxFinds)
    return ErrorMessage{ErrorCode::kLimit, "More than " + std::to_string(wire::kMaxFinds) +
                                               " questions for edits wait: send the next when an answer has arrived."};
  finds_.push_back(find);
  return {};
}

Conversation::Refusal Conversation::take(const wire::WantSquares& request) {
  if (!terms_.sendsEdits) return ErrorMessage{ErrorCode::kInvalid, "Squares were requested, but this world's terrain is private."};
  if (squares_.size() + request.squares.size() > wire::kMaxWantedSquares)
    return ErrorMessage{ErrorCode::kLimit,
                        "More than " + std::to_string(wire::kMaxWantedSquares) + " squares wait to be sent; request fewer at a time."};
  squares_.insert(squares_.end(), request.squares.begin(), request.squares.end());
  return {};
}

Conversation::Refusal Conversation::take(const wire::ChangeSettings& change) {
  if (!lockstep()) changes_.clear();
  if (changes_.size() >= kMaxQueuedPoses)
    return ErrorMessage{ErrorCode::kLimit, "More than " + std::to_string(kMaxQueuedPoses) +
                                               " changes of settings wait for their poses: change them when iterations have arrived."};
  if (hello_.placesOnly) return {};
  requested_ = change.settings;
  changes_.push_back({lastSequence_, terms_.grant(requested_)});
  return {};
}

void Conversation::grantAgain() {
  expects(runs() && !lockstep(), "in lock-step only the client decides what its iterations are");
  changes_.assign(1, {lastSequence_, terms_.grant(requested_)});
}

void Conversation::close() {
  stage_ = Stage::kClosed;
  poses_.clear();
}

void Conversation::groundChanged() {
  if (lockstep() || !runs() || pose_.sequence == 0) return;
  atRest_ = false;
  groundIsNew_ = true;
}

bool Conversation::hasWork(std::size_t queuedBytes) const {
  if (!runs()) return stage_ == Stage::kExpectsWorld;
  if (queuedBytes > terms_.maxQueuedBytes) return false;
  return !tiles_.empty() || hasEdits() || hasIteration();
}

bool Conversation::hasIteration() const {
  if (hello_.placesOnly || !replica_.hasRoom() || awaitsCheckpoint_ || leaves_) return false;
  if (lockstep()) return !poses_.empty();
  return !poses_.empty() || (pose_.sequence != 0 && (!atRest_ || !changes_.empty() || replica_.owes()));
}

std::optional<Conversation::Time> Conversation::due(std::size_t queuedBytes) const {
  if (!hasWork(queuedBytes)) return {};
  if (!runs()) return Time::min();
  return std::max(byteRate_.limits() ? byteRate_.free() : Time::min(), replica_.owes() ? terms_.repairs->free() : Time::min());
}

Work Conversation::next(std::size_t queuedBytes) {
  if (!hasWork(queuedBytes)) return {};
  if (!runs()) return Greet{};
  if (!tiles_.empty()) {
    const auto end = tiles_.begin() + static_cast<std::ptrdiff_t>(std::min(tiles_.size(), kTilesAtOnce));
    SendTiles work{{tiles_.begin(), end}};
    tiles_.erase(tiles_.begin(), end);
    return work;
  }
  if (hasEdits() && !(editsWait_ && hasIteration())) {
    editsWait_ = true;
    if (!finds_.empty()) {
      const wire::FindEdits find = finds_.front();
      finds_.pop_front();
      return find;
    }
    const auto end = squares_.begin() + static_cast<std::ptrdiff_t>(std::min(squares_.size(), kSquaresAtOnce));
    SendSquares work{{squares_.begin(), end}};
    squares_.erase(squares_.begin(), end);
    return work;
  }
  editsWait_ = false;
  expects(lockstep() || poses_.size() <= 1, "the newest pose wins");
  current_.isForGround = std::exchange(groundIsNew_, false) && !current_.isForGround;
  current_.owesAnswer = current_.isForGround || !poses_.empty();
  if (!poses_.empty() && !current_.isForGround) {
    pose_ = poses_.front();
    poses_.pop_front();
  }
  Iterate work{pose_, {}, {}, {}};
  const std::uint32_t candidates = granted_.candidates;
  for (; !changes_.empty() && (!lockstep() || changes_.front().after < pose_.sequence); changes_.pop_front())
    work.granted = granted_ = changes_.front().granted;
  current_.owesAnswer = current_.owesAnswer || granted_.candidates > candidates;
  if (work.granted) byteRate_.setRate(granted_.bytesPerSecond);
  if (lockstep()) {
    if (work.granted || byteRate_.limits()) work.insertions = byteRate_.insertions();
  } else {
    if (!current_.isForGround) insertionRate_.begin();
    work.insertions =
        std::min({byteRate_.insertions(), insertionRate_.insertions(), current_.isForGround ? kMaxForGround : InsertionRate::kMax});
    work.isHurried = insertionRate_.insertions() <= *work.insertions;
  }
  return work;
}

void Conversation::greeted() {
  expects(stage_ == Stage::kExpectsWorld || closed(), "a world answers a hello, once");
  if (stage_ == Stage::kExpectsWorld) stage_ = Stage::kRuns;
}

void Conversation::restored(std::span<const mesh::LeafState> leaves) {
  replica_.restore(leaves);
  unsent_ = kMaxUnsent;
}

std::optional<replica::Changes> Conversation::iterated(std::span<const mesh::LeafState> leaves, bool settled) {
  if (!runs()) return {};
  assert(std::ranges::is_sorted(leaves, {}, &mesh::LeafState::address));
  expects(pose_.sequence != 0, "an iteration is for a pose");
  const bool comesToRest = settled && !atRest_;
  atRest_ = settled;
  if (!lockstep() && !byteRate_.limits() && !settled && unsent_ < kMaxUnsent && replica_.resumes(leaves)) {
    ++unsent_;
    return {};
  }
  if (!current_.owesAnswer && !comesToRest && !replica_.differs(leaves)) return {};
  current_.repairs = replica_.owes();
  return replica_.send(leaves);
}

void Conversation::sent(const wire::Iteration& iteration, Time now) {
  expects(iteration.number == replica_.lastSent(), "what was sent is the last iteration");
  byteRate_.sent(now,
                 200 + 12 * (iteration.gone.size() + iteration.come.size()) + payloadBytes(iteration.whole, 24) + iteration.points.size() +
                     iteration.shades.size() + 4 * iteration.errors.size(),
                 iteration.figures.inserted);
  insertionRate_.sent(now, iteration.figures.inserted);
  if (current_.repairs) terms_.repairs->spend(now, payloadBytes(iteration.whole, 24));
  if (iteration.candidates) sent(kBytesACandidate * iteration.candidates->size(), now);
}

void Conversation::sent(const wire::HeightTiles& tiles, Time now) {
  std::size_t bytes = 0;
  for (const wire::HeightTile& tile : tiles.tiles) bytes += tile.samples.size() + tile.colours.size() + 16;
  sent(bytes, now);
}

}  // namespace ridgecast::conversation
