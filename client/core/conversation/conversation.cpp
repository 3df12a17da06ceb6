#include "client/core/conversation/conversation.h"

#include <chrono>
#include <iterator>
#include <utility>
#include <variant>

#include "common/outcome/contract.h"
#include "common/text/text.h"
#include "common/wire/wire.h"

namespace ridgecast::core {
namespace {

// The session's clock is requested a few times at once, so that one request finds the way free, then every second.
constexpr int kFirstRequests = 5;
constexpr std::chrono::milliseconds kFirstPause{20}, kPause{1000};

}  // namespace

Conversation::Conversation(wire::Hello hello, std::string server)
    : hello_(std::move(hello)), server_(std::move(server)), outbox_(hello_.pacing), lastEdit_(hello_.editsAfter) {}

// ---- the line ----

std::string Conversation::hello() const { return wire::encode(wire::ClientMessage(hello_)); }

Wrong Conversation::heard(std::span<const std::uint8_t> frame, Instant now) {
  auto message = wire::decodeServer(frame);
  const Wrong wrong =
      message ? take(*message, {frame.size(), now}) : Wrong("sent something that cannot be read: " + message.error().message);
  return wrong ? Wrong(server_ + " " + *wrong) : std::nullopt;
}

std::optional<std::string> Conversation::next(Instant now) {
  if (!hasWorld_) return std::nullopt;
  if (asksClock_ && *asksClock_ <= now) {  // at once: its time on the way makes the answer unsure
    asksClock_ = now + (clockAsked_++ < kFirstRequests ? kFirstPause : kPause);
    return wire::encode(clock_.ask(now));
  }
  const std::optional<wire::ClientMessage> message = outbox_.next();
  if (!message) return std::nullopt;
  if (std::holds_alternative<wire::SetClock>(*message)) {
    clock_.setLeft();
    if (asksClock_) asksClock_ = now;
  }
  return wire::encode(*message);
}

void Conversation::end(const Error& why) {
  outbox_.queries.fail(why);
  outbox_.grounds.fail(why);
  outbox_.edits.fail(why);
}

// ---- what is said ----

Wrong Conversation::acknowledge(const wire::Acknowledge& acknowledge) { return outbox_.put(acknowledge), std::nullopt; }
Wrong Conversation::resume(const wire::Resume& resume) { return outbox_.put(resume), std::nullopt; }
Wrong Conversation::resend(const wire::ResendLeaves& resend) { return outbox_.put(resend), std::nullopt; }

Wrong Conversation::change(const wire::Settings& settings) {
  if (world_.revision >= 2) outbox_.put(settings);
  return std::nullopt;
}

Wrong Conversation::setClock(const wire::SetClock& set) {
  clock_.set();
  return outbox_.put(set);
}

Wrong Conversation::skipSteps(bool skips) {
  skipsSteps_ = skips;
  return skipStep();
}

Wrong Conversation::skipStep() {
  if (!skipsSteps_ || !clock_.waitsFor(world_.camera)) return std::nullopt;
  return outbox_.put(wire::StepDone{clock_.said().step});
}

Wrong Conversation::passOver(std::uint64_t camera) { return world_.revision >= 3 ? outbox_.put(wire::PassOver{camera}) : std::nullopt; }

Error Conversation::lacks(const char* what) const { return Error{server_ + " is of a version that " + what}; }

void Conversation::ask(wire::Query query, std::function<void(Outcome<wire::Answer>)> done) {
  if (world_.revision < 1) return done(lacks("answers no queries"));
  if (query.kind == wire::QueryKind::kMaterials && world_.revision < 8) return done(lacks("knows no materials"));
  outbox_.queries.add(std::move(query), std::move(done));
}
void Conversation::ask(const wire::AskGround& ask, std::function<void(Outcome<wire::Ground>)> done) {
  if (world_.revision < 1) return done(lacks("answers no queries"));
  outbox_.grounds.add(ask, std::move(done));
}
void Conversation::ask(wire::Edit edit, std::function<void(Outcome<wire::EditAnswer>)> done) {
  if (world_.revision < 4) return done(lacks("knows no edits"));
  outbox_.edits.add(std::move(edit), std::move(done));
}

// ---- what was heard ----

std::optional<Received> Conversation::receive() {
  if (iterations_.empty()) return std::nullopt;
  Received received = std::move(iterations_.front());
  iterations_.pop_front();
  expects(waitingBytes_ >= received.bytes, "what waits is counted");
  waitingBytes_ -= received.bytes;
  return received;
}

EditsMade Conversation::takeEdits() {
  expects(edits_.empty() || edits_.back().number == lastEdit_, "the last edit that waits is the last that was told");
  return {lastEdit_ - edits_.size(), world_.edit, std::exchange(edits_, {})};
}

std::uint64_t Conversation::forgetEdits() {
  lastEdit_ -= edits_.size();
  edits_.clear();
  return lastEdit_;
}

Wrong Conversation::take(wire::ServerMessage& message, const Frame& frame) {
  if (const auto* error = std::get_if<wire::ErrorMessage>(&message)) {
    speaksOther_ = error->code == wire::ErrorCode::kVersion;
    if (error->code == wire::ErrorCode::kGoingAway) sentTo_ = error->reconnectUrl;
    return "says: " + text::oneLine(error->message);
  }
  bytes_ += frame.bytes;
  if (std::holds_alternative<wire::UnknownKind>(message)) return std::nullopt;
  if (!hasWorld_ && !std::holds_alternative<wire::World>(message))
    return std::holds_alternative<wire::Iteration>(message) ? "sent an iteration before its world"
                                                            : "spoke of its session before its world";
  return std::visit([&](auto& m) { return take(std::move(m), frame); }, message);
}

Wrong Conversation::take(wire::World&& world, const Frame& frame) {
  if (hasWorld_) return "sent a second world";
  speaksOther_ = world.protocolVersion != wire::kProtocolVersion;
  if (speaksOther_)
    return "speaks protocol version " + std::to_string(world.protocolVersion) + ", this client " + std::to_string(wire::kProtocolVersion) +
           "; use equal versions of both";
  world_ = std::move(world);
  granted_ = world_.settings;
  lastEdit_ = std::max(lastEdit_, world_.compacted);
  edit_ = world_.edit;
  hasWorld_ = true;
  if (hello_.clock && world_.revision >= 1) asksClock_ = frame.heard;
  return std::nullopt;
}

Wrong Conversation::take(wire::Iteration&& iteration, const Frame& frame) {
  if (iterations_.size() >= world_.window) return "sent more than the " + std::to_string(world_.window) + " iterations it may";
  if (waitingBytes_ + frame.bytes > wire::kMaxServerMessageBytes) return "sent more than 256 MiB of iterations that nobody has taken yet";
  waitingBytes_ += frame.bytes;
  edit_ = std::max(edit_, iteration.edit);
  iterations_.push_back({.iteration = std::move(iteration), .bytes = frame.bytes});
  return std::nullopt;
}

Wrong Conversation::take(wire::Members&& members, const Frame& frame) {
  const auto applied = roster_.apply(members, frame.heard);
  return applied ? std::nullopt : Wrong("broke the protocol: " + applied.error().message);
}

Wrong Conversation::take(wire::Clock&& said, const Frame& frame) {
  clock_.hear(said, frame.heard);
  return skipStep();
}

Wrong Conversation::take(wire::Edited&& edited, const Frame&) {
  for (wire::MadeEdit& made : edited.edits) {
    if (!hello_.edits || made.number != lastEdit_ + 1) return "broke the protocol: edits that leave a gap, or that nobody wanted";
    if (edits_.size() >= kMaxMadeEdits) return "sent more than " + std::to_string(kMaxMadeEdits) + " edits that nobody has taken yet";
    lastEdit_ = made.number;
    edit_ = std::max(edit_, made.number);
    edits_.push_back(std::move(made));
  }
  return std::nullopt;
}

Wrong Conversation::take(wire::Granted&& granted, const Frame&) {
  granted_ = granted.settings;
  return std::nullopt;
}

Wrong Conversation::take(wire::Answer&& answer, const Frame&) {
  return outbox_.queries.take(std::move(answer)) ? std::nullopt : Wrong("broke the protocol: an answer to no query");
}
Wrong Conversation::take(wire::Ground&& ground, const Frame&) {
  return outbox_.grounds.take(std::move(ground)) ? std::nullopt : Wrong("broke the protocol: a ground that was not requested");
}
Wrong Conversation::take(wire::EditAnswer&& answer, const Frame&) {
  edit_ = std::max(edit_, answer.number);
  return outbox_.edits.take(std::move(answer)) ? std::nullopt : Wrong("broke the protocol: an answer to no edit");
}

}  // namespace ridgecast::core
