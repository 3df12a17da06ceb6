#pragma once
// What a bench is: a name, a line for people, and a function that measures and returns named figures.

#include <chrono>
#include <functional>
#include <string>
#include <vector>

namespace ridgecast::bench {

struct Figure {
  std::string name;  // as in --json
  double value;
  std::string unit;  // for people
};

struct Report {
  std::vector<Figure> figures;
  std::vector<std::string> notes;  // for people: baseline, flags, input
  void add(std::string name, double value, std::string unit = "") { figures.push_back({std::move(name), value, std::move(unit)}); }
  void note(std::string text) { notes.push_back(std::move(text)); }
};

struct Options {
  bool quick = false;                  // a shorter run, for tests
  std::string programFolder;           // where this program lies; its companions lie beside it
  std::vector<std::string> arguments;  // of this bench, after its name
};

// A line that says how far a long bench is; on stderr, so that --json stays clean.
void progress(const std::string& text);

class Clock {
 public:
  double seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

double median(std::vector<double> values);
// The value that this share of them lies below, for 1 the largest. NaN of none.
double percentile(std::vector<double> values, double share);

// The benches, each in the file of its name.
Report delaunay(const Options&);
Report iteration(const Options&);
Report threads(const Options&);
Report contention(const Options&);
Report box(const Options&);
Report error(const Options&);
Report soak(const Options&);
Report heights(const Options&);
Report deltas(const Options&);
Report cameras(const Options&);
Report presence(const Options&);
Report edits(const Options&);
Report doors(const Options&);
Report resume(const Options&);
Report bus(const Options&);
Report rays(const Options&);

}  // namespace ridgecast::bench
