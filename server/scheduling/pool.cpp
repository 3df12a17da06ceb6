#include "server/scheduling/pool.h"

#include <algorithm>
#include <atomic>
#include <cassert>
#include <chrono>
#include <condition_variable>
#include <ctime>
#include <deque>
#include <mutex>
#include <thread>
#include <unordered_set>
#include <utility>

#include "server/scheduling/loop.h"

// One lock for the executor guards who works for whom; it is taken when a thread changes the pool it works for, not for every task.
// A parallel loop (Region) lives on its caller's stack. Helpers join and leave it under the executor's lock, and the caller leaves only
// when the last helper has left, so no helper ever sees a region that is gone. Each region has its own way of handing out work: an
// atomic counter for forEach, a heap of ready tasks under a lock of its own for forEachOrdered.
//
// Nothing can deadlock: whoever calls a loop works on it, and waits only for tasks that a thread has already started.

namespace ridgecast::scheduling {

namespace {

constexpr std::size_t kMaxPosted = 1024;
// A pool's tasks are long while one of its last took more than kLong; a new pool's are until two were short.
constexpr std::chrono::nanoseconds kLong = std::chrono::milliseconds(10), kUnknown = kLong * 3 / 2;

std::chrono::nanoseconds threadCpuTime() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return std::chrono::seconds(t.tv_sec) + std::chrono::nanoseconds(t.tv_nsec);
}

// A thread that runs dry looks around this long before it sleeps: an iteration is a row of short loops, and waking a thread takes longer.
constexpr std::chrono::microseconds kSpin{100};

inline void pause() {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#else
  std::this_thread::yield();
#endif
}

template <class Condition>
bool spinUntil(const Condition& condition) {
  const auto end = std::chrono::steady_clock::now() + kSpin;
  do {
    for (int k = 0; k < 16; ++k) {
      if (condition()) return true;
      pause();
    }
  } while (std::chrono::steady_clock::now() < end);
  return false;
}

bool never() { return false; }

class Region {
 public:
  virtual bool wantsHelp() const = 0;
  // Works until nothing is left to start, or until `leave()` after any task. Must not throw.
  virtual void help(const std::function<bool()>& leave) noexcept = 0;

  std::atomic<unsigned> helpers{0};  // changed under the executor's lock
  std::condition_variable helpersGone;

 protected:
  ~Region() = default;
};

}  // namespace

struct Pool::Impl : std::enable_shared_from_this<Pool::Impl> {
  std::shared_ptr<Executor::State> executor;
  unsigned limit = 1;

  // Under the executor's lock.
  std::deque<std::function<void()>> posted;
  std::vector<Region*> regions;  // innermost last
  unsigned inFlight = 0;
  bool queued = false;
  bool closed = false;
  std::chrono::nanoseconds usual = kUnknown;  // of a task: the longest lately
  std::atomic<bool> takesMore{true};          // inFlight < limit and not queued; also read without the lock, as a hint

  ~Impl();
  Region* regionThatWantsHelp() const {
    for (auto it = regions.rbegin(); it != regions.rend(); ++it)
      if ((*it)->wantsHelp()) return *it;
    return nullptr;
  }
  void noteChange() { takesMore = inFlight < limit && !queued; }
  void run(Region& region, std::size_t helpersUseful, const std::function<void()>& work);
  const std::atomic<unsigned>* others() const;  // threads that work for the executor that goes first; null: none does
};

struct Executor::State {
  std::mutex mutex;
  std::condition_variable work;
  std::deque<std::shared_ptr<Pool::Impl>> ready;  // pools with work and room, served in turn
  std::atomic<std::size_t> waiting{0};            // ready.size()
  std::deque<std::shared_ptr<Pool::Impl>> held;   // taken from `ready`: there are as many long tasks as there may be
  unsigned longTasks = 0;                         // in flight
  std::unordered_set<Pool::Impl*> pools;
  unsigned idle = 0;
  bool roused = false;  // one is to wake without there being work yet
  bool stop = false;
  unsigned threads = 1;
  std::vector<std::thread> workers;
  std::atomic<unsigned> working{0};    // threads that run a task; a hint
  std::shared_ptr<const State> first;  // the executor that goes before this one, or none

  // All under the lock.
  bool enqueue(Pool::Impl& pool) {
    if (stop || pool.queued || pool.inFlight >= pool.limit) return false;
    if (pool.posted.empty() && !pool.regionThatWantsHelp()) return false;
    pool.queued = true;
    pool.noteChange();
    ready.push_back(pool.shared_from_this());
    waiting = ready.size();
    return true;
  }
  void summon(Pool::Impl& pool) {
    if (enqueue(pool) && idle > 0) work.notify_one();
  }
  bool takesLong() const { return longTasks + 1 < std::max(2u, threads); }
  void serve();
  void help(Pool::Impl& pool, Region* region, std::function<void()> task) noexcept;
};

