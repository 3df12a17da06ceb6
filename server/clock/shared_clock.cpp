#include "server/clock/shared_clock.h"

#include <algorithm>
#include <iterator>
#include <set>

#include "common/outcome/contract.h"

namespace ridgecast::clock {

namespace {

constexpr std::size_t kMaxCallsOfMessage = 256;
constexpr std::uint64_t kSoonMicroseconds = 1'000'000;  // a running clock that is ahead by less waits for the others

// Applying it twice would differ from once.
bool isOnce(const Call& call) {
  return call.kind == Call::Kind::kSet || call.kind == Call::Kind::kStep || call.kind == Call::Kind::kPassOver;
}

}  // namespace

// Calls of an earlier session of this name and server had lower numbers.
SharedClock::SharedClock(std::uint32_t server, wire::ClockMode mode, Now now)
    : self_(server), mode_(mode), lastNumber_(microsecondsOf(now.engine)), leaderHeard_(now.here) {
  expects(server != 0, "a server that is alone shares no clock");
  shown_.clock = Clock(now.engine, mode);
  announce(now);
  if (!now.isAway) seek(now);
}

std::uint64_t SharedClock::microsecondsOf(Clock::Instant instant) {
  return static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::microseconds>(instant.time_since_epoch()).count());
}

std::uint64_t SharedClock::time(const Now& now) const {
  if (shown_.version > 0) reached_ = std::max(reached_, shown_.clock.time(now.engine));
  return reached_;
}

wire::Clock SharedClock::state(const Now& now) const {
  wire::Clock state = shown_.clock.state(now.engine);
  state.time = time(now);
  return state;
}

std::size_t SharedClock::pendingSteps(std::uint64_t member) const {
  return static_cast<std::size_t>(std::ranges::count_if(pending_, [&](const ToldCalls::Numbered& numbered) {
    return !numbered.all && numbered.call.kind == Call::Kind::kStep && numbered.call.member == member;
  }));
}

std::set<std::uint64_t> SharedClock::undone(const std::function<bool(std::uint64_t member)>& isHere) const {
  std::set<std::uint64_t> members;
  for (const std::uint64_t member : shown_.clock.waitsFor())
    if (isHere(member)) members.insert(member);
  for (const ToldCalls::Numbered& numbered : pending_)
    if (!numbered.all && numbered.call.kind == Call::Kind::kDone && numbered.call.number == shown_.clock.step())
      members.erase(numbered.call.member);
  return members;
}

bool SharedClock::turnsStep(const Record& next) const {
  const Clock::State &is = shown_.clock.all(), &will = next.clock.all();
  return next.version > shown_.version && will.mode == wire::ClockMode::kStepped &&
         (will.step != is.step || (will.waitsFor.empty() && !is.waitsFor.empty()));
}

bool SharedClock::turnsStep(const Outcome<Told>& told) const { return told && told->epoch >= epoch_ && turnsStep(told->record); }

bool SharedClock::turnsStep(const Outcome<bus::Bus::Held>& answer) const {
  if (!answer) return false;
  if (asked_ == Asked::kHold && answer->isYours) return turnsStep(writing_);
  const auto record = recordOf(answer->record.value);
  return record && turnsStep(*record);
}

// ---- this server's calls ----

void SharedClock::call(const Call& call, const Now& now) {
  if (call.kind == Call::Kind::kFollow) members_[call.member] = true;
  if (call.kind == Call::Kind::kSet) members_.try_emplace(call.member, false);
  if (call.kind == Call::Kind::kLeave && members_.erase(call.member) == 0) return;
  const Clock::State& clock = shown_.clock.all();
  if (call.kind == Call::Kind::kDone &&
      (call.number != clock.step || (!clock.waitsFor.contains(call.member) && !clock.passedOver.contains(call.member))))
    return;
  const bool isFull = pending_.size() >= kMaxPending;
  if (isFull) announce(now, true);
  if (!isFull || isOnce(call)) add({++lastNumber_, {}, call}, now);
  write(now);
}

void SharedClock::announce(const Now& now, bool isFull) {
  std::set<std::uint64_t> lost;
  for (const ToldCalls::Numbered& numbered : pending_)
    if (!numbered.all && isOnce(numbered.call)) lost.insert(numbered.call.member);
  for (const std::uint64_t member : lost)
    news_.notices.push_back(isFull ? Notice{member,
                                            "Too many calls to the clock wait: it is not known whether your last one took effect; look "
                                            "at the clock, and repeat the call if it did not."}
                                   : Notice{member,
                                            "The servers of this world lost touch, so your last call to the clock had no effect: "
                                            "repeat it.",
                                            true});
  pending_.clear();
  announced_ = ++lastNumber_;
  ToldCalls::Numbered numbered{announced_, std::vector<ToldCalls::Member>()};
  for (const auto& [member, follows] : members_) numbered.all->push_back({member, follows});
  add(std::move(numbered), now);
}

