#include "tests/support/simulated_bus.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <optional>
#include <random>
#include <utility>

namespace ridgecast::testing_support {

using bus::Appended, bus::Bus, bus::Entry, bus::Record;
using Time = scheduling::Timer::Time;
using Run = std::function<void()>;

namespace {

constexpr SimulatedEngine::Duration kLate = std::chrono::milliseconds(500);  // after a connection broke
constexpr std::int64_t kEpoch = 1'700'000'000'000'000;                       // what its clock says at first, microseconds since 1970

}  // namespace

struct SimulatedEngine::State : std::enable_shared_from_this<State> {
  struct Listener {
    std::string name;
    std::function<void(std::uint64_t)> changed;     // of a log
    std::function<void(const std::string&)> heard;  // of a channel
    bool isKnown = false;                           // to the engine
  };

  // Of one server.
  struct Line {
    bool isCut = false, isOpen = true;  // open: servers send
    std::uint64_t opened = 0;           // how often; what an earlier line carried is lost
    Time lastSent{}, lastReplied{};
    struct Call {
      std::function<Run()> work;  // in the engine; empty once done. Returns what then runs at the server
      Run failed;
    };
    std::map<std::uint64_t, Call> calls;   // without an answer, in their order
    std::map<std::uint64_t, Run> replies;  // on their way
    std::vector<std::weak_ptr<Listener>> listeners;
  };

  struct Kept {
    Record record;
    std::optional<Time> until;
  };

  State(const SimulatedTimer& t, std::uint64_t seed) : timer(t), random(seed) {}

  const SimulatedTimer& timer;
  mutable std::mutex mutex;
  std::mt19937_64 random;
  Duration delay{}, jitter{}, patience{};
  bool isStopped = false, isFull = false;
  std::chrono::microseconds ahead{};
  const Time begun = timer.now();
  Time graceUntil{};
  std::uint32_t servers = 0;
  std::uint64_t nextCall = 0, failovers = 0;
  std::map<std::uint32_t, Line> lines;
  std::map<std::string, std::vector<Entry>> logs;
  std::map<std::string, Kept> records;
  std::map<std::string, std::uint64_t> epochs;  // the last of each key
  Traffic traffic;

  // ---- the network; under the mutex ----

  // When something sent now arrives, after all that was sent before.
  Time arrival(Time& last) {
    Duration takes = delay;
    if (jitter > Duration()) takes += Duration(std::uniform_int_distribution<Duration::rep>(0, jitter.count())(random));
    return last = std::max(last, timer.now() + takes);
  }
  void later(Time when, Run run) const { timer.at(when, std::move(run)); }

  // At the server, if this line still is open by then.
  void reply(std::uint32_t server, Run run) {
    Line& line = lines.at(server);
    line.replies[++nextCall] = std::move(run);
    later(arrival(line.lastReplied), [self = shared_from_this(), server, opened = line.opened, id = nextCall] {
      std::map<std::uint64_t, Run>::node_type reply;  // ends without the mutex
      {
        const std::lock_guard lock(self->mutex);
        const auto found = self->lines.find(server);
        if (found == self->lines.end()) return;
        reply = found->second.replies.extract(id);
        if (!reply || found->second.opened != opened || self->isBroken(found->second)) return;
      }
      reply.mapped()();
    });
  }
  bool isBroken(const Line& line) const { return line.isCut || isStopped; }

