// Valid messages in any order, time, queues and iterations, as a conversation sees them: nothing crashes, nobody is stuck, every bound is
// kept, and a model of the client, which knows messages and leaves alone, holds the server's mesh after each iteration.
#include <algorithm>
#include <array>
#include <bitset>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "common/mesh/leaf_mesh.h"
#include "common/wire/wire.h"
#include "server/conversation/conversation.h"

namespace {

using namespace ridgecast;
using namespace std::chrono_literals;
using conversation::Conversation;
using lattice::LeafAddress;

void require(bool ok, int line = __builtin_LINE()) {
  if (ok) return;
  std::fprintf(stderr, "what line %d requires does not hold\n", line);
  std::abort();
}

class Talk {
 public:
  explicit Talk(std::span<const std::uint8_t> bytes) : bytes_(bytes), conversation_(terms()) {
    wire::Hello hello;
    const std::uint64_t how = number();
    hello.pacing = how % 2 == 0 ? wire::Pacing::kFree : wire::Pacing::kLockstep;
    hello.points = how / 2 % 2 == 0;
    hello.settings = settings(how / 4);
    isLockstep_ = how % 2 == 1;
    followsPoints_ = hello.points;
    granted_ = hello.settings;
    say(hello);
  }

  void run() {
    while (!bytes_.empty() && !conversation_.closed()) {
      act();
      judge();
    }
  }

 private:
  static constexpr std::size_t kQueue = 1000, kLeaves = 16;
  using Hashes = std::array<std::uint64_t, kLeaves>;  // of leaves; 0: none

  std::uint64_t number() {
    if (bytes_.empty()) return 0;
    const std::uint64_t out = bytes_.front();
    bytes_ = bytes_.subspan(1);
    return out;
  }

  conversation::Terms terms() {
    const std::uint64_t how = number();
    conversation::Terms out;
    out.grant = [](const wire::Settings& asked) { return asked; };
    out.window = static_cast<std::uint32_t>(1 + how % 4);
    out.maxQueuedBytes = kQueue;
    hasMap_ = how / 4 % 2 == 0;
    if (hasMap_) out.heightMap = terrain::RasterShape{.width = 100, .height = 100};
    return out;
  }
  static wire::Settings settings(std::uint64_t how) {
    wire::Settings out;
    out.threshold = 1 + static_cast<double>(how % 5);
    out.bytesPerSecond = how / 5 % 3 == 0 ? 4096 : how / 5 % 3 == 1 ? 100'000 : 0;
    out.candidates = how / 15 % 2 == 0 ? 0 : 100;
    return out;
  }
  // All leaves that there are, in canonical order.
  static LeafAddress address(std::size_t k) { return {static_cast<int>(k / 6), static_cast<std::int64_t>(k % 6) - 2, 5}; }
  static std::size_t indexOf(const LeafAddress& at) {
    const std::size_t k = static_cast<std::size_t>(at.level) * 6 + static_cast<std::size_t>(at.i + 2);
    require(k < kLeaves && address(k) == at);
    return k;
  }

  void say(const wire::ClientMessage& message, bool isTooMuch = false) {
    const auto refusal = conversation_.receive(message, now_);
    require(refusal.has_value() == isTooMuch);
    if (!refusal) return;
    require(refusal->code == wire::ErrorCode::kLimit || refusal->code == wire::ErrorCode::kInvalid);
    require(!refusal->message.empty());
    conversation_.close();
  }

  void act() {
    const std::uint64_t what = number();
    const std::uint64_t more = what / 16;
    switch (what % 16) {
      case 0:
      case 1:
        return pose(more);
      case 2:
      case 3:
        return begin();
      case 4:
      case 5:
        return finish(more);
      case 6:
      case 7:
        return acknowledge(1 + more % 2, true);
      case 8:
        return acknowledge(1 + more % 2, false);
      case 9:
        return resend(more);
      case 10:
        return newestPose_ == 0 ? resume(more) : pose(more);
      case 11:
        return want(more);
      case 12:
        return change();
      case 13:
        now_ += more < 8 ? std::chrono::milliseconds(1 << more) : std::chrono::milliseconds(10 * more);
        return;
      case 14:
        queued_ = more < 10 ? 0 : more < 13 ? kQueue : kQueue + 1;
        return;
      default:
        return others(more);
    }
  }

  // ---- messages ----

