// What is written is read: changes and heights of random squares; every prefix, and any bytes at all, are refused or harmless.
#include "common/points/points.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "tests/support/leaf_meshes.h"
#include "tests/support/sanitized.h"

namespace ridgecast::points {
namespace {

using lattice::LeafAddress;
using support::between;
using support::Random;

// What one payload says, and what both sides know.
struct Said {
  std::vector<LeafAddress> held, fresh, active;
  std::map<LeafAddress, std::uint32_t> counts;
  std::vector<Change> changes;
  struct Height {
    int level;
    std::int32_t before, y;  // before, or the guess
    bool isSure;
  };
  std::vector<Height> raised, inserted;

  std::vector<std::uint8_t> write() const {
    std::vector<std::uint8_t> payload;
    Writer writer(payload);
    std::vector<Change> copy = changes;
    writer.changes(
        {held, fresh, active}, [&](const LeafAddress& a) { return counts.at(a); }, copy);
    for (const Height& h : raised) writer.raised(h.level, h.before, h.y);
    for (const Height& h : inserted) writer.inserted(h.level, h.before, h.isSure, h.y);
    writer.finish();
    return payload;
  }
  bool isRead(std::span<const std::uint8_t> payload) const {
    Reader reader(payload);
    std::vector<Change> read;
    const auto count = [&](const LeafAddress& a) { return counts.contains(a) ? counts.at(a) : 0; };
    if (!reader.changes({held, fresh, active}, count, read) || read.size() != changes.size()) return false;
    for (std::size_t k = 0; k < read.size(); ++k)
      if (read[k].square != changes[k].square || read[k].removed != changes[k].removed || read[k].raised != changes[k].raised ||
          read[k].inserted != changes[k].inserted)
        return false;
    bool same = true;
    for (const Height& h : raised) same = reader.raised(h.level, h.before) == h.y && same;
    for (const Height& h : inserted) same = reader.inserted(h.level, h.before, h.isSure) == h.y && same;
    return same && reader.finished();
  }
};

std::vector<std::uint32_t> some(Random& random, std::uint32_t of, std::int64_t most) {
  std::set<std::uint32_t> out;
  for (auto n = std::min<std::int64_t>(of, between(random, 0, most)); n > 0; --n)
    out.insert(static_cast<std::uint32_t>(between(random, 0, of - 1)));
  return {out.begin(), out.end()};
}

Said anything(Random& random) {
  Said s;
  std::set<LeafAddress> held;
  const auto level = static_cast<std::int32_t>(between(random, 0, 6));
  for (auto n = between(random, 1, 60); n > 0; --n)
    held.insert({level + static_cast<std::int32_t>(between(random, 0, 2)), between(random, -9, 9), between(random, -9, 9)});
  s.held.assign(held.begin(), held.end());
  for (const LeafAddress& leaf : s.held) {
    if (between(random, 0, 5) == 0) s.fresh.push_back(leaf);
    if (between(random, 0, 2) == 0) s.active.push_back(leaf);
  }
  std::vector<LeafAddress> squares = s.held;
  for (auto n = between(random, 0, 3); n > 0; --n) squares.push_back({kOpenLevel, 1000 + n, between(random, -1'000'000, 1'000'000)});
  std::sort(squares.begin() + static_cast<std::ptrdiff_t>(s.held.size()), squares.end());
  for (const LeafAddress& square : squares) {
    const auto before = static_cast<std::uint32_t>(between(random, 0, 90));
    s.counts[square] = before;
    Change change{square, some(random, before, 4), {}, {}};
    change.raised = some(random, before - static_cast<std::uint32_t>(change.removed.size()), 2);
    std::set<Place> places;
    for (auto n = between(random, 0, 5); n > 0; --n) {
      const int bits = between(random, 0, 3) == 0 ? static_cast<int>(between(random, 0, lattice::kFinestSideBits + square.level - 1))
                                                  : lattice::horizontalBits(square.level);
      const auto at = [&] { return static_cast<std::int32_t>(lattice::floorTo(between(random, 0, square.side() - 1), bits)); };
      places.insert({at(), at()});
    }
    change.inserted.assign(places.begin(), places.end());
    if (change.empty()) continue;
    const auto height = [&] {
      const auto y = static_cast<std::int32_t>(between(random, -1, 1) * between(random, 0, lattice::kMaxHeight));
      return between(random, 0, 3) == 0 ? y : lattice::snapHeight(y, square.level);
    };
    for (std::size_t k = 0; k < change.raised.size(); ++k) s.raised.push_back({square.level, height(), height(), false});
    for (std::size_t k = 0; k < change.inserted.size(); ++k)
      s.inserted.push_back({square.level, height(), height(), between(random, 0, 1) == 0});
    s.changes.push_back(std::move(change));
  }
  return s;
}

TEST(Points, WhatIsWrittenIsRead) {
  Random random(1);
  for (int k = 0; k < 2000; ++k) {
    const Said said = anything(random);
    ASSERT_TRUE(said.isRead(said.write())) << k;
  }
}

TEST(Points, AreWrittenAsTheProtocolsExample) {
  Said said;
  said.held = {{0, 0, 0}};
  said.counts[{0, 0, 0}] = 4;
  said.changes = {{{0, 0, 0}, {}, {}, {{256, 256}}}};
  said.inserted = {{0, 0, 100, true}};
  EXPECT_EQ(said.write(), (std::vector<std::uint8_t>{0x30, 0x6f, 0xee, 0xfb, 0x82, 0xc0, 0x97}));
}

TEST(Points, NoPrefixAndNothingLongerIsThePayload) {
  Random random(2);
  for (int k = 0; k < testing_support::rounds(60); ++k) {
    const Said said = anything(random);
    std::vector<std::uint8_t> payload = said.write();
    for (std::size_t n = 0; n < payload.size(); ++n) EXPECT_FALSE(said.isRead({payload.data(), n})) << n << " of " << payload.size();
    payload.push_back(0);
    EXPECT_FALSE(said.isRead(payload));
    payload.pop_back();
    payload.front() ^= 1;
    EXPECT_FALSE(said.isRead(payload)) << "another form";
  }
}

TEST(Points, AnyBytesGiveChangesThatCanBeOrNone) {
  Random random(3);
  int none = 0;
  for (int k = 0; k < 3000; ++k) {
    const Said said = anything(random);
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(between(random, 0, 200)));
    for (std::uint8_t& b : bytes) b = static_cast<std::uint8_t>(between(random, 0, 255));
    if (k % 2 == 0) {
      bytes = said.write();
      bytes[static_cast<std::size_t>(between(random, 0, static_cast<std::int64_t>(bytes.size()) - 1))] ^=
          static_cast<std::uint8_t>(1 << between(random, 0, 7));
    }
    Reader reader(bytes);
    std::vector<Change> changes;
    const auto count = [&](const LeafAddress& a) { return said.counts.contains(a) ? said.counts.at(a) : 7; };
    if (!reader.changes({said.held, said.fresh, said.active}, count, changes)) {
      ++none;
      continue;
    }
    for (const Change& change : changes) {
      const std::uint32_t before = count(change.square);
      EXPECT_TRUE(std::ranges::is_sorted(change.removed) && (change.removed.empty() || change.removed.back() < before));
      EXPECT_TRUE(change.raised.empty() || change.raised.back() < before - change.removed.size());
      for (const Place& p : change.inserted) EXPECT_TRUE(p.x >= 0 && p.z >= 0 && p.x < change.square.side() && p.z < change.square.side());
      EXPECT_EQ(std::ranges::adjacent_find(change.inserted, std::greater_equal{}), change.inserted.end());
    }
  }
  EXPECT_GT(none, 500);
}

}  // namespace
}  // namespace ridgecast::points
