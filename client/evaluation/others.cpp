#include "client/evaluation/others.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <string>

namespace ridgecast::evaluation {
namespace {

double secondsOf(int who) {
  rusage usage{};
  getrusage(who, &usage);
  const auto of = [](const timeval& t) { return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec); };
  return of(usage.ru_utime) + of(usage.ru_stime);
}

}  // namespace

Others::Others() : began_(now()) {}

std::optional<Others::Times> Others::now() {
  // cpu user nice system idle iowait irq softirq steal: see proc(5).
  std::ifstream in("/proc/stat");
  std::string name;
  double ticks[8] = {};
  in >> name;
  for (double& t : ticks) in >> t;
  if (!in || name != "cpu") return std::nullopt;
  Times out;
  for (const double t : ticks) out.all += t;
  out.busy = out.all - ticks[3] - ticks[4];
  const double perSecond = static_cast<double>(sysconf(_SC_CLK_TCK));
  out.all /= perSecond;
  out.busy /= perSecond;
  out.own = secondsOf(RUSAGE_SELF) + secondsOf(RUSAGE_CHILDREN);
  return out;
}

std::optional<double> Others::share() const {
  const auto ended = now();
  if (!began_ || !ended || ended->all <= began_->all) return std::nullopt;
  return std::clamp(((ended->busy - began_->busy) - (ended->own - began_->own)) / (ended->all - began_->all), 0.0, 1.0);
}

}  // namespace ridgecast::evaluation