  void pose(std::uint64_t more) {
    wire::PoseMessage message;
    message.sequence = newestPose_ + 1 + more % 3;
    const bool isTooMuch = isLockstep_ && poses_.size() == conversation::kMaxQueuedPoses;
    say(message, isTooMuch);
    newestPose_ = message.sequence;
    if (!isLockstep_) poses_.clear();
    poses_.push_back(newestPose_);
  }

  void acknowledge(std::uint64_t skip, bool isRight) {
    if (unacknowledged_.empty()) return;
    while (skip-- > 1 && unacknowledged_.size() > 1) unacknowledged_.pop_front();
    const auto [sent, hash] = unacknowledged_.front();
    unacknowledged_.pop_front();
    const bool counts = !isRight && sent > judgedAfter_;
    say(wire::Acknowledge{sent, isRight ? hash : hash + 1}, counts && repairs_ == replica::kMaxRepairs);
    if (isRight) repairs_ = 0;
    if (counts) ++repairs_, askAgain({});
  }

  void askAgain(const std::vector<LeafAddress>& leaves) {
    judgedAfter_ = sent_;
    for (std::size_t k = 0; k < kLeaves; ++k)
      if (held_[k] != 0 && (leaves.empty() || std::ranges::count(leaves, address(k)))) again_[k] = true;
  }

  void resend(std::uint64_t more) {
    wire::ResendLeaves message;
    for (; more > 0; more /= 2) message.leaves.push_back(address(number() % kLeaves));
    say(message);
    askAgain(message.leaves);
  }

  void resume(std::uint64_t more) {
    wire::Resume message;
    if (more % 8 == 7) {  // only the hash, for which a client must follow points and hold no other
      message.meshHash = 1 + number();
      const bool isTooMuch = !followsPoints_ || isUnnamed_ || held_ != Hashes{};
      isUnnamed_ = hasResumed_ = true;
      return say(message, isTooMuch);
    }
    for (const std::uint64_t k : {more % kLeaves, (more + 3) % kLeaves, (more + 7) % kLeaves})
      if (std::exchange(held_[k], k + 1) == 0) message.leaves.push_back({address(k), k + 1});
    say(message, isUnnamed_);
    hasResumed_ = true;
  }

  void want(std::uint64_t more) {
    if (!hasMap_) return;
    wire::WantTiles message;
    for (std::uint64_t n = 1 + 5 * more; n > 0 && message.tiles.size() < wire::kMaxTiles; --n)
      message.tiles.push_back({static_cast<std::int64_t>(n), static_cast<std::int64_t>(more)});
    say(message, tiles_.size() + message.tiles.size() > wire::kMaxWantedTiles);
    tiles_.insert(tiles_.end(), message.tiles.begin(), message.tiles.end());
  }

  void change() {
    if (!conversation_.runs()) return;
    const wire::Settings asked = settings(number());
    if (!isLockstep_) changes_.clear();
    say(wire::ChangeSettings{asked}, changes_.size() == conversation::kMaxQueuedPoses);
    changes_.push_back({newestPose_, asked});
  }

  void others(std::uint64_t more) {
    if (!conversation_.runs()) return;
    switch (more) {
      case 0:
        return say(wire::AskClock{1});
      case 1:
        return say(wire::Query{});
      case 2:
        return say(wire::Edit{});
      case 3:
        return say(wire::StepDone{1});
      case 4:
        conversation_.sent(500, now_);
        return spend(500);
      case 5:
        return conversation_.close();
      default:
        conversation_.groundChanged();
        if (isLockstep_ || takenPose_ == 0) return;
        groundIsNew_ = true;
        rests_ = false;
        return;
    }
  }

  // ---- the server's work ----

  void begin() {
    if (isBusy()) return;
    const auto due = conversation_.due(queued_);
    if (!due || *due > now_) return;
    auto work = conversation_.next(queued_);
    require(!std::holds_alternative<std::monostate>(work));
    if (std::holds_alternative<conversation::Greet>(work)) {
      greets_ = true;
    } else if (auto* const tiles = std::get_if<conversation::SendTiles>(&work)) {
      sendTiles(tiles->tiles);
    } else {
      iterate(std::get<conversation::Iterate>(work));
    }
  }
  bool isBusy() const { return greets_ || iterating_; }

