// Valid messages in any order, time, queues and iterations, as a conversation sees them: nothing crashes, nobody is stuck, every bound is
// kept, and a model of the client, which knows messages and leaves alone, holds the server's mesh after each iteration.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <map>
#include <optional>
#include <set>
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
  static constexpr std::size_t kQueue = 1000;

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
    if (hasMap_) out.heightMap = terrain::RasterShape{.pitch = 256, .width = 100, .height = 100};
    return out;
  }
  static wire::Settings settings(std::uint64_t how) {
    wire::Settings out;
    out.threshold = 1 + static_cast<double>(how % 5);
    out.bytesPerSecond = how / 5 % 3 == 0 ? 4096 : how / 5 % 3 == 1 ? 100'000 : 0;
    out.candidates = how / 15 % 2 == 0 ? 0 : 100;
    return out;
  }
  static LeafAddress address(std::uint64_t k) { return {static_cast<int>(k % 3), static_cast<std::int64_t>(k / 3) - 2, 5}; }

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
    for (const auto& [at, hash] : held_)
      if (leaves.empty() || std::ranges::count(leaves, at)) again_.insert(at);
  }

  void resend(std::uint64_t more) {
    wire::ResendLeaves message;
    for (; more > 0; more /= 2) message.leaves.push_back(address(number() % 16));
    say(message);
    askAgain(message.leaves);
  }

  void resume(std::uint64_t more) {
    wire::Resume message;
    for (const std::uint64_t at : {more, more + 3, more + 7})
      if (held_.emplace(address(at), at + 1).second) message.leaves.push_back({address(at), at + 1});
    say(message);
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
    if (!isLockstep_) require(work.insertions && *work.insertions >= conversation::Tempo::kLeast);
    if (isForGround_) require(*work.insertions <= conversation::kMostForGround);
    iterating_ = true;
  }

  void finish(std::uint64_t more) {
    if (std::exchange(greets_, false)) return conversation_.greeted();
    if (!std::exchange(iterating_, false)) return;
    const std::uint64_t leaves = number() | number() << 8;
    if (more % 4 != 0) change(leaves);
    std::vector<mesh::LeafState> mesh;
    for (const auto& [at, leaf] : mesh_) mesh.push_back(leaf);
    const bool settles = more / 4 % 2 == 0, comesToRest = !std::exchange(rests_, settles) && settles;
    const bool wasEmpty = held_.empty();
    const auto changes = conversation_.iterated(mesh, settles);
    const bool differs = !again_.empty() || held_ != hashes();
    if (!changes) {
      // Whoever resumes may wait for the detail that it had.
      const bool mayWait = hasResumed_ && sent_ == 0 && !isLockstep_ && rate() == 0 && !settles && !wasEmpty;
      if (mayWait && ++waited_ <= conversation::kMostUnsent) return;
      return require(!owes_ && !comesToRest && !differs);
    }
    require(owes_ || comesToRest || differs || isLockstep_);
    take(*changes);
    send(*changes, more);
  }

  void change(std::uint64_t leaves) {
    for (std::uint64_t k = 0; k < 12; ++k) {
      if ((leaves >> k & 1) == 0) continue;
      const LeafAddress at = address(k);
      if ((leaves >> 12) % 4 == 0 && mesh_.erase(at) != 0) continue;
      ++version_;
      mesh_[at] = {at, version_, lattice::mix(version_), 1, version_};
    }
  }
  std::map<LeafAddress, std::uint64_t> hashes() const {
    std::map<LeafAddress, std::uint64_t> out;
    for (const auto& [at, leaf] : mesh_) out[at] = leaf.hash;
    return out;
  }

  // What the client does with an iteration.
  void take(const replica::Changes& changes) {
    require(changes.number == ++sent_);
    for (const LeafAddress& at : changes.gone) require(held_.erase(at) == 1);
    for (const LeafAddress& at : changes.come) require(held_.emplace(at, mesh_.at(at).hash).second);
    for (const LeafAddress& at : changes.touched) require(held_.contains(at));
    for (const LeafAddress& at : changes.other) require(held_.contains(at)), held_[at] = mesh_.at(at).hash;
    for (const LeafAddress& at : changes.whole) held_[at] = mesh_.at(at).hash, again_.erase(at);
    require(std::ranges::none_of(again_, [&](const LeafAddress& at) { return mesh_.contains(at); }));
    again_.clear();
    require(held_ == hashes());
    std::uint64_t hash = 0;
    for (const auto& [at, leaf] : held_) hash += mesh::hashTerm(at, leaf);
    require(changes.meshHash == hash);
    unacknowledged_.emplace_back(sent_, hash);
  }

  void send(const replica::Changes& changes, std::uint64_t more) {
    wire::Iteration iteration;
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
        isLockstep_ ? !poses_.empty() : !poses_.empty() || (takenPose_ != 0 && (!rests_ || !changes_.empty() || !again_.empty()));
    require(due.has_value() == (queued_ <= kQueue && (!tiles_.empty() || (hasRoom && wants))));
    require(!due || *due < now_ + 60s);  // nobody waits for ever
  }

  std::span<const std::uint8_t> bytes_;
  bool hasMap_ = false;
  Conversation conversation_;
  Conversation::Time now_{1h};
  std::size_t queued_ = 0;
  bool isLockstep_ = false, hasResumed_ = false;
  wire::Settings granted_;

  // What the client has said, and has not been answered.
  std::uint64_t newestPose_ = 0, takenPose_ = 0;
  std::deque<std::uint64_t> poses_;
  std::deque<std::pair<std::uint64_t, wire::Settings>> changes_;  // after which pose
  std::deque<terrain::TileAddress> tiles_;
  std::set<LeafAddress> again_;
  // What it holds, and what was sent to it.
  std::map<LeafAddress, std::uint64_t> held_;  // hashes
  std::deque<std::pair<std::uint64_t, std::uint64_t>> unacknowledged_;
  std::uint64_t sent_ = 0, judgedAfter_ = 0;
  int repairs_ = 0, waited_ = 0;
  // The server's work.
  std::map<LeafAddress, mesh::LeafState> mesh_;
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
