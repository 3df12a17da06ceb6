#pragma once
// What a person did with keys and mouse, in order, handed on a frame's worth at a time. Whoever looks at keys and buttons once a frame, as Dear
// ImGui does before its version 1.87, must see each of them go down and come up, and what was typed before a key before it: on a slow
// machine a press, its release and the next press all come within one frame. No window system: values in, values out. One thread.

#include <bitset>
#include <cstddef>
#include <deque>
#include <vector>

namespace ridgecast::viewer {

struct Event {
  enum class Kind { kKey, kText, kButton, kWheel, kMove } kind = Kind::kKey;
  int code = 0;         // key (as GLFW numbers them), character, or button
  bool down = false;    // of a key or button
  double x = 0, y = 0;  // where the mouse is, or how far the wheel turned
};

class EventQueue {
 public:
  // Bound: kMost wait; of more, what would go down or be typed is dropped, what comes up is not.
  static constexpr std::size_t kMost = 1000;
  static constexpr std::size_t kButtons = 5, kKeys = 512;

  void add(const Event& event);
  // Those of the next frame.
  std::vector<Event> next();
  // All that wait.
  std::vector<Event> all();
  bool empty() const { return waiting_.empty(); }

  // Something opens to be typed into, by a key whose own character is still to come: that one is dropped, as what was typed before. What
  // follows waits for so many frames, until it is there.
  void holdFor(int frames);
  bool holding() const { return held_ > 0; }

 private:
  bool startsFrame(const Event& event) const;
  std::deque<Event> waiting_;
  std::bitset<kKeys> keys_;  // down, of what was handed on
  int held_ = 0;
  bool skipText_ = false;
  // Handed on in this frame:
  bool command_ = false, text_ = false, wheel_ = false;
  std::bitset<kKeys> changedKeys_;
  std::bitset<kButtons> changedButtons_;
};

}  // namespace ridgecast::viewer
