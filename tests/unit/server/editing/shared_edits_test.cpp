// Several servers' edits of one session, through an engine that fails: one order, one ground, each acknowledged edit in it, none twice.
#include "tests/unit/server/editing/shared_edits.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/crater.h"

namespace ridgecast::editing {
namespace {

using testing::HasSubstr;
using testing_support::craterAt;
using testing_support::m;
using Why = Edits::Answer::Why;

TEST(SharedEdits, OfOneServerAreThoseOfAll) {
  Rig rig(3);
  const auto first = rig[0].ask(craterAt(0), "ann", "k");
  rig.run(50ms);
  ASSERT_TRUE(*first);
  EXPECT_EQ((*first)->value(), 1u);
  const auto second = rig[1].ask(craterAt(50), "bob");
  rig.run(50ms);
  EXPECT_EQ((*second)->value(), 2u);
  const auto again = rig[2].ask(craterAt(0), "ann", "k"), other = rig[2].ask(craterAt(9), "ann", "k");
  rig.run(50ms);
  EXPECT_EQ((*again)->value(), 1u);
  ASSERT_FALSE(**other);
  EXPECT_EQ((*other)->why, Why::kWrong);
  rig.expectOneGround();
  for (const auto& machine : rig.all) {
    EXPECT_EQ(machine->disk->edits.size(), 2u);
    ASSERT_EQ(machine->noted.size(), 2u) << "a recording has them all";
    EXPECT_EQ(machine->noted[0].author, "ann");
    EXPECT_EQ(machine->noted[1].author, "bob");
  }
}

TEST(SharedEdits, SayHowFarBehindAServerIs) {
  Rig rig(2);
  EXPECT_EQ(rig[1].edits->behind(), 0u);
  const auto first = rig[0].ask(craterAt(0)), second = rig[0].ask(craterAt(50));
  for (int k = 0; k < 20; ++k) rig[0].work(), rig.world.timer.advance(1ms);  // the other hears of them, and does nothing yet
  ASSERT_TRUE(*first && *second);
  EXPECT_EQ(rig[0].edits->behind(), 0u);
  EXPECT_EQ(rig[1].edits->behind(), 2u);
  rig.run(50ms);
  EXPECT_EQ(rig[1].edits->behind(), 0u);
}

TEST(SharedEdits, ThatRaceAreAllMade) {
  Rig rig(4);
  rig.world.engine.slow(3ms, 2ms);
  std::vector<Machine::Said> said;
  for (int round = 0; round < 20; ++round) {
    for (std::size_t k = 0; k < 4; ++k)
      for (int n = 0; n < 3; ++n) said.push_back(rig[k].ask(craterAt(static_cast<double>(said.size()) * 3)));
    rig.run(5ms);
  }
  rig.run(2s);
  std::set<std::uint64_t> numbers;
  for (const auto& one : said) {
    ASSERT_TRUE(*one);
    ASSERT_TRUE(**one) << (*one)->error().message;
    EXPECT_TRUE(numbers.insert((*one)->value()).second);
  }
  EXPECT_EQ(*numbers.rbegin(), said.size());
  rig.expectOneGround();
}

// It has seen what the log had 15 ms ago, and the others append all the time.
TEST(SharedEdits, OfASlowServerHaveTheirTurn) {
  Rig rig(3);
  rig.world.engine.slow(1ms);
  std::vector<Machine::Said> busy(2), slow;
  for (int turn = 0; turn < 3; ++turn) {
    slow.push_back(rig[2].ask(craterAt(9 * turn)));
    for (int t = 0; t < 1000 && !*slow.back(); ++t) {
      for (std::size_t k = 0; k < 2; ++k) {
        if (!busy[k] || *busy[k]) busy[k] = rig[k].ask(craterAt(t % 50));
        rig[k].work();
      }
      if (t % 15 == 0) rig[2].work();
      rig.world.timer.advance(1ms);
    }
    ASSERT_TRUE(*slow.back()) << "it always lost";
    EXPECT_TRUE(**slow.back());
  }
  rig.run(1s);
  rig.expectOneGround();
  EXPECT_GT(rig[0].edits->ground().edit, 20u) << "the others went on";
}

// The first append is still on its way when the log is read, and the second follows it.
TEST(SharedEdits, WhoseAppendIsLateAreMadeOnce) {
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Rig rig(2, seed);
    rig.world.engine.slow(100ms);
    const auto made = rig[0].ask(craterAt(0));  // has no key
    rig.work();
    rig.world.engine.cut(*rig[0].bus);
    rig.world.engine.mend(*rig[0].bus);
    rig.run(5s);
    ASSERT_TRUE(*made);
    ASSERT_TRUE(**made) << (*made)->error().message;
    ASSERT_EQ(rig.world.engine.last("world"), 1u);
    rig.expectOneGround();
  }
}

// Its client has sent it to both, since the first did not answer.
TEST(SharedEdits, AreLookedUpAgainWhereOthersCameBetween) {
  Rig rig(2);
  rig.world.engine.slow(1ms);
  const auto first = rig[0].ask(craterAt(0));
  rig.run(1s);
  ASSERT_TRUE(*first);
  // What comes after an undo waits for the next batch, and its key is known to be new.
  const auto before = rig[0].ask(craterAt(20)), undo = rig[0].ask({edits::Undo{1}, 0});
  const auto here = rig[0].ask(craterAt(40), "ann", "key");
  rig[0].work();
  const auto runTheOther = [&](std::uint64_t until) {
    for (rig[1].work(); rig.world.engine.last("world") < until || rig[1].edits->ground().edit < until; rig[1].work())
      ASSERT_TRUE(rig.world.timer.step(rig.world.timer.now() + 1s));
  };
  runTheOther(2);
  const auto there = rig[1].ask(craterAt(40), "ann", "key");
  runTheOther(3);
  rig.run(1s);
  ASSERT_TRUE(*before && *undo && *here && *there);
  EXPECT_EQ((*here)->value(), 3u);
  EXPECT_EQ((*there)->value(), 3u);
  EXPECT_EQ((*undo)->value(), 4u);
  rig.expectOneGround();
}

// An edit that a member of one server has seen can be undone on another, which has not.
TEST(SharedEdits, AreRefusedOnlyWhereTheLogEnds) {
  Rig rig(2);
  rig.world.engine.slow(20ms);
  const auto made = rig[0].ask(craterAt(0));
  while (rig.world.engine.last("world") == 0) rig.run(1ms);
  EXPECT_EQ(rig[1].edits->behind(), 0u) << "it has not heard of it";
  const auto undone = rig[1].ask({edits::Undo{1}, 0}), wrong = rig[1].ask({edits::Undo{7}, 0});
  rig.run(1s);
  ASSERT_TRUE(*undone) << rig[1].edits->ground().edit;
  ASSERT_TRUE(*wrong);
  EXPECT_EQ((*undone)->value(), 2u);
  ASSERT_FALSE(**wrong);
  EXPECT_THAT((*wrong)->error().message, HasSubstr("There is no edit 7"));
  rig.expectOneGround();
}

TEST(SharedEdits, AreRefusedForNowWhileTheEngineIsAway) {
  Rig rig(2);
  EXPECT_TRUE(*rig[0].ask(craterAt(0)) == std::nullopt);
  rig.run(50ms);
  rig.world.engine.stop();
  rig.run(10ms);
  const auto refused = rig[0].ask(craterAt(5), "ann", "k");
  ASSERT_TRUE(*refused);
  ASSERT_FALSE(**refused);
  EXPECT_EQ((*refused)->why, Why::kEarly);
  EXPECT_EQ(rig[0].edits->ground().edit, 1u) << "the ground stays";
  EXPECT_TRUE(rig[0].edits->isCurrent());
  rig.world.engine.start();
  rig.run(50ms);
  const auto made = rig[1].ask(craterAt(5), "ann", "k");
  rig.run(50ms);
  EXPECT_EQ((*made)->value(), 2u);
  rig.world.engine.fill();
  const auto full = rig[0].ask(craterAt(9));
  rig.run(50ms);
  ASSERT_FALSE(**full);
  EXPECT_EQ((*full)->why, Why::kFull);
  rig.world.engine.empty();
  rig.run(50ms);
  rig.expectOneGround();
}

// Until it is known whether it is made: it is never made twice, and always answered.
TEST(SharedEdits, WithoutAnAnswerStayOpenUntilTheLogCanBeRead) {
  int arrived = 0, lost = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Rig rig(2, seed);
    rig.world.engine.slow(5ms);
    const auto said = rig[0].ask(craterAt(0));  // without a key
    rig.run(3ms);
    rig.world.engine.stop();  // what was on its way may arrive, or not
    rig.run(50ms);
    EXPECT_FALSE(*said);
    rig.world.engine.log("world").empty() ? ++lost : ++arrived;
    rig.run(1s);
    rig.world.engine.start();
    rig.run(1s);
    ASSERT_TRUE(*said);
    ASSERT_TRUE(**said) << (*said)->error().message;
    EXPECT_EQ((*said)->value(), 1u);
    EXPECT_EQ(rig.world.engine.log("world").size(), 1u);
    rig.expectOneGround();
  }
  EXPECT_GT(arrived, 0);
  EXPECT_GT(lost, 0);
}

