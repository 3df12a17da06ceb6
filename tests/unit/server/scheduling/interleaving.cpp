#include "tests/unit/server/scheduling/interleaving.h"

#include <ucontext.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <new>
#include <unordered_map>
#include <vector>

namespace ridgecast::interleaving {

namespace {

constexpr std::size_t kStack = 16 << 10, kFrame = 512, kUnit = 64, kUnits = 512;

enum class At { kPoint, kLock, kAsleep, kNotify, kUntil, kJoin, kBegin, kEnd };

struct Fiber {  // a thread
  At at = At::kPoint;
  std::size_t joins = 0;
  Mutex* lock = nullptr;  // wanted now, or when it wakes
  const Condition* condition = nullptr;
  const std::function<bool()>* until = nullptr;
  const char* what = nullptr;
  const std::function<void()>* body = nullptr;
  const void* perThread = nullptr;
  std::int64_t worked = 0;  // ns
  char* low = nullptr;      // its stack is alive from here on
};

// With the stacks and the arena, all that a state is. The contexts add nothing: see leave().
struct World {
  std::array<Fiber, kThreads> fibers;
  std::size_t threads = 0;
  unsigned conditions = 0;                      // made so far, at most kNamed
  const char* broken = nullptr;                 // a law
  std::array<std::uint16_t, kUnits> lengths{};  // of what was allocated at a unit of the arena, in units; 0: nothing
};

World world;
alignas(kUnit) char arena[kUnits * kUnit];     // zero where it is free
alignas(kUnit) char stacks[kThreads][kStack];  // zero below low - kFrame
std::array<ucontext_t, kThreads> contexts;
ucontext_t outside;
std::size_t current = kThreads;  // kThreads: none, the scheduler itself runs
const void** threadLocal = nullptr;

Fiber& self() { return world.fibers[current]; }
char* top(std::size_t fiber) { return stacks[fiber] + kStack; }

// The first free place, so that what lies where depends little on the order.
void* take(std::size_t bytes) {
  const std::size_t needed = std::max<std::size_t>(1, (bytes + kUnit - 1) / kUnit);
  for (std::size_t begin = 0, end = 0; end < kUnits;) {
    if (world.lengths[end] > 0) {
      begin = end += world.lengths[end];
    } else if (++end - begin == needed) {
      world.lengths[begin] = static_cast<std::uint16_t>(needed);
      return arena + begin * kUnit;
    }
  }
  std::abort();
}

bool giveBack(void* place) {
  const auto offset = static_cast<std::size_t>(static_cast<char*>(place) - arena);
  if (std::less<>()(place, arena) || offset >= sizeof(arena)) return false;
  const std::size_t units = std::exchange(world.lengths[offset / kUnit], 0);
  if (units == 0) std::abort();  // freed twice
  std::memset(place, 0, units * kUnit);
  return true;
}

std::size_t arenaInUse() {
  std::size_t k = kUnits;
  while (k > 0 && world.lengths[k - 1] == 0) --k;
  return k == 0 ? 0 : (k - 1 + world.lengths[k - 1]) * kUnit;
}

// What a caller keeps in registers is on the stack above this frame, for switchOut() puts it there.
[[gnu::noinline]] void leave() {
  self().low = static_cast<char*>(__builtin_frame_address(0));
  swapcontext(&contexts[current], &outside);
}

[[gnu::noinline]] void switchOut(At at) {
  __builtin_unwind_init();
  self().at = at;
  leave();
  asm volatile("" ::: "memory");
}

void run() {
  (*self().body)();
  if (current != 0) delete self().body;
  self().body = nullptr;
  switchOut(At::kEnd);
}

std::size_t add(const std::function<void()>* body) {
  const std::size_t number = world.threads++;
  if (number == kThreads) std::abort();
  world.fibers[number].body = body;
  getcontext(&contexts[number]);
  contexts[number].uc_stack = {.ss_sp = stacks[number], .ss_flags = 0, .ss_size = kStack};
  makecontext(&contexts[number], run, 0);
  world.fibers[number].low = top(number) - kFrame;
  return number;
}

std::vector<std::size_t> sleepers(const Condition* condition) {
  std::vector<std::size_t> found;
  for (std::size_t k = 0; k < world.threads; ++k)
    if (world.fibers[k].at == At::kAsleep && world.fibers[k].condition == condition) found.push_back(k);
  return found;
}

// All regions of memory that a state consists of, the stacks from `margin` below their lowest frame on.
template <class Visit>
void regions(std::size_t margin, const Visit& visit) {
  visit(reinterpret_cast<char*>(&world), sizeof(world));
  visit(arena, arenaInUse());
  for (std::size_t k = 0; k < world.threads; ++k) {
    char* const low = world.fibers[k].low - margin;
    visit(low, static_cast<std::size_t>(top(k) - low));
  }
}

std::uint64_t hashNow() {
  std::uint64_t hash = 0;
  regions(0, [&](const char* from, std::size_t bytes) {
    for (std::uint64_t word; bytes >= sizeof(word); from += sizeof(word), bytes -= sizeof(word)) {
      std::memcpy(&word, from, sizeof(word));
      hash = (hash ^ word) * 0x9E3779B97F4A7C15u;
      hash ^= hash >> 29;
    }
  });
  return hash;
}

using Saved = std::vector<char>;

Saved save() {
  Saved saved;
  regions(kFrame, [&](const char* from, std::size_t bytes) { saved.insert(saved.end(), from, from + bytes); });
  const auto* const kept = reinterpret_cast<const char*>(contexts.data());
  saved.insert(saved.end(), kept, kept + world.threads * sizeof(ucontext_t));
  return saved;
}

void clear() {  // but for the world, which says what there is
  regions(kFrame, [](char* from, std::size_t bytes) {
    if (from != reinterpret_cast<char*>(&world)) std::memset(from, 0, bytes);
  });
}

void restore(const Saved& saved) {
  clear();
  const char* at = saved.data();
  const auto fetch = [&](void* to, std::size_t bytes) {
    std::memcpy(to, at, bytes);
    at += bytes;
  };
  regions(kFrame, fetch);  // the world comes first and says how large the others are
  fetch(contexts.data(), world.threads * sizeof(ucontext_t));
}

struct Choice {
  std::uint8_t thread, sleeper;  // which goes on, and which sleeper it wakes
};

struct Edge {
  std::uint32_t from, to;
  Choice choice;
};

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

// What was found: states by number, the beginning first.
struct Graph {
  std::unordered_map<std::uint64_t, std::uint32_t> states;  // by hash
  std::vector<Edge> edges;
  std::uint32_t end = kNone;

