#pragma once
// Figures that a Prometheus scrapes, by prometheus-cpp, and their text (exposition format 0.0.4).
//
// Figures are made once, at the start; any thread may change them. A figure lives as long as its registry.

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>

#include <functional>
#include <mutex>
#include <string>
#include <vector>

namespace ridgecast::metrics {

using prometheus::Counter, prometheus::Gauge, prometheus::Histogram, prometheus::Labels;

class Registry {
 public:
  Counter& counter(const std::string& name, const std::string& help, const Labels& labels = {});
  Gauge& gauge(const std::string& name, const std::string& help, const Labels& labels = {});
  // `bounds` ascend.
  Histogram& histogram(const std::string& name, const std::string& help, const std::vector<double>& bounds, const Labels& labels = {});
  // A value that is asked for when it is scraped, by whatever thread scrapes. Values of one name must be added one after another.
  void ask(const std::string& name, const std::string& help, std::function<double()> value, const Labels& labels = {}, bool counts = false);

  std::string text() const;

 private:
  struct Asked {
    std::string name, help;
    std::vector<prometheus::ClientMetric::Label> labels;
    bool counts;
    std::function<double()> value;
  };
  prometheus::Registry registry_;
  mutable std::mutex mutex_;
  std::vector<Asked> asked_;
};

}  // namespace ridgecast::metrics