TEST(SharedEdits, ThatTheEngineLosesAreBroughtBack) {
  Rig rig(3);
  std::vector<Machine::Said> said;
  for (int k = 0; k < 12; ++k) {
    said.push_back(rig[static_cast<std::size_t>(k % 3)].ask(craterAt(9 * k)));
    rig.run(20ms);
  }
  rig.world.engine.loseEnd("world", 5);
  const auto early = rig[0].ask(craterAt(200));
  rig.run(3s);
  EXPECT_EQ(rig.world.engine.log("world").size(), 12u + (**early ? 1u : 0u));
  rig.expectOneGround();
  for (const auto& machine : rig.all) EXPECT_FALSE(machine->hasLeft);
}

// A server that was cut off while the others went on without its last edits.
TEST(SharedEdits, ThatAreNotTheLogsAreSetAsideAndTheSessionLeaves) {
  Rig rig(2);
  rig[0].ask(craterAt(0));
  rig.run(50ms);
  rig.world.engine.cut(*rig[1].bus);
  const auto made = rig[0].ask(craterAt(9));
  rig.run(50ms);
  ASSERT_TRUE(**made);
  rig.world.engine.cut(*rig[0].bus);
  rig.world.engine.loseEnd("world", 1);
  rig.world.engine.mend(*rig[1].bus);
  rig.run(3s);
  const auto other = rig[1].ask(craterAt(18));
  rig.run(50ms);
  EXPECT_EQ((*other)->value(), 2u);
  rig.world.engine.mend(*rig[0].bus);
  rig.run(1s);
  EXPECT_TRUE(rig[0].hasLeft);
  EXPECT_TRUE(rig[0].edits->isOver());
  EXPECT_EQ(rig[0].disk->setAside, 1);
  EXPECT_FALSE(rig[1].hasLeft);
  rig[0].kill();
  rig[0].start();
  rig.run(1s);
  rig.expectOneGround();
}

