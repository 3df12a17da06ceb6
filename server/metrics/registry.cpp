#include "server/metrics/registry.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdio>

namespace ridgecast::metrics {

namespace {

std::string number(double value) {
  if (std::isnan(value)) return "NaN";
  if (std::isinf(value)) return value > 0 ? "+Inf" : "-Inf";
  char text[32];
  std::snprintf(text, sizeof text, value == std::floor(value) && std::abs(value) < 1e15 ? "%.0f" : "%.15g", value);
  return text;
}

std::string escaped(std::string_view value) {
  std::string out;
  for (const char c : value) {
    if (c == '\\' || c == '"') out += '\\';
    if (c == '\n')
      out += "\\n";
    else
      out += c;
  }
  return out;
}

void line(std::string& out, std::string_view name, std::string_view labels, std::string_view more, std::string_view value) {
  out += name;
  if (!labels.empty() || !more.empty()) {
    out += '{';
    out += labels;
    if (!labels.empty() && !more.empty()) out += ',';
    out += more;
    out += '}';
  }
  out += ' ';
  out += value;
  out += '\n';
}

}  // namespace

Histogram::Histogram(std::vector<double> bounds) : bounds_(std::move(bounds)), counts_(bounds_.size() + 1) {
  assert(std::is_sorted(bounds_.begin(), bounds_.end()));
}

void Histogram::observe(double value) {
  const auto bucket = static_cast<std::size_t>(std::lower_bound(bounds_.begin(), bounds_.end(), value) - bounds_.begin());
  counts_[bucket].fetch_add(1, std::memory_order_relaxed);
  double sum = sum_.load(std::memory_order_relaxed);
  while (!sum_.compare_exchange_weak(sum, sum + value, std::memory_order_relaxed)) {
  }
}

void Registry::add(std::string name, std::string help, std::string type, const Labels& labels,
                   std::function<void(const Figure&, std::string&)> write) {
  std::string text;
  for (const auto& [key, value] : labels) text += (text.empty() ? "" : ",") + key + "=\"" + escaped(value) + '"';
  figures_.push_back({std::move(name), std::move(help), std::move(type), std::move(text), std::move(write)});
}

Counter& Registry::counter(std::string name, std::string help, Labels labels) {
  const std::lock_guard lock(mutex_);
  Counter& made = counters_.emplace_back();
  add(std::move(name), std::move(help), "counter", labels,
      [&made](const Figure& f, std::string& out) { line(out, f.name, f.labels, {}, std::to_string(made.value())); });
  return made;
}

Gauge& Registry::gauge(std::string name, std::string help, Labels labels) {
  const std::lock_guard lock(mutex_);
  Gauge& made = gauges_.emplace_back();
  add(std::move(name), std::move(help), "gauge", labels,
      [&made](const Figure& f, std::string& out) { line(out, f.name, f.labels, {}, std::to_string(made.value())); });
  return made;
}

Histogram& Registry::histogram(std::string name, std::string help, std::vector<double> bounds, Labels labels) {
  const std::lock_guard lock(mutex_);
  Histogram& made = histograms_.emplace_back(std::move(bounds));
  add(std::move(name), std::move(help), "histogram", labels, [&made](const Figure& f, std::string& out) {
    std::uint64_t total = 0;
    for (std::size_t k = 0; k <= made.bounds_.size(); ++k) {
      total += made.counts_[k].load(std::memory_order_relaxed);
      const std::string bound = k < made.bounds_.size() ? number(made.bounds_[k]) : "+Inf";
      line(out, f.name + "_bucket", f.labels, "le=\"" + bound + '"', std::to_string(total));
    }
    line(out, f.name + "_sum", f.labels, {}, number(made.sum_.load(std::memory_order_relaxed)));
    line(out, f.name + "_count", f.labels, {}, std::to_string(total));
  });
  return made;
}

void Registry::ask(std::string name, std::string help, std::function<double()> value, Labels labels, bool counts) {
  const std::lock_guard lock(mutex_);
  add(std::move(name), std::move(help), counts ? "counter" : "gauge", labels,
      [value = std::move(value)](const Figure& f, std::string& out) { line(out, f.name, f.labels, {}, number(value())); });
}

std::string Registry::text() const {
  const std::lock_guard lock(mutex_);
  std::string out;
  std::string_view last;
  for (const Figure& figure : figures_) {
    if (figure.name != last) {
      out += "# HELP " + figure.name + " " + figure.help + "\n# TYPE " + figure.name + " " + figure.type + "\n";
      last = figure.name;
    }
    figure.write(figure, out);
  }
  return out;
}

}  // namespace ridgecast::metrics