  // `work` runs in the engine, under the mutex, and what it returns at the server. `failed`: broken in between, or never sent (`unsent`).
  void call(std::uint32_t server, std::function<Run()> work, Run failed, Run unsent) {
    Line& line = lines.at(server);
    if (!line.isOpen) return whileThere(server, timer.now(), std::move(unsent));
    const std::uint64_t id = ++nextCall;
    line.calls[id] = {std::move(work), std::move(failed)};
    if (isBroken(line)) {  // and not noticed: it gets lost
      line.calls[id].work = nullptr;
      return;
    }
    later(arrival(line.lastSent), [self = shared_from_this(), server, id] {
      const std::lock_guard lock(self->mutex);
      self->arrive(server, id);
    });
  }
  void arrive(std::uint32_t server, std::uint64_t id) {
    const auto line = lines.find(server);
    if (line == lines.end()) return;
    const auto found = line->second.calls.find(id);
    if (found == line->second.calls.end() || !found->second.work) return;
    const auto work = std::exchange(found->second.work, nullptr);
    reply(server, [self = shared_from_this(), server, id, answer = work()] {
      std::map<std::uint64_t, Line::Call>::node_type call;  // ends without the mutex
      {
        const std::lock_guard lock(self->mutex);
        const auto at = self->lines.find(server);
        if (at != self->lines.end()) call = at->second.calls.extract(id);
      }
      if (call && answer) answer();
    });
  }
  // Calls made to the server itself; the line does not matter.
  void whileThere(std::uint32_t server, Time when, Run run) const {
    if (!run) return;
    later(when, [self = shared_from_this(), server, run = std::move(run)] {
      {
        const std::lock_guard lock(self->mutex);
        if (!self->lines.contains(server)) return;
      }
      run();
    });
  }

  // The first of what is on its way still arrives, maybe late; the rest is lost.
  void loseCalls(std::uint32_t server, bool mayBeLate = false) {
    Line& line = lines.at(server);
    std::vector<std::function<Run()>> sent;
    for (auto& [id, call] : line.calls)
      if (call.work) sent.push_back(std::exchange(call.work, nullptr));
    sent.resize(std::uniform_int_distribution<std::size_t>(0, sent.size())(random));
    if (!mayBeLate || random() % 4 != 0) {
      for (const auto& work : sent) work();
      return;
    }
    later(timer.now() + Duration(std::uniform_int_distribution<Duration::rep>(0, kLate.count())(random)),
          [self = shared_from_this(), sent = std::move(sent), failed = failovers] {
            const std::lock_guard lock(self->mutex);
            if (self->failovers == failed)
              for (const auto& work : sent) work();
          });
  }
  void broke(std::uint32_t server) {
    loseCalls(server, true);
    if (patience == Duration()) return close(server);
    later(timer.now() + patience, [self = shared_from_this(), server, opened = lines.at(server).opened] {
      const std::lock_guard lock(self->mutex);
      const auto line = self->lines.find(server);
      if (line != self->lines.end() && line->second.opened == opened && self->isBroken(line->second)) self->close(server);
    });
  }
  void close(std::uint32_t server) {
    Line& line = lines.at(server);
    if (!line.isOpen) return;
    line.isOpen = false;
    for (auto& [id, call] : std::exchange(line.calls, {})) whileThere(server, timer.now(), std::move(call.failed));
    for (const auto& weak : line.listeners)
      if (const auto listener = weak.lock()) listener->isKnown = false;
  }
  void reopen(std::uint32_t server) {
    Line& line = lines.at(server);
    if (isBroken(line)) return;
    close(server);
    ++line.opened;
    line.lastSent = line.lastReplied = {};
    later(arrival(line.lastReplied), [self = shared_from_this(), server, opened = line.opened] {
      const std::lock_guard lock(self->mutex);
      const auto found = self->lines.find(server);
      if (found == self->lines.end() || found->second.opened != opened || self->isBroken(found->second)) return;
      found->second.isOpen = true;
      for (const auto& weak : found->second.listeners)
        if (const auto listener = weak.lock()) self->listen(server, listener);
    });
  }
  void failOver() {
    std::vector<std::uint32_t> there;
    for (const auto& [server, line] : lines)
      if (!isBroken(line)) there.push_back(server);
    for (const std::uint32_t server : there) loseCalls(server);
    for (const std::uint32_t server : there) close(server), reopen(server);
    ++failovers;
    graceUntil = timer.now() + kGrace;
  }

  // ---- the engine; under the mutex ----

