#include "server/scheduling/pool.h"

#include <algorithm>
#include <chrono>
#include <deque>
#include <iterator>
#include <mutex>
#include <string>
#include <thread>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "common/outcome/contract.h"
#include "server/scheduling/loop.h"
#include "server/scheduling/region.h"
#include "server/scheduling/threads.h"

// One lock for the executor guards who works for whom; it is taken when a thread changes the pool it works for, not for every task.
//
// Nothing can deadlock: whoever calls a loop works on it, and waits only for tasks that a thread has already started. No wake-up is lost:
// scheduling_interleaving_test tries all orders.

namespace ridgecast::scheduling {

namespace {

constexpr std::size_t kMaxPosted = 1024;
// A pool's tasks are long while one of its last took more than kLong, and short while none took more than kShort. The two lie apart:
// cameras that are alike must not come to lie on both sides, for those that are served less fly farther meanwhile and take longer still.
constexpr std::chrono::nanoseconds kLong = std::chrono::milliseconds(10), kShort = std::chrono::milliseconds(4), kUnknown = kLong * 3 / 2;

}  // namespace

// A client's pools that have work and room, served in turn. Under the executor's lock.
struct Pool::Row {
  std::string client;
  std::deque<std::shared_ptr<Impl>> ready;
};

struct Pool::Impl : std::enable_shared_from_this<Pool::Impl> {
  std::shared_ptr<Executor::State> executor;
  unsigned limit = 1;

  // Under the executor's lock.
  std::shared_ptr<Row> row;
  std::deque<std::function<void()>> posted;
  std::vector<Region*> regions;  // innermost last
  unsigned inFlight = 0;
  bool queued = false;
  bool closed = false;
  std::chrono::nanoseconds usual = kUnknown;  // of a task: the longest lately
  Atomic<bool> takesMore{true};               // inFlight < limit and not queued; also read without the lock, as a hint

  ~Impl();
  Region* regionThatWantsHelp() const {
    for (auto it = regions.rbegin(); it != regions.rend(); ++it)
      if ((*it)->wantsHelp()) return *it;
    return nullptr;
  }
  bool isLong() const { return usual > kLong; }
  bool hasShortTask() const { return usual <= kShort && !posted.empty() && !regionThatWantsHelp(); }
  void noteChange() { takesMore = inFlight < limit && !queued; }
  void run(Region& region, std::size_t helpersUseful, const std::function<void()>& work);
};

struct Executor::State {
  Mutex mutex;
  Condition work;
  std::deque<Pool::Row*> ready;    // those with a pool, served in turn
  Atomic<std::size_t> waiting{0};  // pools in all rows
  unsigned longTasks = 0;          // in flight
  unsigned inFlight = 0;           // of all pools, without what runs outside this executor's threads
  Usage usage;                     // of inFlight
  Condition shortWork;             // of the thread for short tasks
  std::unordered_set<Pool::Impl*> pools;
  std::unordered_map<std::string, std::weak_ptr<Pool::Row>> rows;  // of clients with a name
  unsigned idle = 0;
  bool roused = false;  // one is to wake without there being work yet
  bool stop = false;
  unsigned threads = 1;
  std::vector<Thread> workers;
  Atomic<unsigned> working{0};         // threads that run a task; a hint
  std::shared_ptr<const State> first;  // the executor that goes before this one, or none
  Courtesy courtesy;                   // towards it