  std::vector<std::uint32_t> reach(std::uint32_t first, bool backwards) const;
  std::vector<Edge> pathTo(std::uint32_t state) const;
  std::uint32_t firstLost() const;
};

// By state: the edge over which a search from `first` came to it; kNone: it did not. Backwards: against the edges.
std::vector<std::uint32_t> Graph::reach(std::uint32_t first, bool backwards) const {
  std::vector<std::uint32_t> begins(states.size() + 1, 0), order(edges.size()), by(states.size(), kNone), row{first};
  const auto from = [&](const Edge& edge) { return backwards ? edge.to : edge.from; };
  for (const Edge& edge : edges) ++begins[from(edge) + 1];
  for (std::size_t k = 0; k < states.size(); ++k) begins[k + 1] += begins[k];
  std::vector<std::uint32_t> fill(begins.begin(), begins.end() - 1);
  for (std::uint32_t k = 0; k < edges.size(); ++k) order[fill[from(edges[k])]++] = k;
  std::vector<bool> seen(states.size(), false);
  seen[first] = true;
  for (std::size_t at = 0; at < row.size(); ++at)
    for (std::uint32_t k = begins[row[at]]; k < begins[row[at] + 1]; ++k) {
      const std::uint32_t next = backwards ? edges[order[k]].from : edges[order[k]].to;
      if (seen[next]) continue;
      seen[next] = true;
      by[next] = order[k];
      row.push_back(next);
    }
  return by;
}

// A shortest one from the beginning.
std::vector<Edge> Graph::pathTo(std::uint32_t state) const {
  const auto by = reach(0, false);
  std::vector<Edge> path;
  for (; by[state] != kNone; state = path.back().from) path.push_back(edges[by[state]]);
  std::reverse(path.begin(), path.end());
  return path;
}

// The nearest to the beginning from which the end cannot be reached; kNone: there is none.
std::uint32_t Graph::firstLost() const {
  std::vector<bool> leadsToEnd(states.size(), false);
  if (end != kNone) {
    const auto by = reach(end, true);
    for (std::size_t k = 0; k < by.size(); ++k) leadsToEnd[k] = k == end || by[k] != kNone;
  }
  if (!leadsToEnd[0]) return 0;
  const auto by = reach(0, false);
  std::vector<std::uint32_t> length(states.size(), 0);
  std::uint32_t lost = kNone;
  for (std::uint32_t k = 0; k < states.size(); ++k) {
    if (leadsToEnd[k]) continue;
    for (std::uint32_t at = k; at != 0; at = edges[by[at]].from) ++length[k];
    if (lost == kNone || length[k] < length[lost]) lost = k;
  }
  return lost;
}

}  // namespace

struct Scheduler {
  const Names& names;