  std::uint64_t lastOf(const std::string& log) const {
    const auto found = logs.find(log);
    return found == logs.end() || found->second.empty() ? 0 : found->second.back().number;
  }
  void listen(std::uint32_t server, const std::shared_ptr<Listener>& listener) {
    call(server,
         [this, server, weak = std::weak_ptr(listener)] {
           const auto known = weak.lock();
           if (!known) return Run();
           known->isKnown = true;
           if (known->changed) tellChange(server, known);
           return Run();
         },
         {}, {});
  }
  void tellChange(std::uint32_t server, const std::shared_ptr<Listener>& listener) {
    reply(server, [weak = std::weak_ptr(listener), last = lastOf(listener->name)] {
      if (const auto there = weak.lock()) there->changed(last);
    });
  }
  template <class Use>
  void eachListener(const Use& use) {
    for (auto& [server, line] : lines) {
      std::erase_if(line.listeners, [](const auto& weak) { return weak.expired(); });
      for (const auto& weak : line.listeners)
        if (const auto listener = weak.lock(); listener && listener->isKnown && !isBroken(line)) use(server, listener);
    }
  }

  Appended append(const std::string& log, std::uint64_t after, std::vector<std::string>& entries, Bus::Origin origin) {
    ++traffic.appends;
    const std::uint64_t last = lastOf(log);
    if (origin == Bus::Origin::kNew && timer.now() < graceUntil)
      return {Appended::Kind::kAway, 0, "The engine has just come back and takes no new entries for two seconds; try again then."};
    if (after != last) return {Appended::Kind::kBehind, last};
    if (isFull) return {Appended::Kind::kFull, last, "The engine has no room; give it more."};
    std::vector<Entry>& to = logs[log];
    for (std::string& bytes : entries) to.push_back({lastOf(log) + 1, std::move(bytes)});
    traffic.entries += entries.size();
    eachListener([&](std::uint32_t server, const std::shared_ptr<Listener>& l) {
      if (l->changed && l->name == log) tellChange(server, l);
    });
    return {Appended::Kind::kDone, lastOf(log)};
  }
  std::vector<Entry> read(const std::string& log, std::uint64_t after, std::size_t most) {
    ++traffic.reads;
    std::vector<Entry> out;
    std::size_t bytes = 0;
    if (const auto found = logs.find(log); found != logs.end())
      for (std::size_t i = after; i < found->second.size(); ++i) {  // number i + 1
        bytes += found->second[i].bytes.size();
        if (!out.empty() && bytes > most) break;
        out.push_back(found->second[i]);
      }
    return out;
  }
  Kept* standing(const std::string& key) {
    const auto found = records.find(key);
    if (found == records.end()) return nullptr;
    if (!found->second.until || timer.now() < *found->second.until) return &found->second;
    records.erase(found);
    return nullptr;
  }
  Outcome<Bus::Held> hold(const std::string& key, std::string& value, std::uint64_t epoch, std::chrono::milliseconds life) {
    ++traffic.holds;
    if (isFull) return Error{"The engine has no room; give it more."};
    Kept* const there = standing(key);
    if (there ? there->record.epoch != epoch : epoch != 0 && epoch != epochs[key])
      return Bus::Held{false, there ? there->record : Record()};
    Kept& kept = records[key];
    if (!there) kept.record.epoch = epoch != 0 ? epoch : ++epochs[key];
    kept.record.value = std::move(value);
    kept.until = life.count() > 0 ? std::optional(timer.now() + life) : std::nullopt;
    return Bus::Held{true, kept.record};
  }
  Outcome<Bus::Held> take(const std::string& key, std::uint64_t epoch) {
    ++traffic.holds;
    if (isFull) return Error{"The engine has no room; give it more."};
    Kept* const there = standing(key);
    if (!there || there->record.epoch != epoch) return Bus::Held{false, there ? there->record : Record()};
    there->record.epoch = ++epochs[key];
    return Bus::Held{true, there->record};
  }
};

class SimulatedEngine::Connection final : public Bus {
  using Line = State::Line;
  using Listener = State::Listener;

 public:
  Connection(std::shared_ptr<State> state, std::uint32_t server) : state_(std::move(state)), server_(server) {}
  ~Connection() override {
    std::map<std::uint32_t, Line>::node_type line;  // ends without the mutex
    const std::lock_guard lock(state_->mutex);
    state_->loseCalls(server_);
    line = state_->lines.extract(server_);
  }

