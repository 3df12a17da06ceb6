// Heights in batches against scalar double, same functions, same points, same run, one thread.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <random>

#include "common/process/scratch.h"
#include "common/terrain/variants.h"
#include "common/user_terrain/catalogue.h"
#include "tests/bench/bench.h"
#include "tests/bench/heights_double.h"

namespace ridgecast::bench {
namespace {

constexpr std::size_t kPoints = 4096;

struct Points {
  std::vector<lattice::Step> x, z;
};

Points points() {
  std::mt19937_64 random(1);
  Points p;
  for (std::size_t i = 0; i < kPoints; ++i) {
    p.x.push_back(static_cast<lattice::Step>(random() >> 40) + (lattice::Step{1} << 34));
    p.z.push_back(static_cast<lattice::Step>(random() >> 40) - (lattice::Step{1} << 34));
  }
  return p;
}

template <class Evaluate>
double nanoseconds(const Evaluate& evaluate) {
  Clock clock;
  evaluate();
  return clock.seconds() * 1e9 / static_cast<double>(kPoints);
}

}  // namespace

Report heights(const Options& options) {
  const Points p = points();
  std::vector<float> out(kPoints);
  std::vector<double> outDouble(kPoints);
  const auto batch = [&](const terrain::Functions& f) { f.heights(p.x.data(), p.z.data(), out.data(), kPoints, 1, nullptr); };

  Report report;
  auto scratch = process::Scratch::create();
  user_terrain::Request request;
  request.terrain = RIDGECAST_TUTORIAL;
  request.build.prober = "/proc/self/exe";
  if (scratch) request.build.cache = scratch->path() / "cache";
  const auto user = user_terrain::load(request, nullptr);
  if (!user) report.note("no figures for a person's own file: " + user.error().message);

  // In turns, so that whatever else the machine does falls on all alike.
  const std::size_t variants = terrain::variants().size();
  std::vector<double> alpineDouble, tutorialDouble, tutorial;
  std::vector<std::vector<double>> alpine(variants);
  for (int round = 0; round < (options.quick ? 9 : 101); ++round) {
    alpineDouble.push_back(nanoseconds([&] { alpineInDouble(p.x.data(), p.z.data(), outDouble.data(), kPoints, 1); }));
    for (std::size_t v = 0; v < variants; ++v) alpine[v].push_back(nanoseconds([&] { batch(terrain::variants()[v].terrain[0]); }));
    if (!user) continue;
    tutorialDouble.push_back(nanoseconds([&] { tutorialInDouble(p.x.data(), p.z.data(), outDouble.data(), kPoints, 1); }));
    tutorial.push_back(nanoseconds([&] { (*user)->heights(p.x, p.z, out); }));
  }

  report.note("alpine and common/terrain/tutorial/dunes.glsl at " + std::to_string(kPoints) +
              " random points, one thread, medians; the file of one's own as the server loads it, compiled for " +
              std::string(terrain::variants().back().name));
  report.note("scalar double: the same GLSL and loop, inlined, double for float, g++ -O3 without vector code");
  report.add("double_ns", median(alpineDouble), "ns a height");
  for (std::size_t v = 0; v < variants; ++v) {
    const std::string name(terrain::variants()[v].name);
    report.add(name + "_ns", median(alpine[v]), "ns a height");
  }
  for (const std::string name : {"avx2", "avx512"}) {
    double ratio = NAN;
    for (std::size_t v = 0; v < variants; ++v)
      if (terrain::variants()[v].name == name) ratio = median(alpineDouble) / median(alpine[v]);
    report.add(name + "_ratio", ratio, "x scalar double");
  }
  report.add("user_file_double_ns", user ? median(tutorialDouble) : NAN, "ns a height");
  report.add("user_file_ns", user ? median(tutorial) : NAN, "ns a height");
  report.add("user_file_ratio", user ? median(tutorialDouble) / median(tutorial) : NAN, "x scalar double");
  return report;
}

}  // namespace ridgecast::bench
