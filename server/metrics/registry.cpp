#include "server/metrics/registry.h"

#include <prometheus/text_serializer.h>

namespace ridgecast::metrics {

Counter& Registry::counter(const std::string& name, const std::string& help, const Labels& labels) {
  return prometheus::BuildCounter().Name(name).Help(help).Register(registry_).Add(labels);
}

Gauge& Registry::gauge(const std::string& name, const std::string& help, const Labels& labels) {
  return prometheus::BuildGauge().Name(name).Help(help).Register(registry_).Add(labels);
}

Histogram& Registry::histogram(const std::string& name, const std::string& help, const std::vector<double>& bounds, const Labels& labels) {
  return prometheus::BuildHistogram().Name(name).Help(help).Register(registry_).Add(labels, bounds);
}

void Registry::ask(const std::string& name, const std::string& help, std::function<double()> value, const Labels& labels, bool counts) {
  Asked asked{name, help, {}, counts, std::move(value)};
  for (const auto& [key, text] : labels) asked.labels.push_back({key, text});
  const std::lock_guard lock(mutex_);
  asked_.push_back(std::move(asked));
}

std::string Registry::text() const {
  auto families = registry_.Collect();
  const std::lock_guard lock(mutex_);
  for (const Asked& asked : asked_) {
    if (families.empty() || families.back().name != asked.name)
      families.push_back({asked.name, asked.help, asked.counts ? prometheus::MetricType::Counter : prometheus::MetricType::Gauge, {}});
    auto& metric = families.back().metric.emplace_back();
    metric.label = asked.labels;
    (asked.counts ? metric.counter.value : metric.gauge.value) = asked.value();
  }
  return prometheus::TextSerializer().Serialize(families);
}

}  // namespace ridgecast::metrics