  std::uint32_t server() const override { return server_; }
  bool isAway() const override {
    const std::lock_guard lock(state_->mutex);
    return !state_->lines.at(server_).isOpen;
  }
  std::int64_t now() const override {
    const std::lock_guard lock(state_->mutex);
    return kEpoch + std::chrono::duration_cast<std::chrono::microseconds>(state_->timer.now() - state_->begun + state_->ahead).count();
  }

  void append(const std::string& log, std::uint64_t after, std::vector<std::string> entries, Origin origin,
              std::function<void(Appended)> done) override {
    const std::lock_guard lock(state_->mutex);
    state_->call(
        server_,
        [s = state_.get(), log, after, entries = std::move(entries), origin, done]() mutable {
          return Run([done, result = s->append(log, after, entries, origin)] { done(result); });
        },
        [done] {
          done({Appended::Kind::kUnknown, 0, ""});
        },
        [done] {
          done({Appended::Kind::kAway, 0, kAway});
        });
  }
  void read(const std::string& log, std::uint64_t after, std::size_t most, std::function<void(Outcome<std::vector<Entry>>)> done) override {
    ask<std::vector<Entry>>([s = state_.get(), log, after, most] { return s->read(log, after, most); }, std::move(done));
  }
  bus::Subscription watch(const std::string& log, std::function<void(std::uint64_t)> changed) override {
    return subscribe({log, std::move(changed), {}});
  }

  void tell(const std::string& channel, std::string message) override {
    const std::lock_guard lock(state_->mutex);
    state_->call(server_,
                 [s = state_.get(), from = server_, channel, message = std::make_shared<const std::string>(std::move(message))] {
                   ++s->traffic.tells;
                   s->traffic.toldBytes += message->size();
                   s->eachListener([&](std::uint32_t server, const std::shared_ptr<Listener>& l) {
                     if (!l->heard || l->name != channel || server == from) return;
                     ++s->traffic.heard;
                     s->reply(server, [weak = std::weak_ptr(l), message] {
                       if (const auto there = weak.lock()) there->heard(*message);
                     });
                   });
                   return Run();
                 },
                 {}, {});
  }
  bus::Subscription hear(const std::string& channel, std::function<void(const std::string&)> heard) override {
    return subscribe({channel, {}, std::move(heard)});
  }

  void hold(const std::string& key, std::string value, std::uint64_t epoch, std::chrono::milliseconds life,
            std::function<void(Outcome<Held>)> done) override {
    ask<Held>([s = state_.get(), key, value = std::move(value), epoch, life]() mutable { return s->hold(key, value, epoch, life); },
              std::move(done));
  }
  void take(const std::string& key, std::uint64_t epoch, std::function<void(Outcome<Held>)> done) override {
    ask<Held>([s = state_.get(), key, epoch] { return s->take(key, epoch); }, std::move(done));
  }
  void drop(const std::string& key, std::uint64_t epoch) override {
    const std::lock_guard lock(state_->mutex);
    state_->call(server_,
                 [s = state_.get(), key, epoch] {
                   if (const State::Kept* kept = s->standing(key); kept && kept->record.epoch == epoch) s->records.erase(key);
                   return Run();
                 },
                 {}, {});
  }
  void list(const std::string& prefix, std::function<void(Outcome<std::map<std::string, Record>>)> done) override {
    ask<std::map<std::string, Record>>(
        [s = state_.get(), prefix] {
          std::map<std::string, Record> out;
          for (auto at = s->records.lower_bound(prefix); at != s->records.end() && at->first.starts_with(prefix);) {
            const std::string key = (at++)->first;
            if (const State::Kept* kept = s->standing(key)) out[key] = kept->record;
          }
          return out;
        },
        std::move(done));
  }

 private:
  static constexpr const char* kAway = "The engine cannot be reached.";