namespace {
thread_local const void* workingFor = nullptr;  // the Pool::Impl whose task this thread runs

struct WorkingFor {
  const void* before;
  explicit WorkingFor(const void* pool) : before(std::exchange(workingFor, pool)) {}
  ~WorkingFor() { workingFor = before; }
};
}  // namespace

Pool::Impl::~Impl() {
  const std::lock_guard lock(executor->mutex);
  executor->pools.erase(this);
}

// The task, too, is destroyed without the lock: what it captured may be the last owner of anything.
// NOLINTNEXTLINE(performance-unnecessary-value-param)
void Executor::State::help(Pool::Impl& pool, Region* region, std::function<void()> task) noexcept {
  const WorkingFor mark(&pool);
  working.fetch_add(1, std::memory_order_relaxed);
  if (region)
    region->help([this] { return waiting.load(std::memory_order_relaxed) > 0; });
  else if (task)
    task();
  working.fetch_sub(1, std::memory_order_relaxed);
}

void Executor::State::serve() {
  std::shared_ptr<Pool::Impl> last;  // let go of without the lock: it may be the last owner
  std::unique_lock lock(mutex);
  for (;;) {
    if (ready.empty() && !stop) {
      lock.unlock();
      last.reset();
      spinUntil([this] { return waiting.load(std::memory_order_relaxed) > 0; });
      lock.lock();
      ++idle;
      work.wait(lock, [this] { return stop || roused || !ready.empty(); });
      --idle;
      if (std::exchange(roused, false) && ready.empty() && !stop) continue;  // looks around again
    }
    if (stop) return;

    std::shared_ptr<Pool::Impl> pool = std::move(ready.front());
    ready.pop_front();
    waiting = ready.size();
    Region* region = pool->regionThatWantsHelp();
    const bool isLong = !region && !pool->posted.empty() && pool->usual > kLong;
    if (isLong && !takesLong()) {
      held.push_back(std::move(pool));
      continue;
    }
    pool->queued = false;
    ++pool->inFlight;
    longTasks += isLong;
    std::function<void()> task;
    if (region) {
      ++region->helpers;
    } else if (!pool->posted.empty()) {
      task = std::move(pool->posted.front());
      pool->posted.pop_front();
    }
    pool->noteChange();
    summon(*pool);  // more work and more room: to the back of the row
    lock.unlock();
    last.reset();
    const auto begin = threadCpuTime();
    help(*pool, region, std::move(task));
    const auto took = threadCpuTime() - begin;
    lock.lock();
    if (!region) pool->usual = std::max(took, pool->usual * 4 / 5);
    longTasks -= isLong;
    if (!held.empty() && takesLong()) {
      ready.push_front(std::move(held.front()));
      held.pop_front();
      waiting = ready.size();
    }
    if (region && --region->helpers == 0) region->helpersGone.notify_one();
    --pool->inFlight;
    pool->noteChange();
    enqueue(*pool);
    last = std::move(pool);
  }
}

Executor::Executor(unsigned threads, int lowerPriorityBy, const Executor* first) : state_(std::make_shared<State>()) {
  if (first) state_->first = first->state_;
  state_->threads = threads ? threads : std::max(1u, std::thread::hardware_concurrency());
  state_->workers.reserve(state_->threads);
  for (unsigned k = 0; k < state_->threads; ++k)
    state_->workers.emplace_back([state = state_.get(), lowerPriorityBy] {
      lowerPriority(lowerPriorityBy);
      state->serve();
    });
}

Executor::~Executor() {
  {
    const std::lock_guard lock(state_->mutex);
    state_->stop = true;
    state_->work.notify_all();
  }
  for (auto& worker : state_->workers) worker.join();
  std::vector<std::deque<std::function<void()>>> dropped;
  std::deque<std::shared_ptr<Pool::Impl>> released;
  {
    const std::lock_guard lock(state_->mutex);
    for (Pool::Impl* pool : state_->pools) dropped.push_back(std::exchange(pool->posted, {}));
    released.swap(state_->ready);
    std::ranges::move(std::exchange(state_->held, {}), std::back_inserter(released));
  }
}

unsigned Executor::threads() const { return state_->threads; }

std::size_t Executor::queued() const {
  const std::lock_guard lock(state_->mutex);
  std::size_t sum = 0;
  for (const Pool::Impl* pool : state_->pools) sum += pool->posted.size();
  return sum;
}

