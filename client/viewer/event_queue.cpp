#include "client/viewer/event_queue.h"

#include <utility>

namespace ridgecast::viewer {
namespace {

// GLFW's key numbers. Keys that only write: their characters suffice, unless Ctrl makes a command of them.
bool writes(int key) { return (key > 32 && key <= 162) || (key >= 320 && key <= 334); }
bool modifies(int key) { return key >= 340 && key <= 347; }
constexpr int kFramesToField = 2;  // after Tab
constexpr int kTab = 258;
constexpr std::size_t kCtrl[] = {341, 345};
bool isRelease(const Event& e) { return e.kind == Event::Kind::kKey && !e.down; }

}  // namespace

void EventQueue::add(const Event& event) {
  if (event.code < 0 || (event.kind == Event::Kind::kKey && event.code >= static_cast<int>(kKeys)) ||
      (event.kind == Event::Kind::kButton && event.code >= static_cast<int>(kButtons)))
    return;
  if (event.kind == Event::Kind::kText && std::exchange(skipText_, false)) return;
  if (event.kind == Event::Kind::kKey && event.down) skipText_ = false;
  if (event.kind == Event::Kind::kMove && !waiting_.empty() && waiting_.back().kind == Event::Kind::kMove) {
    waiting_.back() = event;
    return;
  }
  const bool comesUp = (event.kind == Event::Kind::kKey || event.kind == Event::Kind::kButton) && !event.down;
  if (waiting_.size() >= kMax && !comesUp) return;
  if (waiting_.size() >= 2 * kMax) waiting_.pop_front();
  waiting_.push_back(event);
}

void EventQueue::holdFor(int frames) {
  held_ = frames;
  skipText_ = true;
  std::erase_if(waiting_, [](const Event& e) { return e.kind == Event::Kind::kText; });
}

bool EventQueue::isCommand(int key) const { return !writes(key) || keys_[kCtrl[0]] || keys_[kCtrl[1]]; }

// Whether the event must not share a frame with those already in it.
bool EventQueue::startsFrame(const Event& e) const {
  using Kind = Event::Kind;
  if (e.kind == Kind::kMove || e.kind == Kind::kWheel) return changedButtons_.any();
  if (e.kind == Kind::kButton) return changedButtons_[static_cast<std::size_t>(e.code)] || command_ || text_ || wheel_;
  if (e.kind == Kind::kText) return command_ || changedButtons_.any();
  const auto key = static_cast<std::size_t>(e.code);
  if (e.down == keys_[key]) return false;  // a repeat
  if (!e.down || modifies(e.code)) return command_ || (changedKeys_[key] && !writes(e.code));
  return isCommand(e.code) && (command_ || text_ || changedKeys_[key] || changedButtons_.any());
}

std::vector<Event> EventQueue::next() {
  command_ = text_ = wheel_ = false;
  changedKeys_.reset();
  changedButtons_.reset();
  std::vector<Event> out;
  const bool holds = held_ > 0;
  if (holds) --held_;
  while (!waiting_.empty() && !startsFrame(waiting_.front()) && !(holds && !isRelease(waiting_.front()))) {
    const Event e = waiting_.front();
    waiting_.pop_front();
    out.push_back(e);
    text_ |= e.kind == Event::Kind::kText;
    wheel_ |= e.kind == Event::Kind::kWheel;
    if (e.kind == Event::Kind::kButton) changedButtons_[static_cast<std::size_t>(e.code)] = true;
    if (e.kind != Event::Kind::kKey) continue;
    const auto key = static_cast<std::size_t>(e.code);
    command_ |= e.down && !keys_[key] && !modifies(e.code) && isCommand(e.code);
    changedKeys_[key] = true;
    keys_[key] = e.down;
    if (e.down && e.code == kTab) held_ = kFramesToField;
  }
  return out;
}

std::vector<Event> EventQueue::all() {
  std::vector<Event> out(waiting_.begin(), waiting_.end());
  for (const Event& e : out)
    if (e.kind == Event::Kind::kKey) keys_[static_cast<std::size_t>(e.code)] = e.down;
  waiting_.clear();
  held_ = 0;
  return out;
}

}  // namespace ridgecast::viewer
