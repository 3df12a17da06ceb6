#include "server/presence/news.h"

#include <algorithm>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"

namespace ridgecast::presence {

namespace {

constexpr std::size_t kMostBytes = 1u << 20;  // of a message to a member that is told of all, but for its last entry
constexpr std::size_t kAtOnce = 256;          // members of a pass looked at for one message
// Of a message's bytes, at least this part is for members that are not the nearest.
constexpr std::size_t kShare = 16, kShareOfEverybody = 4;

std::string joinedPart(wire::Member member, bool withState) {
  if (!withState && member.moved) member.moved->pose.state.clear();
  wire::Members part;
  part.joined.push_back(std::move(member));
  return wire::encodePart(part);
}

}  // namespace

std::vector<News::Told>::iterator News::find(std::uint64_t camera) { return std::ranges::lower_bound(told_, camera, {}, &Told::camera); }

bool News::knows(std::uint64_t camera) {
  const auto it = find(camera);
  return it != told_.end() && it->camera == camera;
}

void News::forget(std::uint64_t camera) {
  const auto it = find(camera);
  if (it == told_.end() || it->camera != camera) return;
  told_.erase(it);
  left_.push_back(camera);
}

void News::tell(const Crowd::Participant& who, std::string& out) {
  const std::uint64_t camera = who.member().camera;
  const auto it = find(camera);
  if (it == told_.end() || it->camera != camera) {
    told_.insert(it, {camera, who.version()});
    out += joinedPart(who.member(), states_);
  } else if (it->version != who.version()) {
    it->version = who.version();
    out += who.moved(states_);
  }
}

std::optional<std::string> News::next(const Crowd& crowd, const Crowd::Participant& self, const Terms& terms, Timer::Time now) {
  expects(!terms.all || wantsEverybody_, "everybody is told to those that want it");
  std::string out;
  const bool isFirst = version_ == 0, wasCut = std::exchange(isCut_, false);
  if (terms.all) {
    // From where the last message ended, around once, as far as one message goes.
    auto at = crowd.all().upper_bound(last_);
    for (std::size_t k = 0; k < crowd.size() && out.size() <= kMostBytes; ++k, ++at) {
      if (at == crowd.all().end()) at = crowd.all().begin();
      last_ = at->first;
      const Crowd::Participant& who = at->second;
      isCut_ = isCut_ || waits(who);
      if (&who != &self && !waits(who)) tell(who, out);
    }
    isCut_ = isCut_ || out.size() > kMostBytes;
    pass_ = {};
    pass_.version = crowd.version();
  } else {
    const std::size_t others = crowd.size() - 1;
    if (version_ != crowd.version() || wasCut)
      for (const Crowd::Participant* who : crowd.nearest(self, near_)) {
        isCut_ = isCut_ || waits(*who);
        if (!waits(*who)) tell(*who, out);
      }
    const std::size_t near = out.size();
    if (pass_.next == pass_.cameras.size() && (isFirst || (pass_.version != crowd.version() && now >= pass_.began + kPass))) {
      pass_.began = now;
      beginPass(crowd, self, terms, out);
    }
    goOn(crowd, std::max(terms.bytes / (wantsEverybody_ ? kShareOfEverybody : kShare), terms.bytes > near ? terms.bytes - near : 0), out);
    if (!wantsEverybody_ && (std::exchange(others_, others) != others || !out.empty() || !left_.empty() || isFirst)) {
      wire::Members part;
      part.others = static_cast<std::uint32_t>(others);
      out += wire::encodePart(part);
    }
  }
  if (!left_.empty()) {
    wire::Members part;
    part.left.swap(left_);
    out += wire::encodePart(part);
  }
  version_ = crowd.version();
  if (out.empty() && !isFirst) return {};
  return out;
}

void News::beginPass(const Crowd& crowd, const Crowd::Participant& self, const Terms& terms, std::string& out) {
  pass_.version = crowd.version();
  pass_.next = 0;
  pass_.cameras.clear();
  if (wantsEverybody_) {
    for (const auto& [camera, who] : crowd.all())
      if (&who != &self && (told_.size() < kMaxNamed || knows(camera))) pass_.cameras.push_back(camera);
    return;
  }
  const auto nearest = crowd.nearest(self, kFar);
  for (std::size_t k = 0; k < nearest.size(); ++k)
    if (const std::uint64_t camera = nearest[k]->member().camera; k < kNamed || knows(camera)) pass_.cameras.push_back(camera);
  wire::Members part;
  for (std::size_t k = told_.size(); k-- > 0;)
    if (std::ranges::find(pass_.cameras, told_[k].camera) == pass_.cameras.end()) {
      part.faded.push_back(told_[k].camera);
      told_.erase(told_.begin() + static_cast<std::ptrdiff_t>(k));
    }
  const bool allNamed = crowd.size() - 1 <= kNamed;
  if (allNamed && std::exchange(counts_, 0) != 0) part.crowd.emplace();
  out += wire::encodePart(part);
  if (allNamed) return;
  pass_.version = terms.crowd.version;  // older ones: there is another pass
  if (std::exchange(counts_, terms.crowd.number) != terms.crowd.number) out += terms.crowd.bytes;
}

void News::goOn(const Crowd& crowd, std::size_t bytes, std::string& out) {
  const std::size_t before = out.size();
  for (std::size_t k = 0; k < kAtOnce && pass_.next < pass_.cameras.size() && out.size() - before < bytes; ++k) {
    const std::uint64_t camera = pass_.cameras[pass_.next];
    const Crowd::Participant* who = crowd.find(camera);
    if (who && waits(*who)) break;
    ++pass_.next;
    if (who && (told_.size() < kMaxNamed || knows(camera))) tell(*who, out);
  }
}

std::optional<Timer::Time> News::due(const Crowd& crowd) const {
  if (version_ != crowd.version() || pass_.next != pass_.cameras.size() || isCut_) return Timer::Time::min();
  if (pass_.version != crowd.version()) return pass_.began + kPass;
  return {};
}

}  // namespace ridgecast::presence
