#pragma once
// Figures that a Prometheus scrapes: counters, gauges and histograms, and their text (exposition format 0.0.4).
//
// Figures are made once, at the start; changing them takes no lock and may be done by any thread. A figure lives as long as its registry.

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace ridgecast::metrics {

class Counter {
 public:
  void add(std::uint64_t n = 1) { value_.fetch_add(n, std::memory_order_relaxed); }
  std::uint64_t value() const { return value_.load(std::memory_order_relaxed); }

 private:
  std::atomic<std::uint64_t> value_{0};
};

class Gauge {
 public:
  void add(std::int64_t n) { value_.fetch_add(n, std::memory_order_relaxed); }
  void set(std::int64_t n) { value_.store(n, std::memory_order_relaxed); }
  std::int64_t value() const { return value_.load(std::memory_order_relaxed); }

 private:
  std::atomic<std::int64_t> value_{0};
};

// Counts of values up to each of a few bounds, with their sum.
class Histogram {
 public:
  explicit Histogram(std::vector<double> bounds);  // ascending
  void observe(double value);

 private:
  friend class Registry;
  const std::vector<double> bounds_;
  std::deque<std::atomic<std::uint64_t>> counts_;  // one more than bounds
  std::atomic<double> sum_{0};
};

using Labels = std::vector<std::pair<std::string, std::string>>;

// Figures of one name must be made one after another; they share its help.
class Registry {
 public:
  Counter& counter(std::string name, std::string help, Labels labels = {});
  Gauge& gauge(std::string name, std::string help, Labels labels = {});
  Histogram& histogram(std::string name, std::string help, std::vector<double> bounds, Labels labels = {});
  // A value that is asked for when it is scraped, by whatever thread scrapes.
  void ask(std::string name, std::string help, std::function<double()> value, Labels labels = {}, bool counts = false);

  std::string text() const;

 private:
  struct Figure {
    std::string name, help, type, labels;  // labels as text, without braces
    std::function<void(const Figure&, std::string&)> write;
  };
  void add(std::string name, std::string help, std::string type, const Labels& labels,
           std::function<void(const Figure&, std::string&)> write);

  mutable std::mutex mutex_;
  std::deque<Figure> figures_;
  std::deque<Counter> counters_;
  std::deque<Gauge> gauges_;
  std::deque<Histogram> histograms_;
};

}  // namespace ridgecast::metrics