  void sendTiles(const std::vector<terrain::TileAddress>& tiles) {
    require(!tiles.empty() && tiles.size() <= conversation::kTilesAtOnce && tiles.size() <= tiles_.size());
    require(std::equal(tiles.begin(), tiles.end(), tiles_.begin()));
    tiles_.erase(tiles_.begin(), tiles_.begin() + static_cast<std::ptrdiff_t>(tiles.size()));
    wire::HeightTiles message;
    for (const terrain::TileAddress& at : tiles) message.tiles.push_back({at, std::vector<std::uint8_t>(20), {}});
    conversation_.sent(message, now_);
    spend(36 * tiles.size());
  }

  void iterate(const conversation::Iterate& work) {
    require(tiles_.empty() && unacknowledged_.size() < conversation_.replica().window() && queued_ <= kQueue);
    if (rate() != 0) require(unpaid_ <= 1);  // a byte for what is rounded
    isForGround_ = std::exchange(groundIsNew_, false) && !isForGround_;
    owes_ = isForGround_;
    if (!poses_.empty() && !isForGround_) {
      takenPose_ = poses_.front();
      poses_.pop_front();
      owes_ = true;
    }
    require(work.pose.sequence == takenPose_ && takenPose_ != 0);
    bool isChanged = false;
    for (; !changes_.empty() && (!isLockstep_ || changes_.front().first < takenPose_); changes_.pop_front()) {
      owes_ = owes_ || changes_.front().second.candidates > granted_.candidates;
      if (rate() != changes_.front().second.bytesPerSecond) unpaid_ = -1e9;  // anew: a debt stays one of time
      granted_ = changes_.front().second;
      isChanged = true;
    }
    require(work.granted.has_value() == isChanged && (!isChanged || *work.granted == granted_));
    require(conversation_.granted() == granted_);
    if (!isLockstep_) require(work.insertions && *work.insertions >= conversation::InsertionRate::kMin);
    if (isForGround_) require(*work.insertions <= conversation::kMaxForGround);
    iterating_ = true;
  }

  void finish(std::uint64_t more) {
    if (std::exchange(greets_, false)) return conversation_.greeted();
    if (!std::exchange(iterating_, false)) return;
    const std::uint64_t leaves = number() | number() << 8;
    if (more % 4 != 0) change(leaves);
    std::vector<mesh::LeafState> mesh;
    for (const mesh::LeafState& leaf : mesh_)
      if (leaf.version != 0) mesh.push_back(leaf);
    const bool settles = more / 4 % 2 == 0, comesToRest = !std::exchange(rests_, settles) && settles;
    const bool wasEmpty = held_ == Hashes{};
    const auto changes = conversation_.iterated(mesh, settles);
    const bool differs = again_.any() || held_ != hashes();
    if (!changes) {
      // Whoever resumes may wait for the detail that it had.
      const bool mayWait = hasResumed_ && sent_ == 0 && !isLockstep_ && rate() == 0 && !settles && (!wasEmpty || isUnnamed_);
      if (mayWait && ++waited_ <= conversation::kMaxUnsent) return;
      return require(!owes_ && !comesToRest && !differs);
    }
    require(owes_ || comesToRest || differs || isLockstep_);
    take(*changes);
    send(*changes, more);
  }

  void change(std::uint64_t leaves) {
    for (std::size_t k = 0; k < kLeaves - 4; ++k) {
      if ((leaves >> k & 1) == 0) continue;
      const bool goes = (leaves >> 12) % 4 == 0 && mesh_[k].version != 0;
      ++version_;
      mesh_[k] = goes ? mesh::LeafState{} : mesh::LeafState{address(k), version_, lattice::mix(version_) | 1, 1, version_};
    }
  }
  Hashes hashes() const {
    Hashes out;
    std::ranges::transform(mesh_, out.begin(), &mesh::LeafState::hash);
    return out;
  }