TEST(SharedEdits, OfAWorldThatLivedOnOneServerMoveToMany) {
  World world;
  auto first = std::make_unique<Machine>(world);
  first->kill();
  edits::History history(world.terrain);
  for (int k = 0; k < 300; ++k) {
    const auto changed = history.add(craterAt(3 * k)).value();
    first->disk->edits.push_back(
        {history.last(), "ann\n" + std::to_string(k), "ann", k, std::string(history.packed(history.last())), edits::groundOf(changed)});
  }
  Rig rig(0);
  rig.all.push_back(std::make_unique<Machine>(rig.world));
  rig[0].kill();
  rig[0].disk->edits = first->disk->edits;
  rig[0].start();
  rig.all.push_back(std::make_unique<Machine>(rig.world));
  rig.run(1s);
  EXPECT_EQ(rig.world.engine.log("world").size(), 300u);
  rig.expectOneGround();
  const auto again = rig[1].ask(craterAt(3), "ann", "1");
  rig.run(50ms);
  EXPECT_EQ((*again)->value(), 2u);
}

// What the log has is made, whatever becomes of a server's copy.
TEST(SharedEdits, AreMadeThoughADiskIsFull) {
  Rig rig(2);
  rig[0].ask(craterAt(0));
  rig.run(50ms);
  rig[0].disk->fails = true;
  const auto made = rig[0].ask(craterAt(9), "ann", "k");
  rig.run(50ms);
  EXPECT_EQ((*made)->value(), 2u);
  rig[1].ask(craterAt(18));
  rig.run(50ms);
  rig.expectOneGround();
  EXPECT_EQ(rig[0].disk->edits.size(), 1u);
  const auto again = rig[0].ask(craterAt(9), "ann", "k");
  std::vector<Applied> read;
  rig[0].edits->read(0, 1 << 20, [&](Outcome<std::vector<Applied>> edits) { read = std::move(edits.value()); });
  std::vector<Applied> rest;
  rig[0].edits->read(2, 1 << 20, [&](Outcome<std::vector<Applied>> edits) { rest = std::move(edits.value()); });
  rig.run(50ms);
  EXPECT_EQ((*again)->value(), 2u) << "its key is known";
  EXPECT_EQ(read.size(), 1u) << "a page from the disk";
  ASSERT_EQ(rest.size(), 1u) << "a page from memory";
  EXPECT_EQ(rest[0].number, 3u);
  rig[0].disk->fails = false;
  rig[1].ask(craterAt(27));
  rig.run(50ms);
  EXPECT_EQ(rig[0].disk->edits.size(), 4u) << "the copy is complete again";
  rig.expectOneGround();
}

