#include "tests/unit/server/bus/laws.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <atomic>
#include <random>
#include <set>
#include <thread>

namespace ridgecast::bus {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::Not;
using testing::UnorderedElementsAre;
using Kind = Appended::Kind;
using Origin = Bus::Origin;

TEST_P(LawsOfTheBus, GiveEachServerItsOwnNumber) {
  std::vector<std::shared_ptr<Bus>> all;
  std::set<std::uint32_t> numbers;
  for (int i = 0; i < 5; ++i) {
    all.push_back(connect());
    numbers.insert(all.back()->server());
    EXPECT_FALSE(all.back()->isAway());
    if (i == 2) all.erase(all.begin());  // one that left keeps its number
  }
  EXPECT_EQ(numbers.size(), 5u);
  EXPECT_GT(*numbers.begin(), 0u);
  EXPECT_LT(*numbers.rbegin(), 1u << 20);
}

TEST_P(LawsOfTheBus, NumberEntriesFromOneWithoutGaps) {
  const auto a = connect(), b = connect();
  EXPECT_THAT(all(*a, "log"), IsEmpty());
  EXPECT_EQ(append(*a, "log", 0, {"one", "two", "three"}).last, 3u);
  EXPECT_EQ(append(*b, "log", 3, {"four"}).last, 4u);
  EXPECT_THAT(all(*a, "log"), ElementsAre("one", "two", "three", "four"));
  EXPECT_THAT(all(*a, "another"), IsEmpty());
  for (const std::uint64_t after : {0, 3, 5, 1000}) {
    const Appended refused = append(*b, "log", after, {"no", "no"});
    EXPECT_EQ(refused.kind, Kind::kBehind);
    EXPECT_EQ(refused.last, 4u);
  }
  EXPECT_EQ(append(*b, "another", 4, {"no"}).last, 0u);
  EXPECT_THAT(all(*b, "log"), ElementsAre("one", "two", "three", "four"));
}

// Bytes of every value, none, and many; names that other engines' syntax would take for something else.
TEST_P(LawsOfTheBus, KeepBytesAsTheyAre) {
  const auto a = connect(), b = connect();
  std::string bytes(1 << 20, '\0');
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<char>(i * 7 + i / 256);
  const Entries written{"", std::string("\0\r\n$-1\r\n", 8), bytes, "*3"};
  for (const std::string& name : {std::string("a b"), std::string("{x}*?[a-z]\\"), std::string("\xc3\xa4\0\xff", 4), std::string()}) {
    const Heard<std::string> heard;
    const auto hearing = b->hear(name, heard.take());
    const Heard<std::uint64_t> changed;
    const auto watching = b->watch(name, changed.take());
    ASSERT_TRUE(await([&] { return changed.size() > 0; }));
    EXPECT_EQ(append(*a, name, 0, written).kind, Kind::kDone);
    EXPECT_EQ(all(*b, name), written);
    EXPECT_TRUE(await([&] { return changed.last() == written.size(); }));
    for (const std::string& message : written) a->tell(name, message);
    EXPECT_TRUE(await([&] { return heard.size() == written.size(); }));
    EXPECT_EQ(heard.all(), written);
    EXPECT_TRUE(hold(*a, name, bytes, 0)->isYours);
    EXPECT_EQ(list(*b, name)->at(name).value, bytes);
  }
}

TEST_P(LawsOfTheBus, ReadAsManyEntriesAsFit) {
  const auto a = connect();
  std::mt19937 random(5);
  Entries written;
  for (int i = 0; i < 300; ++i) written.emplace_back(random() % 2000, static_cast<char>('a' + i % 26));
  written[17].assign(100'000, 'x');
  ASSERT_EQ(append(*a, "log", 0, written).kind, Kind::kDone);
  for (const std::size_t most : {std::size_t{0}, std::size_t{1}, std::size_t{3000}, std::size_t{50'000}, std::size_t{1} << 30})
    for (const std::size_t after : {0u, 16u, 17u, 250u, 299u, 300u, 5000u}) {
      const auto page = read(*a, "log", after, most);
      ASSERT_TRUE(page);
      std::size_t count = 0, bytes = 0;  // what must have come
      while (after + count < written.size() && (count == 0 || bytes + written[after + count].size() <= most))
        bytes += written[after + count++].size();
      ASSERT_EQ(page->size(), count) << most << " bytes after " << after;
      for (std::size_t i = 0; i < count; ++i) EXPECT_EQ((*page)[i], (Entry{after + i + 1, written[after + i]}));
    }
}

// A model that shares nothing with an engine: a vector.
TEST_P(LawsOfTheBus, AppendAllOrNone) {
  const auto a = connect(), b = connect();
  std::mt19937 random(11);
  Entries model;
  for (int i = 0; i < 150; ++i) {
    const std::uint64_t after = random() % 3 ? model.size() : random() % (model.size() + 3);
    Entries entries;
    for (std::size_t n = 1 + random() % 20; n > 0; --n) entries.push_back(std::to_string(random()));
    const Appended appended = append(random() % 2 ? *a : *b, "log", after, entries, random() % 2 ? Origin::kNew : Origin::kKept);
    ASSERT_EQ(appended.kind, after == model.size() ? Kind::kDone : Kind::kBehind);
    if (after == model.size()) model.insert(model.end(), entries.begin(), entries.end());
    ASSERT_EQ(appended.last, model.size());
  }
  EXPECT_EQ(all(*b, "log"), model);
}

// Whoever is behind tries again after the number that it was told: every entry comes once, each appender's in its order.
TEST_P(LawsOfTheBus, LetAppendersRace) {
  constexpr int kAppenders = 6, kEach = 60;
  struct Appender {
    std::shared_ptr<Bus> bus;
    int next = 0;
    std::atomic<bool> isDone = false;
    void go(std::uint64_t after) {
      if (next == kEach) {
        isDone = true;
        return;
      }
      bus->append("log", after, {std::to_string(bus->server()) + ":" + std::to_string(next)}, Origin::kNew, [this](const Appended& a) {
        ASSERT_TRUE(a.kind == Kind::kDone || a.kind == Kind::kBehind);
        if (a.kind == Kind::kDone) ++next;
        go(a.last);
      });
    }
  };
  std::vector<Appender> appenders(kAppenders);
  for (Appender& appender : appenders) appender.bus = connect();
  std::vector<std::thread> threads;
  for (Appender& appender : appenders) threads.emplace_back([&appender] { appender.go(0); });
  for (std::thread& thread : threads) thread.join();
  ASSERT_TRUE(await([&] { return std::all_of(appenders.begin(), appenders.end(), [](const Appender& a) { return a.isDone.load(); }); }));
  const Entries log = all(*appenders[0].bus, "log");
  EXPECT_EQ(log.size(), kAppenders * kEach);
  for (const Appender& appender : appenders) {
    const std::string prefix = std::to_string(appender.bus->server()) + ":";
    int next = 0;
    for (const std::string& entry : log)
      if (entry.starts_with(prefix)) {
        EXPECT_EQ(entry, prefix + std::to_string(next++));
      }
    EXPECT_EQ(next, kEach);
  }
}

// Calls of one server take effect in their order: those after the first need not wait for its answer.
TEST_P(LawsOfTheBus, KeepTheOrderOfCalls) {
  const auto a = connect();
  std::vector<Answer<Appended>> answers(200);
  for (std::size_t i = 0; i < answers.size(); ++i) a->append("log", i, {std::to_string(i)}, Origin::kNew, answers[i].take());
  ASSERT_TRUE(await([&] { return answers.back().has(); }));
  for (std::size_t i = 0; i < answers.size(); ++i) EXPECT_EQ(answers[i].get().last, i + 1);
}

TEST_P(LawsOfTheBus, TellWatchersOfEntriesTheirOwnToo) {
  const auto a = connect(), b = connect();
  append(*a, "log", 0, {"one", "two"});
  const Heard<std::uint64_t> atA, atB, other;
  const auto first = a->watch("log", atA.take()), second = b->watch("log", atB.take()), third = b->watch("another", other.take());
  EXPECT_TRUE(await([&] { return atA.last() == 2u && atB.last() == 2u && other.last() == 0u; }));
  append(*a, "log", 2, {"three"});
  EXPECT_TRUE(await([&] { return atA.last() == 3u && atB.last() == 3u; }));
  append(*b, "another", 0, {"else"});
  EXPECT_TRUE(await([&] { return other.last() == 1u; }));
  EXPECT_EQ(atA.last(), 3u);
}

TEST_P(LawsOfTheBus, TellOthersOfAChannelInOrder) {
  const auto a = connect(), b = connect(), c = connect();
  const Heard<std::string> atA, atB, again, atC;
  // A watch that was answered shows that the engine knows what was subscribed before it.
  const Heard<std::uint64_t> known;
  const auto hearA = a->hear("channel", atA.take()), hearB = b->hear("channel", atB.take()), hearAgain = b->hear("channel", again.take()),
             hearC = c->hear("another", atC.take());
  const auto watchA = a->watch("log", known.take()), watchB = b->watch("log", known.take()), watchC = c->watch("log", known.take());
  ASSERT_TRUE(await([&] { return known.size() == 3; }));
  Entries sent;
  for (int i = 0; i < 500; ++i) a->tell("channel", sent.emplace_back(std::to_string(i)));
  c->tell("channel", "from c");
  ASSERT_TRUE(await([&] { return atB.size() == 501 && again.size() == 501 && atA.size() == 1; }));
  EXPECT_THAT(atA.all(), ElementsAre("from c"));
  Entries fromA = atB.all();
  EXPECT_EQ(std::erase(fromA, "from c"), 1u);
  EXPECT_EQ(fromA, sent);
  a->tell("another", "only c");
  ASSERT_TRUE(await([&] { return atC.size() == 1; }));
  EXPECT_EQ(atB.size(), 501u);
}

TEST_P(LawsOfTheBus, TellNobodyWhoseSubscriptionEnded) {
  const auto a = connect(), b = connect();
  const Heard<std::string> ended, stays;
  const Heard<std::uint64_t> endedWatch, watch;
  auto ends = b->hear("channel", ended.take());
  auto copy = ends;
  const auto goesOn = b->hear("channel", stays.take());
  auto watching = b->watch("log", endedWatch.take());
  const auto watches = b->watch("log", watch.take());
  ASSERT_TRUE(await([&] { return watch.size() > 0 && endedWatch.size() > 0; }));
  ends.reset();
  a->tell("channel", "one");
  ASSERT_TRUE(await([&] { return stays.size() == 1 && ended.size() == 1; }));  // a copy is left
  copy.reset();
  watching.reset();
  append(*a, "log", 0, {"entry"});
  a->tell("channel", "two");
  ASSERT_TRUE(await([&] { return stays.size() == 2 && watch.last() == 1u; }));
  EXPECT_THAT(ended.all(), ElementsAre("one"));
  EXPECT_EQ(endedWatch.last(), 0u);
  // The last of a channel, and again.
  const Heard<std::string> anew;
  auto only = b->hear("third", ended.take());
  only.reset();
  only = b->hear("third", anew.take());
  const Heard<std::uint64_t> known;
  const auto third = b->watch("third", known.take());
  ASSERT_TRUE(await([&] { return known.size() > 0; }));
  a->tell("third", "three");
  EXPECT_TRUE(await([&] { return anew.size() == 1; }));
}

TEST_P(LawsOfTheBus, LetHandlersCallTheBus) {
  const auto a = connect(), b = connect();
  std::atomic<int> last = 0;
  const Heard<std::string> heard;
  bus::Subscription inner;
  const auto watching = b->watch("log", [&](std::uint64_t number) {
    last = static_cast<int>(number);
    if (number >= 20) return;
    b->append("log", number, {std::to_string(number)}, Origin::kNew, [&](const Appended& appended) {
      b->tell("channel", std::to_string(appended.last));
      b->read("log", 0, 1 << 20, [&](const Outcome<std::vector<Entry>>& page) { EXPECT_TRUE(page); });
    });
    if (number == 5) inner = b->hear("channel", heard.take());
    if (number == 9) inner.reset();
  });
  EXPECT_TRUE(await([&] { return last == 20; }));
}

// ---- records ----

TEST_P(LawsOfTheBus, LetOneHoldARecord) {
  const auto a = connect(), b = connect();
  const auto first = hold(*a, "key", "a", 0);
  ASSERT_TRUE(first);
  EXPECT_TRUE(first->isYours);
  EXPECT_EQ(first->record, (Record{"a", 1}));
  for (const std::uint64_t epoch : {0, 2, 7}) {
    const auto refused = hold(*b, "key", "b", epoch);
    ASSERT_TRUE(refused);
    EXPECT_FALSE(refused->isYours);
    EXPECT_EQ(refused->record, (Record{"a", 1}));
  }
  EXPECT_EQ(hold(*a, "key", "a again", 1)->record, (Record{"a again", 1}));
  EXPECT_EQ(hold(*b, "key", "by b, who knows the epoch", 1)->record, (Record{"by b, who knows the epoch", 1}));
  b->drop("key", 2);  // not this epoch: nothing
  EXPECT_EQ(list(*b, "key")->size(), 1u);
  b->drop("key", 1);
  EXPECT_THAT(*list(*b, "key"), IsEmpty());
  const auto second = hold(*b, "key", "b", 0);
  EXPECT_TRUE(second->isYours);
  EXPECT_EQ(second->record, (Record{"b", 2}));
  // An earlier holder's writes are refused while there is a record, and after.
  EXPECT_FALSE(hold(*a, "key", "late", 1)->isYours);
  a->drop("key", 1);
  EXPECT_EQ(list(*a, "")->at("key"), (Record{"b", 2}));
  b->drop("key", 2);
  EXPECT_THAT(*list(*b, ""), IsEmpty());
  const auto late = hold(*a, "key", "late", 1);
  EXPECT_FALSE(late->isYours);
  EXPECT_EQ(late->record, Record());
  // The last one may go on.
  EXPECT_EQ(hold(*b, "key", "b", 2)->record, (Record{"b", 2}));
}

TEST_P(LawsOfTheBus, PassARecordOnAsItIs) {
  const auto a = connect(), b = connect();
  EXPECT_EQ(take(*b, "key", 1)->record, Record()) << "there is none";
  ASSERT_TRUE(hold(*a, "key", "a", 0)->isYours);
  EXPECT_EQ(take(*b, "key", 2)->record, (Record{"a", 1})) << "a wrong epoch";
  const auto taken = take(*b, "key", 1);
  EXPECT_TRUE(taken->isYours);
  EXPECT_EQ(taken->record, (Record{"a", 2}));
  EXPECT_FALSE(take(*a, "key", 1)->isYours) << "one of two";
  const auto late = hold(*a, "key", "late", 1);
  EXPECT_FALSE(late->isYours);
  EXPECT_EQ(late->record, taken->record);
  EXPECT_TRUE(hold(*b, "key", "b", 2)->isYours);
  ASSERT_TRUE(hold(*a, "brief", "a", 0, 300ms)->isYours);
  ASSERT_TRUE(take(*b, "brief", 1));
  EXPECT_TRUE(await([&] { return list(*a, "brief")->empty(); })) << "its life is what it was";
}

TEST_P(LawsOfTheBus, LetARecordLiveForItsLife) {
  const auto a = connect(), b = connect();
  EXPECT_TRUE(hold(*a, "forever", "f", 0, 0ms)->isYours);
  EXPECT_TRUE(hold(*a, "brief", "b", 0, 300ms)->isYours);
  EXPECT_TRUE(hold(*a, "renewed", "r", 0, 300ms)->isYours);
  EXPECT_TRUE(hold(*a, "prolonged", "p", 0, 300ms)->isYours);
  EXPECT_TRUE(hold(*a, "prolonged", "p", 1, 0ms)->isYours);
  EXPECT_TRUE(hold(*a, "shortened", "s", 0, 0ms)->isYours);
  EXPECT_TRUE(hold(*a, "shortened", "s", 1, 300ms)->isYours);
  // The one that is renewed, by an epoch that goes on or, on a machine that was busy for long, by a new one, is there at the end.
  Bus::Held renewed{true, {"r", 1}};
  EXPECT_TRUE(await([&] {
    renewed = *hold(*a, "renewed", "r", renewed.isYours ? renewed.record.epoch : 0, 300ms);
    const auto there = *list(*b, "");
    return !there.contains("brief") && !there.contains("shortened");
  }));
  EXPECT_TRUE(renewed.isYours);
  const auto there = *list(*b, "");
  EXPECT_TRUE(there.contains("forever"));
  EXPECT_TRUE(there.contains("prolonged"));
  const auto taken = hold(*b, "brief", "b", 0);
  EXPECT_TRUE(taken->isYours);
  EXPECT_EQ(taken->record.epoch, 2u);
  EXPECT_FALSE(hold(*a, "brief", "late", 1)->isYours);
  EXPECT_EQ(hold(*a, "shortened", "goes on", 1)->record, (Record{"goes on", 1}));
}

TEST_P(LawsOfTheBus, ListByPrefix) {
  const auto a = connect();
  std::map<std::string, Record> model;
  std::mt19937 random(3);
  for (int i = 0; i < 2500; ++i) {  // more than a page of any engine
    std::string key = (random() % 2 ? "a/" : "b/") + std::to_string(random() % 100'000);
    if (model.contains(key)) continue;
    const Answer<Outcome<Bus::Held>> answer;
    a->hold(key, std::to_string(i), 0, 1h, answer.take());
    model[key] = {std::to_string(i), 1};
  }
  for (const auto& key : {std::string("a"), std::string("a/\xff\xfe"), std::string("a/\xff\xff\xff")})
    model[key] = hold(*a, key, "v", 0)->record;
  for (const std::string& prefix :
       {std::string(), std::string("a"), std::string("a/"), std::string("b/7"), std::string("a/\xff"), std::string("c")}) {
    std::map<std::string, Record> expected;
    for (const auto& [key, record] : model)
      if (key.starts_with(prefix)) expected.emplace(key, record);
    const auto listed = list(*a, prefix);
    ASSERT_TRUE(listed);
    EXPECT_EQ(*listed, expected) << prefix;
  }
}

TEST_P(LawsOfTheBus, LetOneOfManyWin) {
  std::vector<std::shared_ptr<Bus>> all;
  for (int i = 0; i < 5; ++i) all.push_back(connect());
  for (int round = 1; round <= 20; ++round) {
    std::vector<Answer<Outcome<Bus::Held>>> answers(all.size());
    std::vector<std::thread> threads;
    for (std::size_t i = 0; i < all.size(); ++i)
      threads.emplace_back([&, i] { all[i]->hold("key", std::to_string(i), 0, 1h, answers[i].take()); });
    for (std::thread& thread : threads) thread.join();
    std::size_t winner = all.size();
    std::set<std::string> values;
    for (std::size_t i = 0; i < all.size(); ++i) {
      ASSERT_TRUE(await([&] { return answers[i].has(); }));
      const auto held = answers[i].get();
      ASSERT_TRUE(held);
      EXPECT_EQ(held->record.epoch, static_cast<std::uint64_t>(round));
      values.insert(held->record.value);
      if (!held->isYours) continue;
      EXPECT_EQ(winner, all.size()) << "two hold it";
      winner = i;
    }
    ASSERT_THAT(values, ElementsAre(std::to_string(winner)));
    all[winner]->drop("key", static_cast<std::uint64_t>(round));
    ASSERT_TRUE(await([&] { return list(*all[0], "key")->empty(); }));
  }
}

// ---- when the engine goes ----

TEST_P(LawsOfTheBus, FailWhileTheEngineIsAwayAndGoOnAfter) {
  const auto a = connect(), b = connect();
  ASSERT_EQ(append(*a, "log", 0, {"one"}).kind, Kind::kDone);
  ASSERT_TRUE(hold(*a, "key", "value", 0)->isYours);
  const Heard<std::string> heard;
  const Heard<std::uint64_t> changed;
  const auto hearing = b->hear("channel", heard.take());
  const auto watching = b->watch("log", changed.take());
  ASSERT_TRUE(await([&] { return changed.last() == 1u; }));
  const std::int64_t before = a->now();

  engine->stop();
  ASSERT_TRUE(await([&] { return a->isAway() && b->isAway(); }));
  const std::int64_t away = a->now();
  EXPECT_GE(away, before - 1'000'000);
  EXPECT_TRUE(await([&] { return a->now() > away; }));
  const Appended refused = append(*a, "log", 1, {"no"});
  EXPECT_EQ(refused.kind, Kind::kAway);
  EXPECT_FALSE(refused.why.empty());
  EXPECT_FALSE(read(*a, "log", 0));
  EXPECT_FALSE(hold(*a, "key", "no", 1));
  EXPECT_FALSE(list(*a, ""));
  a->drop("key", 1);
  a->tell("channel", "lost");
  const Heard<std::string> meanwhile;
  const auto hearMeanwhile = b->hear("meanwhile", meanwhile.take());
  const std::size_t changes = changed.size();

  engine->start();
  ASSERT_TRUE(awaitBack(*a) && awaitBack(*b));
  EXPECT_THAT(all(*a, "log"), ElementsAre("one"));
  EXPECT_EQ(list(*a, "")->at("key"), (Record{"value", 1}));
  ASSERT_TRUE(await([&] { return changed.size() > changes; }));
  EXPECT_EQ(changed.last(), 1u);
  EXPECT_EQ(appendWhenTaken(*a, "log", 1, {"two"}).last, 2u);
  EXPECT_TRUE(await([&] { return changed.last() == 2u; }));
  a->tell("channel", "heard");
  a->tell("meanwhile", "too");
  ASSERT_TRUE(await([&] { return heard.size() == 1 && meanwhile.size() == 1; }));
  EXPECT_THAT(heard.all(), ElementsAre("heard"));
  EXPECT_THAT(connect()->server(), testing::AllOf(Not(a->server()), Not(b->server())));
}

// Whatever an answer says is so afterwards: done is there, in its place; unknown is there or not, whole; all else is not.
TEST_P(LawsOfTheBus, LoseNothingAcknowledged) {
  const auto a = connect();
  std::uint64_t last = 0;
  std::map<std::uint64_t, std::string> done;
  std::set<std::string> unknown, none;
  int next = 0;
  for (int round = 0; round < 4; ++round) {
    struct Try {
      std::string name;
      Answer<Appended> answer;
    };
    std::vector<Try> tries;
    for (int i = 0; i < 40; ++i) {
      const Try& t = tries.emplace_back(Try{"entry " + std::to_string(next++), {}});
      a->append("log", last + 2 * static_cast<std::uint64_t>(i), {t.name + "+", t.name + "-"}, Origin::kKept, t.answer.take());
    }
    if (round > 0) {
      ASSERT_TRUE(await([&] { return tries[static_cast<std::size_t>(10 * round - 10)].answer.has(); }));
    }
    engine->stop();
    for (const Try& t : tries) {
      ASSERT_TRUE(await([&] { return t.answer.has(); }));
      const Appended appended = t.answer.get();
      if (appended.kind == Kind::kDone) {
        done[appended.last - 1] = t.name + "+";
        done[appended.last] = t.name + "-";
      } else {
        (appended.kind == Kind::kUnknown ? unknown : none).insert(t.name);
      }
    }
    engine->start();
    ASSERT_TRUE(awaitBack(*a));
    last = all(*a, "log").size();
  }
  const Entries log = all(*a, "log");
  for (const auto& [number, bytes] : done) EXPECT_EQ(log.at(number - 1), bytes);
  std::multiset<std::string> there;
  ASSERT_EQ(log.size() % 2, 0u);
  for (std::size_t i = 0; i < log.size(); i += 2) {
    const std::string name = log[i].substr(0, log[i].size() - 1);
    EXPECT_EQ(log[i + 1], name + "-");
    there.insert(name);
  }
  for (const std::string& name : there) EXPECT_EQ(there.count(name), 1u) << name;
  for (const std::string& name : none) EXPECT_FALSE(there.contains(name)) << name;
}

// What was lost can be brought back by whoever has it, before anything new is numbered.
TEST_P(LawsOfTheBus, TakeOnlyKeptEntriesAfterALoss) {
  const auto a = connect(), b = connect();
  ASSERT_EQ(append(*a, "log", 0, {"one", "two"}).last, 2u);
  const auto lease = hold(*a, "lease", "a", 0);
  const Heard<std::uint64_t> changed;
  const auto watching = b->watch("log", changed.take());
  engine->prepareLoss();
  ASSERT_EQ(append(*a, "log", 2, {"three", "four", "five"}).last, 5u);
  ASSERT_TRUE(await([&] { return changed.last() == 5u; }));
  engine->loseEnd("log", 3);
  ASSERT_TRUE(await([&] { return changed.last() == 2u; }));
  ASSERT_TRUE(awaitBack(*a) && awaitBack(*b));
  const Appended refused = append(*b, "log", 2, {"new"});
  EXPECT_EQ(refused.kind, Kind::kAway);
  EXPECT_FALSE(refused.why.empty());
  EXPECT_EQ(append(*a, "log", 2, {"three", "four"}, Origin::kKept).last, 4u);
  EXPECT_EQ(append(*b, "log", 2, {"three", "four", "five"}, Origin::kKept).kind, Kind::kBehind);
  EXPECT_EQ(append(*b, "log", 4, {"five"}, Origin::kKept).last, 5u);
  EXPECT_EQ(appendWhenTaken(*b, "log", 5, {"new"}).last, 6u);
  EXPECT_THAT(all(*a, "log"), ElementsAre("one", "two", "three", "four", "five", "new"));
}

TEST_P(LawsOfTheBus, RefuseEntriesWithoutRoom) {
  const auto a = connect();
  ASSERT_EQ(append(*a, "log", 0, {"one"}).kind, Kind::kDone);
  ASSERT_TRUE(hold(*a, "key", "value", 0)->isYours);
  engine->fill();
  const Appended refused = append(*a, "log", 1, {"two", "three"});
  EXPECT_EQ(refused.kind, Kind::kFull);
  EXPECT_EQ(refused.last, 1u);
  EXPECT_FALSE(refused.why.empty());
  EXPECT_THAT(all(*a, "log"), ElementsAre("one"));
  EXPECT_FALSE(hold(*a, "another", "value", 0));
  EXPECT_EQ(list(*a, "")->size(), 1u);
  EXPECT_FALSE(a->isAway());
  engine->empty();
  EXPECT_TRUE(await([&] { return append(*a, "log", 1, {"two"}).kind == Kind::kDone; }));
  EXPECT_THAT(all(*a, "log"), ElementsAre("one", "two"));
}

}  // namespace
}  // namespace ridgecast::bus