std::shared_ptr<Pool> Executor::makePool(unsigned limit) {
  auto impl = std::make_shared<Pool::Impl>();
  impl->executor = state_;
  impl->limit = std::min(limit ? limit : 4u, state_->threads);
  {
    const std::lock_guard lock(state_->mutex);
    state_->pools.insert(impl.get());
  }
  return std::shared_ptr<Pool>(new Pool(std::move(impl)));
}

const std::atomic<unsigned>* Pool::Impl::others() const { return executor->first ? &executor->first->working : nullptr; }

Pool::Pool(std::shared_ptr<Impl> impl) : impl_(std::move(impl)) {}

Pool::~Pool() {
  std::deque<std::function<void()>> dropped;
  const std::lock_guard lock(impl_->executor->mutex);
  impl_->closed = true;
  dropped.swap(impl_->posted);
  // `dropped` was declared first, so it is destroyed after the lock is released.
}

bool Pool::post(std::function<void()> task) {
  auto& executor = *impl_->executor;
  const std::lock_guard lock(executor.mutex);
  if (executor.stop || impl_->closed || impl_->posted.size() >= kMaxPosted) return false;
  impl_->posted.push_back(std::move(task));
  executor.summon(*impl_);
  return true;
}

void Pool::rouse() {
  auto& executor = *impl_->executor;
  if (impl_->limit == 1) return;
  const std::lock_guard lock(executor.mutex);
  if (executor.idle == 0 || executor.roused) return;
  executor.roused = true;
  executor.work.notify_one();
}

// Publishes a region, works on it through `work`, and returns when the last helper has left. The caller counts as one of the pool's
// tasks; a thread from outside takes a place of its own, so that callers and helpers together keep to the limit.
void Pool::Impl::run(Region& region, std::size_t helpersUseful, const std::function<void()>& work) {
  const bool outside = workingFor != this;
  {
    const std::lock_guard lock(executor->mutex);
    regions.push_back(&region);
    if (outside) ++inFlight;
    noteChange();
    if (executor->enqueue(*this)) {
      const std::size_t room = limit - inFlight;
      for (std::size_t k = std::min<std::size_t>({helpersUseful, room, executor->idle}); k > 0; --k) executor->work.notify_one();
    }
  }
  {
    const WorkingFor mark(this);
    work();
  }
  // Whoever is still in its last task is worth a short look before sleeping. The lock below orders what it did before what follows.
  if (region.helpers.load(std::memory_order_relaxed) > 0) spinUntil([&] { return region.helpers.load(std::memory_order_relaxed) == 0; });
  std::unique_lock lock(executor->mutex);
  regions.erase(std::find(regions.begin(), regions.end(), &region));
  region.helpersGone.wait(lock, [&] { return region.helpers == 0; });
  if (outside) {
    --inFlight;
    noteChange();
    executor->summon(*this);
  }
}

// ---- forEach ----

namespace {

class Range final : public Region {
 public:
  Range(std::size_t count, std::size_t grain, const std::function<void(std::size_t)>& body) : count_(count), grain_(grain), body_(body) {}

  bool wantsHelp() const override { return next_.load() < count_; }

  void help(const std::function<bool()>& leave) noexcept override {
    while (batch())
      if (leave()) return;
  }

  bool batch() noexcept {
    // Looked at before it is raised, so that late helpers cannot carry the counter around.
    if (next_.load(std::memory_order_relaxed) >= count_) return false;
    const std::size_t begin = next_.fetch_add(grain_);
    if (begin >= count_) return false;
    const std::size_t end = begin + std::min(grain_, count_ - begin);
    for (std::size_t k = begin; k < end; ++k) body_(k);
    return true;
  }

 private:
  const std::size_t count_, grain_;
  const std::function<void(std::size_t)>& body_;
  std::atomic<std::size_t> next_{0};
};

void runInline(std::size_t count, const std::function<void(std::size_t)>& body) noexcept {
  for (std::size_t k = 0; k < count; ++k) body(k);
}

}  // namespace

void Pool::forEach(std::size_t count, std::size_t grain, const std::function<void(std::size_t)>& task) {
  Loop loop(task, impl_->others());
  const std::function<void(std::size_t)> body = std::ref(loop);
  grain = std::max<std::size_t>(grain, 1);
  if (count <= grain || impl_->limit == 1) {
    runInline(count, body);
  } else {
    Range range(count, grain, body);
    impl_->run(range, (count - 1) / grain, [&] { range.help(never); });
  }
  loop.rethrow();
}

