// What cameras on different cores take from each other: processor time of an iteration alone, beside another camera, and beside a thread
// that reads memory as fast as it can; and what the executor's own work costs, which is all that happens under its lock. README.md reckons
// from these what many cores would do.
#include <algorithm>
#include <atomic>
#include <ctime>
#include <future>
#include <memory>
#include <numeric>
#include <thread>
#include <vector>

#include "server/pipeline/pipeline.h"
#include "tests/bench/bench.h"
#include "tests/bench/usage.h"
#include "tests/support/flight.h"

namespace ridgecast::bench {
namespace {

double threadSeconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

constexpr int kTogether = 50;  // iterations

// As a server's: its work is a task of a pool of its own.
class FlyingCamera {
 public:
  FlyingCamera(scheduling::Executor& executor, std::uint64_t seed)
      : terrain_(terrain::create("alpine", seed).value()), pool_(executor.makePool(1)) {
    settings::Settings asked;
    asked.threshold = 0.6;
    asked.triangleBudget = 100'000;
    pipeline_ = std::make_unique<pipeline::Pipeline>(terrain_, pipeline::grant(asked, {}), pool_);
    for (int n = 0; n < 300 && !pipeline_->settled(); ++n) pipeline_->iterate(testing_support::straight(*terrain_, 0));
  }
  // Seconds of processor time of a turn.
  std::future<double> fly() {
    auto done = std::make_shared<std::promise<double>>();
    pool_->post([this, done] {
      const double began = threadSeconds();
      for (int n = 0; n < kTogether; ++n) pipeline_->iterate(testing_support::straight(*terrain_, 0.1 * ++frame_));
      done->set_value(threadSeconds() - began);
    });
    return done->get_future();
  }

 private:
  std::shared_ptr<const terrain::Terrain> terrain_;
  std::shared_ptr<scheduling::Pool> pool_;
  std::unique_ptr<pipeline::Pipeline> pipeline_;
  int frame_ = 0;
};

// Reads more than any cache holds, until it is told to stop.
class Reader {
 public:
  // Bytes a second of processor time while `work` runs.
  template <class Work>
  double during(const Work& work) {
    std::atomic<bool> stop{false};
    double rate = 0;
    std::thread thread([&] {
      const double began = threadSeconds();
      double bytes = 0;
      do {
        sum_ = std::accumulate(memory_.begin(), memory_.end(), sum_);
        bytes += static_cast<double>(memory_.size() * sizeof(memory_[0]));
      } while (!stop);
      rate = bytes / (threadSeconds() - began);
    });
    work();
    stop = true;
    thread.join();
    return rate;
  }

 private:
  std::vector<std::uint64_t> memory_ = std::vector<std::uint64_t>(32 << 20, 1);
  std::uint64_t sum_ = 0;
};

// Seconds of processor time that an executor of one thread takes for a task that does nothing.
double emptyTask() {
  scheduling::Executor executor(1);
  const auto pool = executor.makePool(1);
  constexpr int kTasks = 20'000;
  const double began = cpuSeconds();
  for (int n = 0; n < kTasks; n += 500) {
    std::promise<void> done;
    for (int k = 1; k < 500; ++k) pool->post([] {});
    pool->post([&] { done.set_value(); });
    done.get_future().wait();
  }
  return (cpuSeconds() - began) / kTasks;
}

}  // namespace

Report contention(const Options& options) {
  scheduling::Executor executor(2);
  FlyingCamera one(executor, 1), other(executor, 2);
  Reader reader;
  std::vector<double> alone, pair, beside, free, shared, empty;
  for (int turn = 0; turn < (options.quick ? 3 : 15); ++turn) {
    alone.push_back((one.fly().get() + other.fly().get()) / (2 * kTogether));
    auto first = one.fly(), second = other.fly();
    pair.push_back((first.get() + second.get()) / (2 * kTogether));
    shared.push_back(reader.during([&] { beside.push_back((one.fly().get() + other.fly().get()) / (2 * kTogether)); }));
    free.push_back(reader.during([] {}));
    empty.push_back(emptyTask());
  }
  Report report;
  report.note("alpine, 50 m/s, threshold 0.6 px, 100,000 triangles; medians of turns of 50 iterations; processor time");
  report.add("alone_us", 1e6 * median(alone), "us an iteration, nothing else of this program running");
  report.add("pair_us", 1e6 * median(pair), "us, another camera on the other core");
  report.add("beside_reader_us", 1e6 * median(beside), "us, beside a thread that reads memory");
  report.add("reader_gb_s", 1e-9 * median(free), "GB a second of processor time, the reader alone");
  report.add("reader_beside_gb_s", 1e-9 * median(shared), "GB, beside a camera");
  report.add("task_us", 1e6 * median(empty), "us of an empty task: an iteration's share of the executor, most of it under the lock");
  return report;
}

}  // namespace ridgecast::bench
