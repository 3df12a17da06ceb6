#pragma once
// What holds for every engine (server/bus/bus.h): laws.cpp says it once; each engine's test instantiates it.

#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/bus/bus.h"

namespace ridgecast::bus {

// Names in a failure what was appended.
inline void PrintTo(const Appended& a, std::ostream* out) {
  *out << "kind " << static_cast<int>(a.kind) << ", last " << a.last << ", " << a.why;
}

class EngineUnderTest {
 public:
  virtual ~EngineUnderTest() = default;
  virtual std::shared_ptr<Bus> connect() = 0;
  // Lets time pass until it is so. False: it never was.
  virtual bool await(const std::function<bool()>& so) = 0;

  virtual void stop() = 0;   // it ends at once, whatever it does
  virtual void start() = 0;  // with what it had acknowledged
  // A replica takes over that never saw the last `entries` of the log, which are all that was ever written after prepareLoss().
  virtual void prepareLoss() = 0;
  virtual void loseEnd(const std::string& log, std::size_t entries) = 0;
  virtual void fill() = 0;
  virtual void empty() = 0;
};

// What a call answered, from whichever thread, at most once.
template <class T>
class Answer {
 public:
  std::function<void(T)> take() const {
    return [s = shared_](T value) {
      const std::lock_guard lock(s->mutex);
      ASSERT_FALSE(s->value) << "a second answer";
      s->value = std::move(value);
    };
  }
  bool has() const {
    const std::lock_guard lock(shared_->mutex);
    return shared_->value.has_value();
  }
  T get() const {
    const std::lock_guard lock(shared_->mutex);
    return *shared_->value;
  }

 private:
  struct Shared {
    std::mutex mutex;
    std::optional<T> value;
  };
  std::shared_ptr<Shared> shared_ = std::make_shared<Shared>();
};

// What a handler was given, in order.
template <class T>
class Heard {
 public:
  std::function<void(const T&)> take() const {
    return [s = shared_](const T& value) {
      const std::lock_guard lock(s->mutex);
      s->all.push_back(value);
    };
  }
  std::vector<T> all() const {
    const std::lock_guard lock(shared_->mutex);
    return shared_->all;
  }
  std::size_t size() const { return all().size(); }
  std::optional<T> last() const {
    const auto values = all();
    return values.empty() ? std::nullopt : std::optional(values.back());
  }

 private:
  struct Shared {
    std::mutex mutex;
    std::vector<T> all;
  };
  std::shared_ptr<Shared> shared_ = std::make_shared<Shared>();
};

class LawsOfTheBus : public testing::TestWithParam<std::function<std::unique_ptr<EngineUnderTest>()>> {
 protected:
  void SetUp() override { engine = GetParam()(); }

  using Entries = std::vector<std::string>;
  std::shared_ptr<Bus> connect() const { return engine->connect(); }
  bool await(const std::function<bool()>& so) const { return engine->await(so); }

  Appended append(Bus& bus, const std::string& log, std::uint64_t after, Entries entries, Bus::Origin origin = Bus::Origin::kNew) const {
    const Answer<Appended> answer;
    bus.append(log, after, std::move(entries), origin, answer.take());
    EXPECT_TRUE(await([&] { return answer.has(); }));
    return answer.get();
  }
  Outcome<std::vector<Entry>> read(Bus& bus, const std::string& log, std::uint64_t after, std::size_t most = 1 << 20) const {
    const Answer<Outcome<std::vector<Entry>>> answer;
    bus.read(log, after, most, answer.take());
    EXPECT_TRUE(await([&] { return answer.has(); }));
    return answer.get();
  }
  // The whole log, page by page; each must follow the one before.
  Entries all(Bus& bus, const std::string& log) const {
    Entries out;
    for (;;) {
      const auto page = read(bus, log, out.size());
      EXPECT_TRUE(page) << (page ? "" : page.error().message);
      if (!page || page->empty()) return out;
      for (const Entry& entry : *page) {
        EXPECT_EQ(entry.number, out.size() + 1);
        out.push_back(entry.bytes);
      }
    }
  }
  Outcome<Bus::Held> hold(Bus& bus, const std::string& key, const std::string& value, std::uint64_t epoch,
                          std::chrono::milliseconds life = std::chrono::hours(1)) const {
    const Answer<Outcome<Bus::Held>> answer;
    bus.hold(key, value, epoch, life, answer.take());
    EXPECT_TRUE(await([&] { return answer.has(); }));
    return answer.get();
  }
  Outcome<Bus::Held> take(Bus& bus, const std::string& key, std::uint64_t epoch) const {
    const Answer<Outcome<Bus::Held>> answer;
    bus.take(key, epoch, answer.take());
    EXPECT_TRUE(await([&] { return answer.has(); }));
    return answer.get();
  }
  Outcome<std::map<std::string, Record>> list(Bus& bus, const std::string& prefix) const {
    const Answer<Outcome<std::map<std::string, Record>>> answer;
    bus.list(prefix, answer.take());
    EXPECT_TRUE(await([&] { return answer.has(); }));
    return answer.get();
  }
  bool awaitBack(const Bus& bus) const {
    return await([&] { return !bus.isAway(); });
  }
  // Appends new entries as soon as the engine takes them.
  Appended appendWhenTaken(Bus& bus, const std::string& log, std::uint64_t after, const Entries& entries) const {
    for (;;) {
      Appended appended = append(bus, log, after, entries);
      if (appended.kind != Appended::Kind::kAway) return appended;
      EXPECT_FALSE(appended.why.empty());
    }
  }

  std::unique_ptr<EngineUnderTest> engine;
};

}  // namespace ridgecast::bus