// ---- forEachOrdered ----

namespace {

class Ordered final : public Region {
 public:
  Ordered(const Order& order, const std::function<void(std::size_t)>& body, std::function<void()> callHelp)
      : count_(order.size()), body_(body), callHelp_(std::move(callHelp)), missing_(count_), first_(count_ + 1) {
    for (std::size_t k = 0; k < count_; ++k) {
      missing_[k] = static_cast<std::uint32_t>(order[k].size());
      for (const std::uint32_t p : order[k]) {
        assert(p < k && "a predecessor must be smaller");
        ++first_[p + 1];
      }
    }
    for (std::size_t k = 0; k < count_; ++k) first_[k + 1] += first_[k];
    followers_.resize(first_[count_]);
    std::vector<std::uint32_t> fill(first_.begin(), first_.end() - 1);
    for (std::size_t k = 0; k < count_; ++k)
      for (const std::uint32_t p : order[k]) followers_[fill[p]++] = static_cast<std::uint32_t>(k);
    for (std::size_t k = 0; k < count_; ++k)
      if (missing_[k] == 0) ready_.push_back(static_cast<std::uint32_t>(k));  // ascending is a heap already
    readyCount_ = ready_.size();
  }

  bool wantsHelp() const override { return readyCount_.load() > 0; }

  void help(const std::function<bool()>& leave) noexcept override { work(false, leave); }
  void lead() noexcept { work(true, never); }

 private:
  void work(bool caller, const std::function<bool()>& leave) noexcept {
    std::unique_lock lock(mutex_);
    for (;;) {
      if (ready_.empty()) {
        if (done_ == count_) return;
        lock.unlock();
        const bool more = spinUntil(
            [&] { return readyCount_.load(std::memory_order_relaxed) > 0 || finished_.load(std::memory_order_relaxed) || leave(); });
        lock.lock();
        if (caller) {
          callerWaits_ = true;
          wake_.wait(lock, [&] { return !ready_.empty() || done_ == count_; });
          callerWaits_ = false;
        } else if (!more || leave()) {
          return;
        }
        continue;
      }
      std::pop_heap(ready_.begin(), ready_.end(), std::greater<>());
      const std::uint32_t task = ready_.back();
      ready_.pop_back();
      readyCount_ = ready_.size();
      lock.unlock();
      body_(task);
      lock.lock();
      finish(task);
      if (done_ == count_) {
        finished_ = true;
        if (callerWaits_) wake_.notify_one();
        return;
      }
      std::size_t spare = ready_.size();
      const bool leaving = leave();
      if (spare > 0 && !leaving) --spare;  // one for this thread
      if (spare > 0 && callerWaits_) {
        wake_.notify_one();
        --spare;
      }
      if (spare > 0) {
        lock.unlock();
        callHelp_();
        lock.lock();
      }
      if (leaving) return;
    }
  }

  void finish(std::uint32_t task) {  // what waited for it may start
    ++done_;
    for (std::uint32_t f = first_[task]; f < first_[task + 1]; ++f) {
      if (--missing_[followers_[f]] > 0) continue;
      ready_.push_back(followers_[f]);
      std::push_heap(ready_.begin(), ready_.end(), std::greater<>());
    }
    readyCount_ = ready_.size();
  }

  const std::size_t count_;
  const std::function<void(std::size_t)>& body_;
  const std::function<void()> callHelp_;
  std::vector<std::uint32_t> missing_;  // predecessors that are not done
  std::vector<std::uint32_t> first_, followers_;
  std::mutex mutex_;
  std::condition_variable wake_;      // the caller's
  std::vector<std::uint32_t> ready_;  // a heap, least first
  std::atomic<std::size_t> readyCount_{0};
  std::atomic<bool> finished_{false};
  std::size_t done_ = 0;
  bool callerWaits_ = false;
};

}  // namespace

void Pool::forEachOrdered(const Order& order, const std::function<void(std::size_t)>& task) {
  Loop loop(task, impl_->others());
  const std::function<void(std::size_t)> body = std::ref(loop);
  // Predecessors are smaller, so ascending order is always right when one thread does it all.
  if (order.size() <= 1 || impl_->limit == 1) {
    runInline(order.size(), body);
    return loop.rethrow();
  }
  Ordered ordered(order, body, [impl = impl_.get()] {
    if (!impl->takesMore) return;
    const std::lock_guard lock(impl->executor->mutex);
    impl->executor->summon(*impl);
  });
  impl_->run(ordered, order.size() - 1, [&] { ordered.lead(); });
  loop.rethrow();
}

}  // namespace ridgecast::scheduling
