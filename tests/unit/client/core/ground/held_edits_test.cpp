// What a client holds of edits follows those of a session, whoever moves, edits and undoes meanwhile, and however late answers come.
#include "client/core/ground/held_edits.h"

#include <gtest/gtest.h>

#include <deque>
#include <memory>
#include <random>

#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"
#include "common/wire/wire.h"
#include "tests/support/random_edits.h"
#include "tests/support/sanitized.h"

namespace ridgecast::core {
namespace {

using edits::SquareAddress;
using lattice::Point;
using lattice::Step;
using testing_support::m;

constexpr double kReach = 2000;

// Answers as PROTOCOL.md says, when it is told to.
class Session {
 public:
  void edit(edits::Operation operation) {
    auto prepared = history_.prepare(std::move(operation));
    if (!prepared) return;
    const auto changed = history_.add(*prepared);
    ASSERT_TRUE(changed) << changed.error().message;
    areas_.push_back(edits::groundOf(*changed));
  }
  std::uint64_t last() const { return history_.last(); }
  const std::shared_ptr<const edits::Layer>& layer() const { return history_.layer(); }
  void ask(HeldEdits& held) {
    auto [find, want] = held.take();
    EXPECT_LE(want.squares.size(), wire::kMaxSquares);
    if (find) questions_.push_back(*find);
    if (!want.squares.empty()) questions_.push_back(want);
    asked += want.squares.size();
  }
  void answer(HeldEdits& held) {
    if (questions_.empty()) return;
    const auto question = questions_.front();
    questions_.pop_front();
    if (const auto* find = std::get_if<wire::FindEdits>(&question)) {
      wire::FoundEdits found{last(), {}, {}};
      if (find->radius > 0) found.squares = edits::squaresAround(*layer(), find->at, find->radius, wire::kMaxFoundSquares);
      if (last() - find->since > wire::kMaxFoundAreas)
        found.changed = {{-m(1e13), -m(1e13), m(1e13), m(1e13)}};
      else
        found.changed.assign(areas_.begin() + static_cast<std::ptrdiff_t>(find->since), areas_.end());
      ASSERT_TRUE(held.put(found));
      return;
    }
    wire::Squares squares{last(), {}};
    for (const SquareAddress a : std::get<wire::WantSquares>(question).squares) {
      auto bytes = edits::encode(edits::squareOf(*layer(), a));
      squares.squares.push_back({a, std::move(bytes.rises), std::move(bytes.materials)});
    }
    const auto put = held.put(squares);
    ASSERT_TRUE(put) << put.error().message;
  }
  void forget() { questions_.clear(); }
  void complete(HeldEdits& held) {
    for (int k = 0; !held.complete(); ++k) {
      ASSERT_LT(k, 10'000);
      ask(held);
      answer(held);
    }
  }
  std::size_t asked = 0;

 private:
  edits::History history_{terrain::create("alpine", 1).value()};
  std::vector<lattice::Area> areas_;
  std::deque<std::variant<wire::FindEdits, wire::WantSquares>> questions_;
};

void expectEqual(const edits::Layer& held, const edits::Layer& all, Point camera) {
  for (const SquareAddress a : edits::squaresAround(all, camera, kReach, 100'000)) {
    const auto left = edits::squareOf(held, a), right = edits::squareOf(all, a);
    ASSERT_TRUE(left.rises == right.rises && left.materials == right.materials) << a.i << ", " << a.j;
  }
  for (const SquareAddress a : edits::squaresAround(held, camera, kReach, 100'000))
    ASSERT_TRUE(edits::squareOf(all, a).rises == edits::squareOf(held, a).rises);
}

TEST(HeldEdits, FollowTheSessionWhateverHappens) {
  std::mt19937_64 random(3);
  Session session;
  HeldEdits held(kReach);
  Point camera{m(1e9), 0};
  held.moveTo(camera);
  EXPECT_TRUE(held.complete());
  const auto uniform = [&](double from, double to) { return std::uniform_real_distribution<double>(from, to)(random); };
  constexpr unsigned kSteps = testing_support::kSanitized ? 500 : 1500;
  for (unsigned k = 0; k < kSteps; ++k) {
    const Point near{camera.x + m(uniform(-400, 400)), camera.z + m(uniform(-400, 400))};
    switch (random() % 6) {
      case 0:
        session.edit(random() % 4 ? testing_support::randomOperation(random, near)
                                  : edits::Operation{edits::Undo{1 + random() % (session.last() + 1)}, 0});
        if (random() % 2) held.know(session.last());
        break;
      case 1:
        camera = {camera.x + m(uniform(-300, 320)), camera.z + m(uniform(-300, 300))};
        held.moveTo(camera);
        break;
      case 2:
        session.ask(held);
        break;
      default:
        session.answer(held);
    }
    if (k % 300 == 299) {  // another connection
      session.forget();
      held.reconnected(session.last());
    }
    if (k % 250 != 249) continue;
    held.know(session.last());
    session.complete(held);
    expectEqual(*held.layer(), *session.layer(), camera);
    for (const auto& [a, version] : held.squares())
      EXPECT_FALSE(edits::encode(edits::squareOf(*held.layer(), a)).rises.empty() &&
                   edits::encode(edits::squareOf(*held.layer(), a)).materials.empty());
  }
  EXPECT_GT(session.asked, kSteps / 8);
}

TEST(HeldEdits, AskNothingMoreWhenTheyAreComplete) {
  Session session;
  HeldEdits held(kReach);
  for (int k = 0; k < 8; ++k) session.edit({edits::Crater{{m(100) * k, 0}, m(20), static_cast<std::int32_t>(m(4))}, 0});
  held.moveTo({0, 0});
  held.know(session.last());
  session.complete(held);
  const std::size_t before = session.asked;
  const std::uint64_t version = held.version();
  session.ask(held);
  EXPECT_EQ(session.asked, before);
  // One more edit: only what it changed is asked for.
  session.edit({edits::Crater{{m(300), m(10)}, m(5), static_cast<std::int32_t>(m(4))}, 0});
  held.know(session.last());
  session.complete(held);
  EXPECT_LE(session.asked - before, 4u);
  EXPECT_GT(held.version(), version);
  // Far from all of them nothing is held.
  held.moveTo({m(10'000), 0});
  session.complete(held);
  EXPECT_TRUE(held.layer()->empty());
  EXPECT_TRUE(held.squares().empty());
}

TEST(HeldEdits, HoldTheNearestOfMany) {
  Session session;
  HeldEdits held(4000);
  for (int j = -20; j <= 20; ++j)
    for (int i = -20; i <= 20; ++i) session.edit({edits::Raise{{m(128) * i + m(32), m(128) * j + m(32)}, m(2), 0, 256}, 3});
  held.moveTo({0, 0});
  held.know(session.last());
  session.complete(held);
  EXPECT_EQ(held.squares().size(), HeldEdits::kMaxHeld);
  EXPECT_NE(held.layer()->riseAt(64, 64), 0);
  held.moveTo({m(1200), m(1200)});
  session.complete(held);
  EXPECT_EQ(held.squares().size(), HeldEdits::kMaxHeld);
  EXPECT_NE(held.layer()->riseAt(256 * 9 + 64, 256 * 9 + 64), 0);
}

TEST(HeldEdits, OfAServerThatLostItsEditsAreDropped) {
  Session session;
  HeldEdits held(kReach);
  session.edit({edits::Crater{{0, 0}, m(20), static_cast<std::int32_t>(m(4))}, 0});
  held.moveTo({0, 0});
  held.know(1);
  session.complete(held);
  EXPECT_FALSE(held.layer()->empty());
  held.reconnected(0);
  EXPECT_TRUE(held.layer()->empty());
  EXPECT_TRUE(held.complete());
}

// The session ended with its edits, and others have made as many since then.
TEST(HeldEdits, OfASessionThatBeganAnewAreReplaced) {
  Session before, after;
  HeldEdits held(kReach);
  before.edit({edits::Crater{{0, 0}, m(20), static_cast<std::int32_t>(m(4))}, 0});
  before.edit({edits::Raise{{m(300), 0}, m(20), 0, 512}, 0});
  held.moveTo({0, 0});
  held.know(before.last());
  before.complete(held);
  after.edit({edits::Raise{{m(20), 0}, m(20), 0, 256}, 0});
  after.edit({edits::Raise{{0, m(600)}, m(20), 0, 256}, 0});
  held.reconnected(after.last());
  EXPECT_FALSE(held.complete());
  expectEqual(*held.layer(), *before.layer(), {0, 0});  // until the new ground has come
  after.complete(held);
  expectEqual(*held.layer(), *after.layer(), {0, 0});
}

// The server answered before the edit that filled it.
TEST(HeldEdits, ASquareThatWasEmptyBeforeALaterEditIsAskedForAgain) {
  HeldEdits held(kReach);
  held.know(1);
  ASSERT_TRUE(held.take().find);
  ASSERT_TRUE(held.put(wire::FoundEdits{1, {}, {{0, 0}}}));
  ASSERT_EQ(held.take().want.squares.size(), 1u);
  held.know(2);
  ASSERT_TRUE(held.take().find);
  ASSERT_TRUE(held.put(wire::FoundEdits{2, {{0, 0, 10, 10}}, {}}));
  ASSERT_TRUE(held.put(wire::Squares{1, {{{0, 0}, {}, {}}}}));
  EXPECT_FALSE(held.complete());
  EXPECT_EQ(held.take().want.squares.size(), 1u);
  ASSERT_TRUE(held.put(wire::Squares{2, {{{0, 0}, {}, {}}}}));
  EXPECT_TRUE(held.take().want.squares.empty());
  EXPECT_TRUE(held.complete());
}

TEST(HeldEdits, RefuseWhatWasNotAskedFor) {
  HeldEdits held(kReach);
  EXPECT_FALSE(held.put(wire::FoundEdits{}));
  EXPECT_FALSE(held.put(wire::Squares{1, {{{0, 0}, {}, {}}}}));
  held.know(1);
  ASSERT_TRUE(held.take().find);
  ASSERT_TRUE(held.put(wire::FoundEdits{1, {}, {{0, 0}}}));
  ASSERT_EQ(held.take().want.squares.size(), 1u);
  EXPECT_FALSE(held.put(wire::Squares{1, {{{0, 0}, {1, 2, 3}, {}}}}));
}

}  // namespace
}  // namespace ridgecast::core