  static std::vector<Choice> choices(bool hasBegun) {
    std::vector<Choice> all;
    for (std::uint8_t k = 0; k < world.threads; ++k) {
      const Fiber& fiber = world.fibers[k];
      const bool goesOn = fiber.at == At::kPoint || fiber.at == At::kNotify || (fiber.at == At::kLock && fiber.lock->owner_ == kThreads) ||
                          (fiber.at == At::kUntil && (*fiber.until)()) || (fiber.at == At::kBegin && hasBegun) ||
                          (fiber.at == At::kJoin && world.fibers[fiber.joins].at == At::kEnd);
      if (!goesOn) continue;
      const std::size_t ways = fiber.at == At::kNotify ? std::max<std::size_t>(1, sleepers(fiber.condition).size()) : 1;
      for (std::uint8_t way = 0; way < ways; ++way) all.push_back({k, way});
    }
    return all;
  }

  static void step(Choice choice) {
    Fiber& fiber = world.fibers[choice.thread];
    if (fiber.at == At::kLock) fiber.lock->owner_ = choice.thread;
    if (fiber.at == At::kNotify)
      if (const auto asleep = sleepers(fiber.condition); !asleep.empty()) world.fibers[asleep[choice.sleeper]].at = At::kLock;
    fiber.lock = nullptr;
    fiber.condition = nullptr;
    fiber.until = nullptr;
    fiber.what = nullptr;
    current = choice.thread;
    *threadLocal = fiber.perThread;
    swapcontext(&outside, &contexts[choice.thread]);
    fiber.perThread = std::exchange(*threadLocal, nullptr);
    current = kThreads;
    std::memset(stacks[choice.thread], 0, static_cast<std::size_t>(fiber.low - kFrame - stacks[choice.thread]));
    if (hasEnded() && arenaInUse() > 0) world.broken = "something is left allocated at the end";
  }

  static bool hasEnded() {
    return std::all_of(world.fibers.begin(), world.fibers.begin() + static_cast<std::ptrdiff_t>(world.threads),
                       [](const Fiber& fiber) { return fiber.at == At::kEnd; });
  }

  std::string nameOf(const Condition* condition) const { return names[condition->number_]; }
  static std::string nameOf(std::size_t thread) { return thread == 0 ? "the first thread" : "thread " + std::to_string(thread); }

  // What a thread does next, or waits for.
  std::string next(std::size_t thread, std::size_t sleeper) const {
    const Fiber& fiber = world.fibers[thread];
    switch (fiber.at) {
      case At::kPoint:
        return fiber.what ? fiber.what : "goes on";
      case At::kLock:
        return fiber.condition ? "wakes" : "takes a lock";
      case At::kAsleep:
        return "sleeps on " + nameOf(fiber.condition);
      case At::kNotify: {
        const auto asleep = sleepers(fiber.condition);
        return "notifies " + (asleep.empty() ? "nobody" : nameOf(asleep[sleeper])) + " on " + nameOf(fiber.condition);
      }
      case At::kUntil:
        return std::string("needs: ") + fiber.what;
      case At::kJoin:
        return "joins " + nameOf(fiber.joins);
      case At::kBegin:
        return "begins";
      case At::kEnd:
        return "has ended";
    }
    return "";
  }