void SharedClock::add(ToldCalls::Numbered numbered, const Now& now) {
  if (pending_.empty()) {
    pause_ = kTick;
    repeatAt_ = now.here + pause_;
  }
  pending_.push_back(std::move(numbered));
  if (role_ == Role::kLeading) applyTo(self_, {pending_.back()}, now);
  if (role_ == Role::kMirroring) sendCalls(pending_.size() - 1, now);
}

void SharedClock::sendCalls(std::size_t from, const Now& now) {
  ToldCalls told{self_};
  const auto first = pending_.begin() + static_cast<std::ptrdiff_t>(from);
  told.calls.assign(first, first + static_cast<std::ptrdiff_t>(std::min(kMaxCallsOfMessage, pending_.size() - from)));
  toldLeader_ = now.here;
  news_.wishes.push_back({Wish::Kind::kCall, toBytes(told)});
}

void SharedClock::acknowledge(const Now& now) {
  const auto mine = shown_.servers.find(self_);
  const bool isKnown = mine != shown_.servers.end(), isHere = isKnown && mine->second.isHere;
  const std::uint64_t applied = isKnown ? mine->second.applied : 0;
  const bool wasAccepted = acknowledged_ >= announced_;
  if (applied > lastNumber_) {  // of an earlier session, before the engine's clock was set back
    lastNumber_ = applied;
    return announce(now);
  }
  forget(applied);
  if (isHere ? wasAccepted && applied < acknowledged_ : wasAccepted || applied >= announced_) return announce(now);
  if (!isHere) return;
  acknowledged_ = applied;
}

void SharedClock::forget(std::uint64_t applied) {
  while (!pending_.empty() && pending_.front().number <= applied) {
    const ToldCalls::Numbered& numbered = pending_.front();
    if (!numbered.all && numbered.call.kind == Call::Kind::kSet) news_.answered.push_back(numbered.call.member);
    pending_.pop_front();
    pause_ = kTick;
  }
}

// ---- the record ----

void SharedClock::show(Record record, const Now& now) {
  if (record.version <= shown_.version) return;
  news_.isChanged = news_.isChanged || shown_.version == 0 || record.changes != shown_.changes;
  shown_ = std::move(record);
  acknowledge(now);
}

bool SharedClock::show(const std::string& bytes, const Now& now) {
  auto record = recordOf(bytes);
  isUnreadable_ = !record;
  if (!record) return news_.problem = record.error().message, false;
  show(std::move(*record), now);
  return true;
}

// Of the same version. An earlier leader has written what is shown, the engine has lost it, and the next one has counted on from before.
bool SharedClock::isOther(const Record& record) const { return record.version == shown_.version && toBytes(record) != toBytes(shown_); }

void SharedClock::seek(const Now& now) {
  if (asked_ != Asked::kNothing) return;
  writing_ = shown_;
  if (writing_.version == 0) writing_.clock = Clock(now.engine, mode_);
  ++writing_.version;
  writingNotices_.clear();
  asked_ = Asked::kHold;
  news_.wishes.push_back({Wish::Kind::kHold, toBytes(writing_), 0});
}

void SharedClock::lead(const Now& now) {
  role_ = Role::kLeading;
  isNew_ = true;
  next_ = shown_;
  notices_.clear();
  const auto heard = std::exchange(heard_, {});
  for (const auto& [server, one] : next_.servers)
    if (server != self_ && one.isHere) heard_[server] = heard.contains(server) ? now.here : leaderHeard_;
  stepBegan_ = now.here;
  watchedStep_ = next_.clock.step();
  applyTo(self_, {pending_.begin(), pending_.end()}, now);
  write_ = Write::kNow;
  write(now);
}

void SharedClock::mirror(const bus::Record& record, const Now& now) {
  role_ = Role::kMirroring;
  epoch_ = record.epoch;
  leaderHeard_ = now.here;
  isLeaderBehind_ = false;
  show(record.value, now);
  sendCalls(0, now);
}

