#include "client/core/conversation/reconnector.h"

#include <algorithm>
#include <utility>

#include "common/outcome/contract.h"

namespace ridgecast::core {

Reconnector::Reconnector(Url url, wire::Hello hello, Returns returns, std::uint32_t random)
    : url_(std::move(url)), target_(url_), hello_(std::move(hello)), returns_(returns), current_(begin(url_)), random_(random) {}

std::unique_ptr<Conversation> Reconnector::begin(const Url& with) const {
  return std::make_unique<Conversation>(hello_, "the server at " + with.where());
}

// ---- the line ----

std::optional<Url> Reconnector::dial(Instant now) {
  if (hasLine_ || now < next_ || (lost_ && !comesBack())) return std::nullopt;
  hasLine_ = true;
  if (lost_) {
    expects(!coming_, "a conversation that comes has a line already");
    coming_ = begin(target_);
    asked_ = hello_.settings;
  }
  return target_;
}

Wrong Reconnector::heard(std::span<const std::uint8_t> frame, Instant now) {
  expects(hasLine_, "what is heard came over a line");
  const bool wasGreeted = isGreeted();
  if (Wrong wrong = ofLine().heard(frame, now)) return wrong;
  if (!wasGreeted && isGreeted()) greeted_ = now;
  if (wasGreeted || !isGreeted() || !coming_ || !current_->hasWorld()) return std::nullopt;
  const wire::World &before = current_->world(), &after = coming_->world();
  otherWorld_ = after.contentHash != before.contentHash || (after.edit < current_->edit() && !current_->isRecording());
  if (!otherWorld_ || returns_ == Returns::kAlways) return std::nullopt;
  return after.contentHash != before.contentHash ? "the server has another world now" : "the server has lost edits of this world";
}

std::optional<Reconnector::Instant> Reconnector::due() const {
  if (hasLine_) return ofLine().due();
  return lost_ && !comesBack() ? std::nullopt : std::optional(next_);
}

void Reconnector::ended(const Error& why, Instant now) {
  expects(hasLine_, "a line that ended was dialled");
  if (isGreeted() && now - greeted_ >= kLongestPause) pause_ = kFirstPause;
  hasLine_ = false;
  lost_ = why;
  target_ = url_;
  ofLine().end(why);
  speaksOther_ = ofLine().speaksOther();
  const auto sentTo = ofLine().sentTo();
  if (sentTo && !sentTo->empty()) follow(*sentTo);
  hello_.editsAfter = current_->forgetEdits();
  if (current_->isRecording()) hello_.editsAfter = 0;  // it may go back: it tells all of them again
  coming_.reset();
  const auto half = static_cast<unsigned>(pause_.count() / 2);
  next_ = now;
  if (!sentTo || pause_ != kFirstPause) next_ += std::chrono::milliseconds(half + random_() % (half + 1));
  pause_ = std::min(2 * pause_, kLongestPause);
}

void Reconnector::hurry(Instant now) {
  next_ = std::min(next_, now);
  pause_ = kFirstPause;
}

void Reconnector::follow(const std::string& sentTo) {
  const auto other = parseUrl(sentTo);
  if (!other || (url_.secure && !other->secure)) return;  // a token and a mesh that were encrypted stay so
  target_.host = other->host;
  target_.port = other->port;
  target_.secure = other->secure;
  if (other->host != url_.host) target_.token.clear();  // given for the server that the user named
}

// ---- the owner ----

Wrong Reconnector::send(const wire::PoseMessage& pose) {
  pose_ = pose;
  return lost_ ? std::nullopt : current_->send(pose);
}

Wrong Reconnector::change(const wire::Settings& settings) {
  hello_.settings = settings;
  return lost_ ? std::nullopt : current_->change(settings);
}

Wrong Reconnector::skipSteps(bool skips) {
  skipsSteps_ = skips;
  return lost_ ? std::nullopt : current_->skipSteps(skips);
}

void Reconnector::goOn(const std::vector<wire::Resume>& held) {
  expects(hasReturned(), "there is another conversation to go on with");
  bytesBefore_ += current_->bytes();
  current_ = std::move(coming_);
  lost_.reset();
  ++reconnections_;
  // Nothing was said before, so there is room for all of these.
  if (hello_.settings != asked_) current_->change(hello_.settings);
  for (const wire::Resume& leaves : held) current_->resume(leaves);
  current_->skipSteps(skipsSteps_);
  if (pose_) current_->send(*pose_);
}

}  // namespace ridgecast::core