// Of a program that makes other ground of equal edits.
TEST(SharedEdits, WhoseGroundDiffersLeave) {
  Rig rig(2);
  rig[1].kill();
  rig[1].world.terrain = terrain::create("alpine", 2).value();
  rig[1].start();
  rig.run(50ms);
  const edits::Operation level{edits::Level{{{0, 0}}, m(20), static_cast<std::int32_t>(m(2000)), 256}, 0};
  rig[0].ask(level);
  rig.run(100ms);
  EXPECT_EQ(rig[1].edits->ground().edit, 1u);
  for (std::uint64_t n = 2; n <= GroundCheck::kEvery; ++n) {
    rig[0].ask(craterAt(static_cast<double>(n % 100) * 20, 200));
    if (n % 100 == 0) rig.run(100ms);
  }
  rig.run(2s);
  EXPECT_TRUE(rig[1].hasLeft);
  EXPECT_FALSE(rig[0].hasLeft);
  EXPECT_EQ(rig[1].disk->setAside, 1);
  rig[0].world.terrain = terrain::create("alpine", 1).value();
}

// Of a newer version, or damaged: this server cannot know what the ground is then.
TEST(SharedEdits, EndWhereAnEntryCannotBeRead) {
  Rig rig(2);
  rig[0].ask(craterAt(0));
  rig.run(50ms);
  const auto newer = rig.world.engine.connect();
  newer->append("world", 1, {"an entry of a form to come"}, bus::Bus::Origin::kNew, [](const bus::Appended&) {});
  rig.run(50ms);
  for (const auto& machine : rig.all) {
    const auto refused = machine->ask(craterAt(9));
    rig.run(50ms);
    ASSERT_TRUE(*refused);
    ASSERT_FALSE(**refused);
    EXPECT_THAT((*refused)->error().message, HasSubstr("takes no edits on this server"));
    EXPECT_EQ(machine->edits->ground().edit, 1u);
    EXPECT_FALSE(machine->hasLeft);
  }
  EXPECT_EQ(rig.world.engine.log("world").size(), 2u);
}

}  // namespace
}  // namespace ridgecast::editing