  template <class T>
  void ask(std::function<Outcome<T>()> work, std::function<void(Outcome<T>)> done) {
    const std::lock_guard lock(state_->mutex);
    const Run failed = [done] { done(Error{kAway}); };
    state_->call(
        server_, [work = std::move(work), done]() mutable { return Run([done, result = work()] { done(result); }); }, failed, failed);
  }
  bus::Subscription subscribe(Listener listener) {
    auto shared = std::make_shared<Listener>(std::move(listener));
    const std::lock_guard lock(state_->mutex);
    Line& line = state_->lines.at(server_);
    std::erase_if(line.listeners, [](const auto& weak) { return weak.expired(); });
    line.listeners.push_back(shared);
    if (line.isOpen) state_->listen(server_, shared);
    return shared;
  }

  const std::shared_ptr<State> state_;
  const std::uint32_t server_;
};

SimulatedEngine::SimulatedEngine(const SimulatedTimer& timer, std::uint64_t seed) : state_(std::make_shared<State>(timer, seed)) {}
SimulatedEngine::~SimulatedEngine() = default;

std::shared_ptr<Bus> SimulatedEngine::connect() {
  const std::lock_guard lock(state_->mutex);
  const std::uint32_t server = ++state_->servers;
  State::Line& line = state_->lines[server];
  line.isOpen = !state_->isStopped;
  return std::make_shared<Connection>(state_, server);
}

void SimulatedEngine::slow(Duration delay, Duration jitter) {
  const std::lock_guard lock(state_->mutex);
  state_->delay = delay;
  state_->jitter = jitter;
}
void SimulatedEngine::notice(Duration after) {
  const std::lock_guard lock(state_->mutex);
  state_->patience = after;
}
void SimulatedEngine::cut(const Bus& server) {
  const std::lock_guard lock(state_->mutex);
  if (std::exchange(state_->lines.at(server.server()).isCut, true) || state_->isStopped) return;
  state_->broke(server.server());
}
void SimulatedEngine::mend(const Bus& server) {
  const std::lock_guard lock(state_->mutex);
  if (std::exchange(state_->lines.at(server.server()).isCut, false)) state_->reopen(server.server());
}
void SimulatedEngine::end(const Bus& server) {
  const std::lock_guard lock(state_->mutex);
  state_->lines.at(server.server()).isCut = true;
  state_->loseCalls(server.server());
  state_->close(server.server());
}
void SimulatedEngine::stop() {
  const std::lock_guard lock(state_->mutex);
  if (std::exchange(state_->isStopped, true)) return;
  for (const auto& [server, line] : state_->lines)
    if (!line.isCut) state_->broke(server);
}
void SimulatedEngine::start() {
  const std::lock_guard lock(state_->mutex);
  if (!std::exchange(state_->isStopped, false)) return;
  for (const auto& [server, line] : state_->lines) state_->reopen(server);
}
void SimulatedEngine::loseEnd(const std::string& log, std::size_t entries) {
  const std::lock_guard lock(state_->mutex);
  state_->failOver();  // first: what was on its way may still have arrived, and be lost, too
  std::vector<Entry>& all = state_->logs[log];
  all.resize(all.size() - std::min(entries, all.size()));
}
void SimulatedEngine::loseRecords() {
  const std::lock_guard lock(state_->mutex);
  state_->failOver();
  state_->records.clear();
}
void SimulatedEngine::fill() {
  const std::lock_guard lock(state_->mutex);
  state_->isFull = true;
}
void SimulatedEngine::empty() {
  const std::lock_guard lock(state_->mutex);
  state_->isFull = false;
}
void SimulatedEngine::setClock(std::chrono::microseconds ahead) {
  const std::lock_guard lock(state_->mutex);
  state_->ahead = ahead;
}

std::vector<Entry> SimulatedEngine::log(const std::string& name) const {
  const std::lock_guard lock(state_->mutex);
  const auto found = state_->logs.find(name);
  return found == state_->logs.end() ? std::vector<Entry>() : found->second;
}
std::uint64_t SimulatedEngine::last(const std::string& log) const {
  const std::lock_guard lock(state_->mutex);
  return state_->lastOf(log);
}
SimulatedEngine::Traffic SimulatedEngine::traffic() const {
  const std::lock_guard lock(state_->mutex);
  return state_->traffic;
}

}  // namespace ridgecast::testing_support