  std::string report(const std::string& what, const Saved& first, const std::vector<Edge>& path) const {
    std::string text = what + "\n";
    restore(first);
    for (const Edge& edge : path) {
      const std::size_t thread = edge.choice.thread;
      const bool isWorthALine = world.fibers[thread].at != At::kPoint || world.fibers[thread].what;
      if (isWorthALine) text += "  " + nameOf(thread) + " " + next(thread, edge.choice.sleeper) + "\n";
      step(edge.choice);
      if (world.fibers[thread].at == At::kAsleep) text += "  " + nameOf(thread) + " " + next(thread, 0) + "\n";
    }
    text += "Then:\n";
    for (std::size_t k = 0; k < world.threads; ++k) text += "  " + nameOf(k) + ": " + next(k, 0) + "\n";
    return text;
  }
};

namespace {

// All threads as they are where the scenario begins.
Saved start(const std::function<void()>& scenario, const void** perThread) {
  clear();
  world = World{};
  threadLocal = perThread;
  add(&scenario);
  for (auto all = Scheduler::choices(false); !all.empty(); all = Scheduler::choices(false)) Scheduler::step(all.front());
  for (Fiber& fiber : world.fibers) {
    if (fiber.at == At::kBegin) fiber.at = At::kPoint;
    fiber.worked = 0;
  }
  return save();
}

}  // namespace

Report tryAll(const std::function<void()>& scenario, const void** perThread, const Names& conditions) {
  struct Open {
    std::uint32_t state;
    Saved saved;
  };
  const Saved first = start(scenario, perThread);
  const Scheduler scheduler{conditions};
  Graph graph;
  graph.states.emplace(hashNow(), 0);
  const auto told = [&](const std::string& trouble) { return Report{graph.states.size(), graph.edges.size(), trouble}; };
  std::vector<Open> open;
  open.push_back({0, first});
  while (!open.empty()) {
    const Open here = std::move(open.back());
    open.pop_back();
    restore(here.saved);
    for (const auto all = Scheduler::choices(true); const Choice& choice : all) {
      if (&choice != &all.front()) restore(here.saved);
      Scheduler::step(choice);
      const auto [found, isNew] = graph.states.try_emplace(hashNow(), static_cast<std::uint32_t>(graph.states.size()));
      const std::uint32_t state = found->second;
      graph.edges.push_back({here.state, state, choice});
      if (world.broken) return told(scheduler.report(std::string("Broken: ") + world.broken + ", after", first, graph.pathTo(state)));
      if (!isNew) continue;
      if (graph.states.size() > kMaxStates) return told("There are more states than are tried.");
      if (!Scheduler::hasEnded())
        open.push_back({state, save()});
      else if (graph.end == kNone)
        graph.end = state;
      else
        graph.edges.push_back({state, graph.end, choice});  // all ends are one
    }
  }
  const std::uint32_t lost = graph.firstLost();
  return told(lost == kNone ? "" : scheduler.report("Nothing leads to the end any more, after", first, graph.pathTo(lost)));
}

void point(const char* what) {
  self().what = what;
  switchOut(At::kPoint);
}

void until(const std::function<bool()>& condition, const char* what) {
  self().until = &condition;
  self().what = what;
  switchOut(At::kUntil);
}

void begin() { switchOut(At::kBegin); }

void expect(bool holds, const char* law) {
  if (!holds) world.broken = law;
}

std::chrono::nanoseconds cpuTime() { return std::chrono::nanoseconds(self().worked); }
void spend(std::chrono::nanoseconds time) { self().worked += time.count(); }

void Mutex::lock() {
  self().lock = this;
  switchOut(At::kLock);
}

void Mutex::unlock() { owner_ = kThreads; }

Condition::Condition() : number_(world.conditions) { world.conditions = std::min(kNamed, world.conditions + 1); }

void Condition::wait(std::unique_lock<Mutex>& lock) {
  lock.mutex()->unlock();
  self().lock = lock.mutex();
  self().condition = this;
  switchOut(At::kAsleep);
}

void Condition::notify_one() {
  const auto asleep = sleepers(this);
  if (asleep.empty()) return;
  expect(world.fibers[asleep[0]].lock->owner_ == current, "a thread notifies without the lock");
  if (asleep.size() == 1) {  // nobody else can come to sleep or wake meanwhile
    world.fibers[asleep[0]].at = At::kLock;
    return;
  }
  self().condition = this;
  switchOut(At::kNotify);
}

void Condition::notify_all() {
  for (std::size_t count = sleepers(this).size(); count > 0; --count) notify_one();
}

std::size_t Thread::start(const std::function<void()>* body) { return add(body); }

void Thread::join() const {
  self().joins = number_;
  switchOut(At::kJoin);
}

}  // namespace ridgecast::interleaving

// What the threads allocate lies in the arena.
void* operator new(std::size_t bytes) {
  using namespace ridgecast::interleaving;
  void* const place = current == kThreads ? std::malloc(bytes) : take(bytes);
  if (!place) throw std::bad_alloc();
  return place;
}
void operator delete(void* place) noexcept {
  if (place && !ridgecast::interleaving::giveBack(place)) std::free(place);
}
void operator delete(void* place, std::size_t) noexcept { operator delete(place); }
