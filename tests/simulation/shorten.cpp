#include "tests/simulation/shorten.h"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <regex>

#include "tests/support/process.h"

namespace ridgecast::simulation {
namespace {

using namespace std::chrono_literals;

// A run that fails, by its first failure; empty: none.
struct Run {
  std::string place, words;
};

Run runOf(std::uint64_t seed, const Events& events, const std::filesystem::path& file) {
  std::ofstream(file) << toText(events);
  const auto [code, output] =
      testing_support::runProgram({"/proc/self/exe"}, {{"SEED", std::to_string(seed)}, {"EVENTS", file.string()}, {"SHORTEN", "0"}}, 60s);
  if (!code) return {"hangs", "It does not end."};
  if (*code == 0) return {};
  std::smatch found;
  static const std::regex kFailure("([^/\\s]+:\\d+): Failure\n([^]*?)\nGoogle Test trace");
  if (std::regex_search(output, found, kFailure)) return {found[1], found[1].str() + ": " + found[2].str()};
  return {"exit code " + std::to_string(*code), output.substr(output.size() - std::min<std::size_t>(output.size(), 500))};
}

}  // namespace

std::string shorten(std::uint64_t seed, Events events) {
  const testing_support::ScratchFolder folder;
  const std::size_t all = events.size();
  const Run first = runOf(seed, events, folder / "events");
  const std::string name = "SEED=" + std::to_string(seed);
  if (first.place.empty()) return name + " does not fail in a process of its own, so its events cannot be shortened.\n";
  int runs = 0;
  const auto end = std::chrono::steady_clock::now() + 150s;
  bool again = true;
  for (std::size_t size = std::max<std::size_t>(events.size() / 2, 1); again; size = std::max<std::size_t>(size / 2, 1)) {
    again = size > 1;
    for (std::size_t last = events.size();
         last > 0 && std::chrono::steady_clock::now() < end;) {  // from the end on: what follows goes first
      const std::size_t begin = last - std::min(last, size);
      Events fewer = events;
      fewer.erase(fewer.begin() + static_cast<std::ptrdiff_t>(begin), fewer.begin() + static_cast<std::ptrdiff_t>(last));
      ++runs;
      if (runOf(seed, fewer, folder / "events").place == first.place) {
        events = std::move(fewer);
        again = true;  // others may have become needless
      }
      last = begin;
    }
    if (std::chrono::steady_clock::now() >= end) break;
  }
  const std::string file = "simulation-" + std::to_string(seed) + ".events", text = toText(events);
  std::ofstream(file) << text;
  return name + " fails at " + first.words + "\n\n" + std::to_string(events.size()) + " of its " + std::to_string(all) +
         " events are enough, after " + std::to_string(runs) + " runs (kind, who, amount, pause, dice):\n" + text + "Repeat it: " + name +
         " EVENTS=" + std::filesystem::absolute(file).string() + " " + std::filesystem::read_symlink("/proc/self/exe").string() + "\n";
}

}  // namespace ridgecast::simulation