  // What the client does with an iteration.
  void take(const replica::Changes& changes) {
    require(changes.number == ++sent_);
    const Hashes now = hashes();
    for (const LeafAddress& at : changes.gone) require(std::exchange(held_[indexOf(at)], 0) != 0);
    for (const LeafAddress& at : changes.come) {
      require(std::exchange(held_[indexOf(at)], now[indexOf(at)]) == 0);
      again_[indexOf(at)] = false;
    }
    for (const LeafAddress& at : changes.touched) require(held_[indexOf(at)] != 0);
    for (const LeafAddress& at : changes.other) require(std::exchange(held_[indexOf(at)], now[indexOf(at)]) != 0);
    for (const LeafAddress& at : changes.whole) held_[indexOf(at)] = now[indexOf(at)], again_[indexOf(at)] = false;
    require(held_ == now);
    std::uint64_t hash = 0;
    for (std::size_t k = 0; k < kLeaves; ++k) {
      require(!again_[k] || now[k] == 0);
      if (now[k] != 0) hash += mesh::hashTerm(address(k), now[k]);
    }
    again_.reset();
    require(changes.meshHash == hash);
    unacknowledged_.emplace_back(sent_, hash);
  }

  void send(const replica::Changes& changes, std::uint64_t more) {
    wire::Iteration iteration;
    iteration.number = changes.number;
    iteration.gone = changes.gone;
    iteration.come = changes.come;
    for (const LeafAddress& at : changes.whole) iteration.whole.push_back({at, 3, 1, std::vector<std::uint8_t>(40)});
    iteration.points.resize(100 * more);
    iteration.figures.inserted = static_cast<std::uint32_t>(10 * more);
    conversation_.sent(iteration, now_);
    spend(200 + 12 * (changes.gone.size() + changes.come.size()) + 64 * changes.whole.size() + iteration.points.size());
  }

  // ---- laws ----

  std::uint64_t rate() const { return granted_.bytesPerSecond; }
  // What is sent is paid for in time; a quarter of a second may be saved up.
  void spend(std::size_t bytes) {
    pay();
    unpaid_ += static_cast<double>(bytes);
  }
  void pay() {
    const double seconds = std::chrono::duration<double>(now_ - std::exchange(paidAt_, now_)).count();
    const double most = -0.25 * static_cast<double>(rate());
    unpaid_ = rate() == 0 ? 0 : std::max(unpaid_ - seconds * static_cast<double>(rate()), most);
  }

  void judge() {
    if (conversation_.closed()) return require(!conversation_.due(0));
    pay();
    const replica::Replica& replica = conversation_.replica();
    require(replica.unacknowledged() == unacknowledged_.size() && unacknowledged_.size() <= replica.window());
    require(tiles_.size() <= wire::kMaxWantedTiles && poses_.size() <= (isLockstep_ ? conversation::kMaxQueuedPoses : 1));
    if (isBusy()) return;
    const auto due = conversation_.due(queued_);
    if (!conversation_.runs()) return require(due.has_value());
    const bool hasRoom = unacknowledged_.size() < replica.window();
    const bool wants =
        isLockstep_ ? !poses_.empty() : !poses_.empty() || (takenPose_ != 0 && (!rests_ || !changes_.empty() || again_.any()));
    require(due.has_value() == (queued_ <= kQueue && (!tiles_.empty() || (hasRoom && wants))));
    require(!due || *due < now_ + 60s);  // nobody waits for ever
  }

  std::span<const std::uint8_t> bytes_;
  bool hasMap_ = false;
  Conversation conversation_;
  Conversation::Time now_{1h};
  std::size_t queued_ = 0;
  bool isLockstep_ = false, followsPoints_ = false, hasResumed_ = false, isUnnamed_ = false;
  wire::Settings granted_;

  // What the client has said, and has not been answered.
  std::uint64_t newestPose_ = 0, takenPose_ = 0;
  std::deque<std::uint64_t> poses_;
  std::deque<std::pair<std::uint64_t, wire::Settings>> changes_;  // after which pose
  std::deque<terrain::TileAddress> tiles_;
  std::bitset<kLeaves> again_;
  // What it holds, and what was sent to it.
  Hashes held_{};
  std::deque<std::pair<std::uint64_t, std::uint64_t>> unacknowledged_;
  std::uint64_t sent_ = 0, judgedAfter_ = 0;
  int repairs_ = 0, waited_ = 0;
  // The server's work.
  std::array<mesh::LeafState, kLeaves> mesh_{};  // version 0: none
  std::uint64_t version_ = 0;
  bool greets_ = false, iterating_ = false, isForGround_ = false, groundIsNew_ = false, owes_ = false, rests_ = true;
  double unpaid_ = -1e9;  // as much as may be saved up
  Conversation::Time paidAt_ = now_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Talk({data, size}).run();
  return 0;
}