  // All under the lock.
  // Puts a pool that has work and room at the back of the row and wakes `takers` threads for it. Only a thread that takes from the row
  // itself before it sleeps may wake none.
  void summon(Pool::Impl& pool, std::size_t takers = 1) {
    if (!stop && !pool.queued && pool.inFlight < pool.limit && (!pool.posted.empty() || pool.regionThatWantsHelp())) {
      pool.queued = true;
      pool.noteChange();
      if (pool.row->ready.empty()) ready.push_back(pool.row.get());
      pool.row->ready.push_back(pool.shared_from_this());
      ++waiting;
      for (std::size_t k = std::min<std::size_t>(takers, idle); k > 0; --k) work.notify_one();
    }
    if (longTasks >= threads && pool.queued && pool.hasShortTask()) shortWork.notify_one();  // it may have been queued for a loop
  }
  // The next pool that waits, or the next with a short task while all threads are at long ones. Null: there is none.
  std::shared_ptr<Pool::Impl> take(bool isForShortTasks) {
    if (isForShortTasks && longTasks < threads) return nullptr;
    const auto isNext = [&](const auto& pool) { return !isForShortTasks || pool->hasShortTask(); };
    for (auto row = ready.begin(); row != ready.end(); ++row) {
      auto& inTurn = (*row)->ready;
      const auto next = std::ranges::find_if(inTurn, isNext);
      if (next == inTurn.end()) continue;
      std::shared_ptr<Pool::Impl> pool = std::move(*next);
      inTurn.erase(next);
      ready.erase(row);
      if (!inTurn.empty()) ready.push_back(pool->row.get());
      --waiting;
      return pool;
    }
    return nullptr;
  }
  void serve();
  void serveShortTasks();
  void serveAll();
  // Under the lock, which is released meanwhile; `last` is let go of then, for it may be the last owner. `takers`: as summon(), if there is
  // more to do.
  void workFor(const std::shared_ptr<Pool::Impl>& pool, std::unique_lock<Mutex>& lock, std::shared_ptr<Pool::Impl>& last,
               std::size_t takers);
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
  if (row.use_count() == 1) executor->rows.erase(row->client);
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

void Executor::State::workFor(const std::shared_ptr<Pool::Impl>& pool, std::unique_lock<Mutex>& lock, std::shared_ptr<Pool::Impl>& last,
                              std::size_t takers) {
  Region* const region = pool->regionThatWantsHelp();
  const bool isLong = !region && !pool->posted.empty() && pool->isLong();
  pool->queued = false;
  ++pool->inFlight;
  usage.set(++inFlight, currentTime());
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
  if (isLong && longTasks >= threads) shortWork.notify_one();
  lock.unlock();
  last.reset();
  const auto begin = threadCpuTime();
  help(*pool, region, std::move(task));
  const auto took = threadCpuTime() - begin;
  lock.lock();
  if (!region) pool->usual = std::max(took, pool->usual * 4 / 5);
  longTasks -= isLong;
  expects(pool->inFlight > 0, "a task that ends was in flight");
  if (region && --region->helpers == 0) region->helpersGone.notify_one();
  --pool->inFlight;
  usage.set(--inFlight, currentTime());
  pool->noteChange();
  summon(*pool, takers);
}

void Executor::State::serve() {
  std::shared_ptr<Pool::Impl> last;
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
    std::shared_ptr<Pool::Impl> pool = take(false);
    workFor(pool, lock, last, 0);
    last = std::move(pool);
  }
}

void Executor::State::serveShortTasks() {
  std::shared_ptr<Pool::Impl> last;
  std::unique_lock lock(mutex);
  for (;;) {
    if (stop) return;
    if (std::shared_ptr<Pool::Impl> pool = take(true)) {
      workFor(pool, lock, last, 1);  // this thread may take no more: the long tasks may have ended
      last = std::move(pool);
    } else if (last) {
      lock.unlock();
      last.reset();
      lock.lock();
    } else {
      shortWork.wait(lock);
    }
  }
}

void Executor::State::serveAll() {
  std::shared_ptr<Pool::Impl> last;  // released without the lock
  std::unique_lock lock(mutex);
  while (!ready.empty()) {
    std::shared_ptr<Pool::Impl> pool = take(false);
    workFor(pool, lock, last, 0);
    last = std::move(pool);
  }
}

Executor::Executor(unsigned threads, const Executor* first, double share) : state_(std::make_shared<State>()) {
  const unsigned cores = std::max(1u, std::thread::hardware_concurrency());
  state_->threads = threads ? threads : cores;
  if (first) {
    expects(share > 0 && share <= 1, "an executor that gives way has a share of all cores");
    state_->first = first->state_;
    state_->courtesy = {&first->state_->working, std::max(0.0, state_->threads / (share * cores) - 1)};
  }
  if (state_->threads > 1) state_->workers.emplace_back([state = state_.get()] { state->serveShortTasks(); });
  for (unsigned k = 0; k < state_->threads; ++k) state_->workers.emplace_back([state = state_.get()] { state->serve(); });
}

Executor::Executor(WithoutThreads) : state_(std::make_shared<State>()) {}

void Executor::work() {
  expects(state_->workers.empty(), "an executor that is worked by hand has no threads");
  state_->serveAll();
}

Executor::~Executor() {
  {
    const std::lock_guard lock(state_->mutex);
    state_->stop = true;
    state_->work.notify_all();
    state_->shortWork.notify_all();
  }
  for (auto& worker : state_->workers) worker.join();
  std::vector<std::deque<std::function<void()>>> dropped;
  std::deque<std::shared_ptr<Pool::Impl>> released;
  {
    const std::lock_guard lock(state_->mutex);
    for (Pool::Impl* pool : state_->pools) dropped.push_back(std::exchange(pool->posted, {}));
    for (Pool::Row* row : std::exchange(state_->ready, {})) std::ranges::move(std::exchange(row->ready, {}), std::back_inserter(released));
  }
}

unsigned Executor::threads() const { return state_->threads; }

double Executor::usage() const {
  const std::lock_guard lock(state_->mutex);
  return std::min(1.0, state_->usage.mean(currentTime()) / state_->threads);
}

std::size_t Executor::queued() const {
  const std::lock_guard lock(state_->mutex);
  std::size_t sum = 0;
  for (const Pool::Impl* pool : state_->pools) sum += pool->posted.size();
  return sum;
}

std::shared_ptr<Pool> Executor::makePool(unsigned limit, const std::string& client) {
  auto impl = std::make_shared<Pool::Impl>();
  impl->executor = state_;
  impl->limit = std::min(limit ? limit : 4u, state_->threads);
  {
    const std::lock_guard lock(state_->mutex);
    state_->pools.insert(impl.get());
    if (!client.empty()) impl->row = state_->rows[client].lock();
    if (!impl->row) impl->row = std::make_shared<Pool::Row>(client);
    if (!client.empty()) state_->rows[client] = impl->row;
  }
  return std::shared_ptr<Pool>(new Pool(std::move(impl)));
}

Pool::Pool(std::shared_ptr<Impl> impl) : impl_(std::move(impl)) {}

Pool::~Pool() {
  std::deque<std::function<void()>> dropped;
  const std::lock_guard lock(impl_->executor->mutex);
  impl_->closed = true;
  dropped.swap(impl_->posted);
  // `dropped` was declared first, so it is destroyed after the lock is released.
}

bool Pool::post(std::function<void()> task) {
  expects(task != nullptr, "a task can be called");
  auto& executor = *impl_->executor;
  const std::lock_guard lock(executor.mutex);
  if (executor.stop || impl_->closed || impl_->posted.size() >= kMaxPosted) return false;
  impl_->posted.push_back(std::move(task));
  executor.summon(*impl_);
  return true;
}

void Pool::wakeOne() {
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
    executor->summon(*this, std::min<std::size_t>(helpersUseful, limit - std::min(limit, inFlight)));
  }
  {
    const WorkingFor mark(this);
    work();
  }
  // Whoever is still in its last task is worth a short look before sleeping. The lock below orders what it did before what follows.
  if (region.helpers.load(std::memory_order_relaxed) > 0) spinUntil([&] { return region.helpers.load(std::memory_order_relaxed) == 0; });
  std::unique_lock lock(executor->mutex);
  const auto own = std::find(regions.begin(), regions.end(), &region);
  expects(own != regions.end(), "a loop is one of its pool's until it has ended");
  regions.erase(own);
  region.helpersGone.wait(lock, [&] { return region.helpers == 0; });
  if (outside) {
    --inFlight;
    noteChange();
    executor->summon(*this);
  }
}

namespace {

void runInline(std::size_t count, const std::function<void(std::size_t)>& body) noexcept {
  for (std::size_t k = 0; k < count; ++k) body(k);
}

}  // namespace

void Pool::forEach(std::size_t count, std::size_t grain, const std::function<void(std::size_t)>& task) {
  Loop loop(task, impl_->executor->courtesy);
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

void Pool::forEachOrdered(const Order& order, const std::function<void(std::size_t)>& task) {
  Loop loop(task, impl_->executor->courtesy);
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
