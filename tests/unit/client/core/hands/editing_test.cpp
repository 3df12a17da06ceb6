// The edit mode without a window or a page: what a brush makes, how edits wait for their answers, and what an undo undoes.
#include "client/core/hands/editing.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/edits/json.h"

namespace ridgecast::core {
namespace {

using Json = nlohmann::json;

struct Page {
  std::vector<wire::Edit> sent;
  std::vector<std::string> said;
  int keys = 0;
  Editing editing{{[this](const wire::Edit& edit) { sent.push_back(edit); },
                   [this](const std::string& sentence) { said.push_back(sentence); }, [this] { return "key " + std::to_string(++keys); }}};
  Json operation() const { return Json::parse(sent.back().operation); }
  void answer(std::uint64_t number) { editing.hear(sent.back().id, number); }
  void refuse(const std::string& why) { editing.hear(sent.back().id, Error{why}); }
};

lattice::Vertex place(double x, double z, double y = 0) {
  const auto steps = [](double metres) { return std::llround(256 * metres); };
  return {steps(x), steps(z), static_cast<std::int32_t>(steps(y))};
}

TEST(Editing, EachToolMakesItsOperationInMetres) {
  Page page;
  page.editing.use(place(10.5, -4));
  EXPECT_EQ(page.operation(),
            (Json{{"op", "crater"}, {"x", 10.5}, {"z", -4.0}, {"radius", 8.0}, {"depth", std::round(8 * 256 / 3.0) / 256}}));
  for (const auto& [tool, op] : {std::pair(Tool::kRaise, "raise"), std::pair(Tool::kLower, "lower")}) {
    page.editing.choose(tool);
    page.editing.use(place(1, 2));
    EXPECT_EQ(page.operation()["op"], op);
    EXPECT_EQ(page.operation()["by"], 2);
    EXPECT_EQ(page.operation()["radius"], 8);
  }
  page.editing.choose(Tool::kLevel);
  page.editing.use(place(1, 2, 310.001));
  EXPECT_EQ(page.operation()["height"], 310);
  EXPECT_EQ(page.operation()["radius"], 8);
  page.editing.choose(Tool::kSmooth);
  page.editing.use(place(1, 2));
  EXPECT_EQ(page.operation(), (Json{{"op", "smooth"}, {"x", 1.0}, {"z", 2.0}, {"radius", 8.0}, {"passes", 8}}));
  // Far away too, to the step; and the server takes all of them.
  page.editing.use({lattice::kMaxPosition - 1, 1 - lattice::kMaxPosition, 0});
  EXPECT_EQ(page.operation()["x"].get<double>() * 256, static_cast<double>(lattice::kMaxPosition - 1));
  for (const wire::Edit& edit : page.sent) EXPECT_TRUE(edits::fromJson(edit.operation) || edit.id == page.sent.back().id) << edit.operation;
}

TEST(Editing, AnEditHasTheMaterialOfTheBrush) {
  Page page;
  page.editing.paint(6);
  page.editing.use(place(0, 0));
  EXPECT_EQ(page.operation()["material"], "asphalt");
  page.answer(1);
  page.editing.undo();
  EXPECT_FALSE(page.operation().contains("material"));
  page.editing.paint(0);
  page.editing.use(place(0, 0));
  EXPECT_FALSE(page.operation().contains("material"));
}

TEST(Editing, TheRadiusKeepsToWhatTheServerTakesOfEachTool) {
  Page page;
  for (const auto& [tool, most] : {std::pair(Tool::kCrater, 256), std::pair(Tool::kSmooth, 64), std::pair(Tool::kRoad, 32)}) {
    page.editing.choose(tool);
    page.editing.widen(1000);
    EXPECT_EQ(page.editing.radius(), most * 256);
    page.editing.widen(-1000);
    EXPECT_EQ(page.editing.radius(), 128);
    for (int k = 0; k < 50; ++k) {
      const lattice::Step before = page.editing.radius();
      page.editing.widen(1);
      EXPECT_TRUE(page.editing.radius() > before || before == most * 256);
    }
  }
  page.editing.choose(Tool::kCrater);
  page.editing.widen(1000);
  page.editing.choose(Tool::kSmooth);
  EXPECT_EQ(page.editing.radius(), 64 * 256) << "another tool brings it within its own";
}

TEST(Editing, SaysWhatTheBrushDoes) {
  Page page;
  EXPECT_EQ(page.editing.words(), "radius 8 m, 2.7 m deep");
  page.editing.widen(1000);
  EXPECT_EQ(page.editing.words(), "radius 260 m, 85 m deep");
  page.editing.choose(Tool::kSmooth);
  EXPECT_EQ(page.editing.words(), "radius 64 m");
  page.editing.choose(Tool::kRoad);
  EXPECT_EQ(page.editing.words(), "64 m wide, click its corners");
  page.editing.use(place(0, 0));
  EXPECT_EQ(page.editing.words(), "64 m wide, double click ends it");
}

TEST(Editing, ARoadHasTheCornersThatWereClickedAndNoDoubleClickTwice) {
  Page page;
  Editing& editing = page.editing;
  editing.choose(Tool::kRoad);
  editing.use(place(0, 0));
  editing.endRoad();
  EXPECT_TRUE(page.sent.empty());
  EXPECT_NE(page.said.at(0).find("at least two corners"), std::string::npos);
  editing.use(place(100, 0));
  editing.use(place(900, 0));
  editing.undo();  // the last corner
  editing.use(place(100, 60));
  editing.use(place(100.1, 60));
  editing.endRoad();
  EXPECT_EQ(page.operation()["line"], Json::parse("[[0.0, 0.0], [100.0, 0.0], [100.0, 60.0]]"));
  EXPECT_EQ(page.operation()["width"], 16);
  EXPECT_TRUE(edits::fromJson(page.sent.back().operation));
  EXPECT_TRUE(editing.corners().empty());
  editing.use(place(0, 0));
  editing.choose(Tool::kCrater);
  editing.endRoad();
  EXPECT_EQ(page.sent.size(), 1u) << "another tool leaves the road";
  editing.choose(Tool::kRoad);
  for (std::size_t k = 0; k < edits::kMaxCorners + 5; ++k) editing.use(place(static_cast<double>(k), 0));
  EXPECT_EQ(editing.corners().size(), edits::kMaxCorners);
  EXPECT_NE(page.said.back().find("at most 256 corners"), std::string::npos);
}

TEST(Editing, SaysWhatTheServerAnswers) {
  Page page;
  page.editing.use(place(0, 0));
  page.answer(17);
  page.editing.use(place(0, 0));
  page.refuse("Too large.");
  page.refuse("Too large.");  // an answer that comes twice counts once
  EXPECT_EQ(page.said, (std::vector<std::string>{"Edit 17 made.", "Too large."}));
}

TEST(Editing, AnUndoIsOfOnesOwnLastEditThatCounts) {
  Page page;
  const auto undoes = [&page] { return page.operation()["edit"].get<int>(); };
  page.editing.use(place(0, 0));
  page.editing.use(place(0, 0));
  page.editing.hear(2, std::uint64_t{5});  // answers come in any order
  page.editing.hear(1, std::uint64_t{3});
  page.editing.use(place(0, 0));
  page.answer(9);
  page.editing.undo();
  EXPECT_EQ(undoes(), 9);
  page.answer(10);
  EXPECT_EQ(page.said.back(), "Edit 9 undone.");
  // Somebody else has undone 5: then 3 is the last. A road that was begun meanwhile keeps its corner.
  page.editing.undo();
  EXPECT_EQ(undoes(), 5);
  page.editing.choose(Tool::kRoad);
  page.editing.use(place(0, 0));
  page.refuse("Edit 5 is undone already; undo the edit that undid it to have it back.");
  EXPECT_EQ(undoes(), 3);
  EXPECT_EQ(page.editing.corners().size(), 1u);
  page.editing.rest();
  // A server that has no time now leaves it to be undone.
  page.refuse("The edits of this client look at too many posts; try again.");
  EXPECT_NE(page.said.back().find("too many posts"), std::string::npos);
  EXPECT_TRUE(page.editing.mayUndo());
  page.editing.undo();
  EXPECT_EQ(undoes(), 3);
  page.answer(12);
  EXPECT_FALSE(page.editing.mayUndo());
  const std::size_t count = page.sent.size();
  page.editing.undo();
  EXPECT_EQ(page.sent.size(), count);
  EXPECT_EQ(page.said.back(), "You have no edit to undo.");
}

TEST(Editing, WhatIsNotAnsweredGoesAgainOverTheNextConnectionWithItsKeyAFewTimes) {
  Page page;
  page.editing.use(place(0, 0));
  page.editing.connected();
  ASSERT_EQ(page.sent.size(), 2u);
  EXPECT_EQ(page.sent[1].key, page.sent[0].key);
  EXPECT_EQ(page.sent[1].operation, page.sent[0].operation);
  page.answer(4);
  page.editing.connected();
  EXPECT_EQ(page.sent.size(), 2u) << "what is answered does not";
  page.editing.use(place(0, 0));
  EXPECT_NE(page.sent[2].key, page.sent[0].key);
  for (int k = 0; k < 9; ++k) page.editing.connected();
  EXPECT_EQ(page.sent.size(), 5u);
  EXPECT_NE(page.said.back().find("check whether it was made"), std::string::npos);
}

TEST(Editing, AProgramsEditsWaitInTheSameList) {
  Page page;
  std::vector<std::string> heard;
  const auto make = [&] {
    page.editing.make(R"({"op":"raise"})",
                      [&](const Outcome<std::uint64_t>& made) { heard.push_back(made ? std::to_string(*made) : made.error().message); });
  };
  make();
  page.editing.connected();
  ASSERT_EQ(page.sent.size(), 2u);
  EXPECT_EQ(page.sent[1].key, page.sent[0].key);
  EXPECT_EQ(page.sent[1].operation, R"({"op":"raise"})");
  page.answer(4);
  page.answer(4);
  make();
  page.refuse("Too large.");
  EXPECT_EQ(heard, (std::vector<std::string>{"4", "Too large."}));
  EXPECT_FALSE(page.editing.mayUndo());
  EXPECT_TRUE(page.said.empty());
  make();
  for (int k = 0; k < 9; ++k) page.editing.connected();
  EXPECT_EQ(page.sent.size(), 6u);
  EXPECT_NE(heard.back().find("check whether it was made"), std::string::npos);
  for (std::size_t k = 0; k <= Editing::kMaxWaiting; ++k) make();
  ASSERT_EQ(heard.size(), 4u);
  EXPECT_NE(heard.back().find("256 edits wait"), std::string::npos);
  page.editing.leave();
  EXPECT_EQ(heard.size(), 4 + Editing::kMaxWaiting);
  EXPECT_NE(heard.back().find("another session"), std::string::npos);
}

TEST(Editing, OnlySoManyWait) {
  Page page;
  page.editing.choose(Tool::kRoad);
  for (std::size_t k = 0; k <= Editing::kMaxOpen; ++k) {
    page.editing.use(place(0, 0));
    page.editing.use(place(10, 0));
    page.editing.endRoad();
  }
  EXPECT_EQ(page.sent.size(), Editing::kMaxOpen);
  EXPECT_NE(page.said.back().find("try again in a moment"), std::string::npos);
  EXPECT_EQ(page.editing.corners().size(), 2u) << "the road that was refused is still there";
}

}  // namespace
}  // namespace ridgecast::core
