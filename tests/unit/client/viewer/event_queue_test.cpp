// What the panel sees of keys and mouse when much comes within one frame.

#include "client/viewer/event_queue.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>
#include <string>

namespace ridgecast::viewer {
namespace {

using Kind = Event::Kind;
constexpr int kTab = 258, kEnter = 257, kShift = 340, kControl = 341, kA = 65, kV = 86;

Event key(int code, bool down) { return {Kind::kKey, code, down}; }
Event text(char c) { return {Kind::kText, c}; }
Event button(int code, bool down) { return {Kind::kButton, code, down}; }
Event at(double x) { return {Kind::kMove, 0, false, x, 0}; }

void tap(EventQueue& queue, int code) {
  queue.add(key(code, true));
  queue.add(key(code, false));
}
void type(EventQueue& queue, const std::string& word) {
  for (const char c : word) {
    queue.add(key(c >= 'a' ? c - 32 : c, true));
    queue.add(text(c));
    queue.add(key(c >= 'a' ? c - 32 : c, false));
  }
}
// What somebody sees who looks at keys and buttons once a frame, as words: characters as they are, <key> at each press of a command.
struct Seen {
  std::string words;
  std::map<int, bool> keys, buttons;
  int frames = 0;
  void look(EventQueue& queue) {
    std::map<int, bool> now = keys, pressed = buttons;
    std::string typed;
    double x = -1;
    for (const Event& e : queue.next()) {
      if (e.kind == Kind::kKey) now[e.code] = e.down;
      if (e.kind == Kind::kText) typed += static_cast<char>(e.code);
      if (e.kind == Kind::kButton) pressed[e.code] = e.down;
      if (e.kind == Kind::kMove) x = e.x;
    }
    if (x >= 0) words += "@" + std::to_string(static_cast<int>(x));
    for (const auto& [code, down] : now)
      if (down && !keys[code] && (code > 128 || now[kControl]) && code != kShift && code != kControl)
        words += std::string("<") + (now[kShift] ? "shift " : "") + (now[kControl] ? "ctrl " : "") + std::to_string(code) + ">";
    for (const auto& [code, down] : pressed)
      if (down != buttons[code]) words += down ? "[" : "]";
    words += typed;
    keys = now;
    buttons = pressed;
    ++frames;
  }
};
Seen seen(EventQueue& queue) {
  Seen out;
  while (!queue.empty() || queue.holding()) out.look(queue);
  return out;
}

TEST(EventQueue, AKeyThatCameAndWentIsSeenDownAndUp) {
  EventQueue queue;
  tap(queue, kEnter);
  const auto first = queue.next(), second = queue.next();
  ASSERT_EQ(first.size(), 1u);
  EXPECT_TRUE(first[0].down);
  ASSERT_EQ(second.size(), 1u);
  EXPECT_FALSE(second[0].down);
  EXPECT_TRUE(queue.empty());
}

TEST(EventQueue, FieldsAreFilledAndLeftInOrder) {
  EventQueue queue;
  type(queue, "canyon");
  tap(queue, kTab);
  type(queue, "42");
  tap(queue, kEnter);
  const Seen all = seen(queue);
  EXPECT_EQ(all.words, "canyon<258>42<257>");
  EXPECT_LE(all.frames, 7) << "a word is one frame's";
}

// Dear ImGui repeats a key that is down for 0.275 s: of three slow frames, one.
TEST(EventQueue, ATabThatWasReleasedIsDownForOneFrame) {
  EventQueue queue;
  tap(queue, kTab);
  type(queue, "42");
  const auto first = queue.next(), second = queue.next(), third = queue.next();
  ASSERT_EQ(first.size(), 1u);
  EXPECT_TRUE(first[0].down);
  ASSERT_EQ(second.size(), 1u);
  EXPECT_FALSE(second[0].down);
  EXPECT_TRUE(third.empty());
  EXPECT_EQ(seen(queue).words, "42");
}

TEST(EventQueue, ModifiersBelongToTheirKeys) {
  EventQueue queue;
  queue.add(key(kShift, true));
  tap(queue, kTab);
  queue.add(key(kShift, false));
  tap(queue, kTab);
  queue.add(key(kControl, true));
  tap(queue, kA);
  tap(queue, kV);
  queue.add(key(kControl, false));
  type(queue, "v");
  EXPECT_EQ(seen(queue).words, "<shift 258><258><ctrl 65><ctrl 86>v");
}

TEST(EventQueue, ClicksAreMadeWhereTheMouseWasThen) {
  EventQueue queue;
  queue.add(at(3));
  queue.add(at(10));
  queue.add(button(0, true));
  queue.add(at(20));
  queue.add(button(0, false));
  queue.add(at(30));
  queue.add(button(0, true));
  queue.add(button(0, false));
  EXPECT_EQ(seen(queue).words, "@10[@20]@30[]");
}

TEST(EventQueue, WhatOpensAPanelIsNotTypedIntoItAndTheRestWaitsForTheField) {
  EventQueue queue;
  type(queue, "1");
  queue.add(key('J', true));
  queue.holdFor(2);
  queue.add(text('j'));
  queue.add(key('J', false));
  type(queue, "17");
  EXPECT_TRUE(queue.next().empty());
  EXPECT_TRUE(queue.next().empty());
  EXPECT_FALSE(queue.holding());
  EXPECT_EQ(seen(queue).words, "17");
  queue.holdFor(2);  // a key without a character
  type(queue, "8");
  EXPECT_EQ(seen(queue).words, "8");
}

TEST(EventQueue, AnythingAtAllIsSeenWholeAndInOrderWithinABound) {
  std::mt19937 random(4);
  for (int round = 0; round < 200; ++round) {
    EventQueue queue;
    std::vector<Event> added;
    std::size_t given = 0;
    const auto same = [](const Event& a, const Event& b) { return a.kind == b.kind && a.code == b.code && a.down == b.down; };
    const auto look = [&] {
      std::map<int, int> changes, clicks;
      for (const Event& e : queue.next()) {
        ASSERT_LT(given, added.size());
        ASSERT_TRUE(same(e, added[given])) << given;
        ++given;
        ASSERT_LE(clicks[e.code] += e.kind == Kind::kButton, 1);
        ASSERT_LE(changes[e.code] += e.kind == Kind::kKey && e.code > 128, 1);
      }
    };
    for (int k = 0; k < 60; ++k) {
      const int codes[] = {kTab, kEnter, kShift, kControl, kA, kV};
      const Event e = random() % 3 == 0   ? text('x')
                      : random() % 3 == 0 ? button(static_cast<int>(random() % 2), random() % 2)
                                          : key(codes[random() % 6], random() % 2);
      // Only changes come, as from a window.
      const auto last = std::find_if(added.rbegin(), added.rend(), [&](const Event& a) { return a.kind == e.kind && a.code == e.code; });
      if (e.kind != Kind::kText && (last == added.rend() ? !e.down : last->down == e.down)) continue;
      added.push_back(e);
      queue.add(e);
      if (random() % 4 == 0) look();
    }
    int frames = 0;
    while (!queue.empty() && ++frames < 200) look();
    EXPECT_EQ(given, added.size());
  }
}

TEST(EventQueue, NeverGrowsWithoutBoundAndLetsKeysUp) {
  EventQueue queue;
  queue.add(key(kEnter, true));
  for (int k = 0; k < 5000; ++k) queue.add(text('x'));
  queue.add(key(kEnter, false));
  queue.add(key(-1, true));
  queue.add(key(5000, true));
  queue.add(button(9, true));
  const auto all = queue.all();
  EXPECT_LE(all.size(), EventQueue::kMax + 1);
  EXPECT_EQ(all.back().code, kEnter);
  EXPECT_FALSE(all.back().down);
}

}  // namespace
}  // namespace ridgecast::viewer