void SharedClock::answered(Outcome<bus::Bus::Held> answer, const Now& now) {
  const Asked asked = std::exchange(asked_, Asked::kNothing);
  expects(asked != Asked::kNothing, "an answer follows a question");
  if (!answer) {  // the tick asks again
    if (!now.isAway) news_.problem = "cannot change: " + answer.error().message;
    if (role_ != Role::kLeading) return;
    write_ = Write::kNow;
    std::swap(notices_, writingNotices_);
    for (Notice& notice : std::exchange(writingNotices_, {})) add(std::move(notice));
    return;
  }
  const bool isAhead = role_ == Role::kMirroring && asked == Asked::kHold;  // a later leader was heard meanwhile
  if (!answer->isYours) {
    if (answer->record.epoch != 0)
      mirror(answer->record, now);
    else if (!isAhead)
      role_ = Role::kSeeking;  // the record has ended
    return;
  }
  if (isAhead) return;
  epoch_ = answer->record.epoch;
  if (asked == Asked::kTake) {
    if (show(answer->record.value, now)) lead(now);
    return;
  }
  written_ = now.here;
  show(std::move(writing_), now);
  if (role_ == Role::kSeeking) {
    leaderHeard_ = now.here;  // there was none
    return lead(now);
  }
  for (const Notice& notice : writingNotices_) news_.notices.push_back(notice);
  if (std::exchange(isNew_, false) || !heard_.empty()) tell(std::move(writingNotices_), now);
  writingNotices_.clear();
  write(now);
}

void SharedClock::heardTold(Outcome<Told> told, const Now& now) {
  if (!told) {
    news_.problem = told.error().message;
    return;
  }
  if (told->epoch < epoch_ || (told->epoch == epoch_ && role_ == Role::kLeading)) return;
  isUnreadable_ = false;
  const bool isNew = told->epoch != epoch_ || role_ != Role::kMirroring;
  epoch_ = told->epoch;
  role_ = Role::kMirroring;
  leaderHeard_ = told->isLast ? now.here - kSilence : now.here;
  isLeaderBehind_ = told->record.version < shown_.version || isOther(told->record);
  show(std::move(told->record), now);
  for (Notice& notice : told->notices) news_.notices.push_back(std::move(notice));
  if (isNew) sendCalls(0, now);
}

// ---- leading ----

void SharedClock::heardCalls(const std::string& bytes, const Now& now) {
  const auto told = toldCallsOf(bytes);
  if (!told) {
    news_.problem = told.error().message;
    return;
  }
  const bool isNew = heard_.insert_or_assign(told->server, now.here).second;
  if (role_ != Role::kLeading) return;
  if (told->isLast) {
    remove(told->server, now);
    return write(now);
  }
  if (isNew) tell({}, now);
  applyTo(told->server, told->calls, now);
  write(now);
}

void SharedClock::applyTo(std::uint32_t server, const std::vector<ToldCalls::Numbered>& calls, const Now& now) {
  for (const ToldCalls::Numbered& numbered : calls) {
    const auto known = next_.servers.find(server);
    const std::uint64_t applied = known == next_.servers.end() ? 0 : known->second.applied;
    const bool isHere = known != next_.servers.end() && known->second.isHere;
    if (numbered.all ? numbered.number <= applied : !isHere || numbered.number != applied + 1) continue;
    Record::Server& one = next_.servers[server];
    one.applied = numbered.number;
    one.isHere = true;
    if (numbered.all)
      replace(one.members, *numbered.all, now);
    else
      applyOne(one.members, numbered.call, now);
  }
}

void SharedClock::replace(std::set<std::uint64_t>& members, const std::vector<ToldCalls::Member>& all, const Now& now) {
  std::set<std::uint64_t> there;
  for (const ToldCalls::Member& member : all) {
    there.insert(member.member);
    if (member.follows && !next_.clock.all().passedOver.contains(member.member)) next_.clock.follow(member.member);
  }
  for (const std::uint64_t member : std::exchange(members, there))
    if (!there.contains(member)) took(apply(next_.clock, {.kind = Call::Kind::kLeave, .member = member}, now.engine), Write::kSoon);
  took({}, Write::kSoon);
}

void SharedClock::applyOne(std::set<std::uint64_t>& members, const Call& call, const Now& now) {
  if (call.kind == Call::Kind::kFollow || call.kind == Call::Kind::kSet) members.insert(call.member);
  if (call.kind == Call::Kind::kLeave) members.erase(call.member);
  took(apply(next_.clock, call, now.engine), isOnce(call) ? Write::kNow : Write::kSoon);
}

void SharedClock::took(Effect effect, Write write) {
  if (effect.isChanged) ++next_.changes;
  if (effect.isChanged || !effect.notices.empty()) write = Write::kNow;
  for (Notice& notice : effect.notices) add(std::move(notice));
  write_ = std::max(write_, write);
}

void SharedClock::add(Notice notice) {
  if (notices_.size() < kMaxNotices) notices_.push_back(std::move(notice));
}

