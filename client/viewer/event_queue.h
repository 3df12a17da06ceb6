#pragma once
// Key and mouse events in order, delivered one frame's worth at a time. Code that polls keys and buttons once a frame (Dear ImGui before
// 1.87) must see each of them go down and up, and typed text in order with keys. On a slow machine a press, its release and the next press
// may all come within one frame. No window system: values in, values out. One thread.

#include <bitset>
#include <cstddef>
#include <deque>
#include <vector>

namespace ridgecast::viewer {

struct Event {
  enum class Kind { kKey, kText, kButton, kWheel, kMove } kind = Kind::kKey;
  int code = 0;         // key (GLFW's number), character, or button
  bool down = false;    // of a key or button
  double x = 0, y = 0;  // mouse position, or how far the wheel turned
};

class EventQueue {
 public:
  // Bound: kMax events wait. Beyond that, presses and text are dropped; releases are not.
  static constexpr std::size_t kMax = 1000;
  static constexpr std::size_t kButtons = 5, kKeys = 512;

  void add(const Event& event);
  // The events of the next frame.
  std::vector<Event> next();
  // All waiting events.
  std::vector<Event> all();
  bool empty() const { return waiting_.empty(); }

  // A key opens a field for typing, and its own character is still to come: drops that character and earlier text. Later events wait
  // `frames` frames, until the field is there; releases before them do not: a key that seems held down repeats.
  void holdFor(int frames);
  bool holding() const { return held_ > 0; }

 private:
  bool startsFrame(const Event& event) const;
  bool isCommand(int key) const;
  std::deque<Event> waiting_;
  std::bitset<kKeys> keys_;  // down, according to delivered events
  int held_ = 0;
  bool skipText_ = false;
  // Delivered in this frame:
  bool command_ = false, text_ = false, wheel_ = false;
  std::bitset<kKeys> changedKeys_;
  std::bitset<kButtons> changedButtons_;
};

}  // namespace ridgecast::viewer