void SharedClock::remove(std::uint32_t server, const Now& now) {
  heard_.erase(server);
  const auto gone = next_.servers.find(server);
  if (gone == next_.servers.end()) return;
  replace(gone->second.members, {}, now);
  gone->second.isHere = false;
  for (auto one = next_.servers.begin(); next_.servers.size() > kMaxGone && one != next_.servers.end();)
    one = one->second.isHere ? std::next(one) : next_.servers.erase(one);
}

void SharedClock::write(const Now& now) {
  if (role_ != Role::kLeading || write_ != Write::kNow || asked_ != Asked::kNothing) return;
  if (next_.clock.step() != watchedStep_) {
    watchedStep_ = next_.clock.step();
    stepBegan_ = now.here;
  }
  write_ = Write::kNot;
  // A setting may have waited for a write that failed, while the clock went on everywhere.
  if (time(now); wasShownFarAheadOf(next_.clock, now) && next_.clock.reach(reached_, now.engine)) ++next_.changes;
  next_.version = std::max(next_.version, shown_.version) + 1;
  writing_ = next_;
  writingNotices_ = std::exchange(notices_, {});
  asked_ = Asked::kHold;
  news_.wishes.push_back({Wish::Kind::kHold, toBytes(writing_), epoch_});
}

void SharedClock::tell(std::vector<Notice> notices, const Now& now) {
  told_ = now.here;
  news_.wishes.push_back({Wish::Kind::kTell, toBytes(Told{epoch_, false, shown_, std::move(notices)})});
}

// ---- what is due ----

void SharedClock::tick(const Now& now) {
  if (now.isAway) {
    wasAway_ = true;
    return;
  }
  if (std::exchange(wasAway_, false)) {  // nobody could be heard
    leaderHeard_ = repeatAt_ = now.here;
    for (auto& [server, heard] : heard_) heard = now.here;
    if (role_ == Role::kLeading) write_ = Write::kNow;  // if it still leads
  }
  if (isUnreadable_) return;
  if (role_ == Role::kSeeking) return seek(now);
  keepAhead(now);
  if (role_ == Role::kLeading)
    tickLeading(now);
  else
    tickMirroring(now);
}

void SharedClock::tickMirroring(const Now& now) {
  std::erase_if(heard_, [&](const auto& other) { return now.here - other.second >= kSilence; });
  if (isLeaderBehind_ || now.here - leaderHeard_ >= kSilence) {
    if (asked_ != Asked::kNothing) return;
    asked_ = Asked::kTake;
    news_.wishes.push_back({Wish::Kind::kTake, {}, epoch_});
  } else if (!pending_.empty() && now.here >= repeatAt_) {
    sendCalls(0, now);
    repeatAt_ = now.here + pause_;
    pause_ = std::min<std::chrono::milliseconds>(2 * pause_, kMaxPause);
  } else if (now.here - toldLeader_ >= kHeartbeat) {
    sendCalls(pending_.size(), now);
  }
}

void SharedClock::tickLeading(const Now& now) {
  std::vector<std::uint32_t> silent;
  for (const auto& [server, heard] : heard_)
    if (now.here - heard >= kSilence) silent.push_back(server);
  for (const std::uint32_t server : silent) remove(server, now);
  if (now.here - stepBegan_ >= kStepTimeout)
    for (const std::uint64_t late : std::set(next_.clock.waitsFor())) took(passOver(next_.clock, late, whyLate()), Write::kNow);
  if (write_ == Write::kSoon || now.here - written_ >= kLife / 24) write_ = Write::kNow;
  write(now);
  if (!heard_.empty() && now.here - told_ >= kHeartbeat) tell({}, now);
}

// It would not be there soon.
bool SharedClock::wasShownFarAheadOf(const Clock& clock, const Now& now) const {
  const std::uint64_t time = clock.time(now.engine);
  return reached_ > time && (clock.all().rate <= 0 || reached_ - time >= kSoonMicroseconds);
}

void SharedClock::keepAhead(const Now& now) {
  if (!wasShownFarAheadOf(shown_.clock, now)) return;
  if (std::ranges::any_of(pending_, [](const auto& p) { return !p.all && p.call.kind == Call::Kind::kReach; })) return;
  call({.kind = Call::Kind::kReach, .number = reached_}, now);
}

void SharedClock::end() {
  if (role_ == Role::kLeading) news_.wishes.push_back({Wish::Kind::kTell, toBytes(Told{epoch_, true, shown_})});
  if (role_ == Role::kMirroring) news_.wishes.push_back({Wish::Kind::kCall, toBytes(ToldCalls{self_, true})});
}

}  // namespace ridgecast::clock
