#pragma once
// Repeats what a recording holds: makes every camera's meshes from the recorded inputs, as fast as the threads go, and compares each
// iteration's hash with the recorded one.
//
// A camera's mesh has state beyond its points: candidates, sleeping pages, resting vertices, the threshold that the budget has raised, the
// camera's travel. A mesh rebuilt from recorded points would continue differently, and the full state is tens of megabytes. So there is one
// kind of checkpoint, which costs nothing: where a camera joins, its mesh begins from nothing. To judge from a time on, a camera is
// repeated from its last join before that time. A camera whose join is in a deleted part cannot be repeated until it joins again; those
// iterations are counted as unknown.

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "server/recording/records.h"
#include "server/scheduling/pool.h"

namespace ridgecast::recording {

struct Span {
  double from = 0, until = std::numeric_limits<double>::infinity();  // seconds of the recording; iterations in between are judged
};

struct Difference {
  std::uint64_t camera = 0, iteration = 0;  // the iteration of its mesh, from 1
  double seconds = 0;                       // of the recording
  std::uint64_t recorded = 0, repeated = 0;
};

struct Summary {
  std::uint64_t cameras = 0;     // meshes that began
  std::uint64_t iterations = 0;  // judged
  std::uint64_t before = 0;      // repeated on the way to `from`
  std::uint64_t unknown = 0;     // of cameras whose beginning is not there
  std::uint64_t edits = 0, questions = 0;
  double seconds = 0;               // of the last record that was read
  std::optional<Difference> first;  // in the order of the recording
  std::string damage{};             // Records::damage()
  bool wasCutOff = false;
};

inline constexpr std::size_t kMaxQueued = 4096;

// `recordings` as of openRecords; `terrain` is theirs: checkTerrain. Ends at the first difference. Error: one sentence: a file cannot
// be read, or its content makes no sense. Memory: a mesh for each camera that lives, and at most kMaxQueued iterations that wait.
Outcome<Summary> replay(const std::vector<Parts>& recordings, std::shared_ptr<const terrain::Terrain> terrain,
                        scheduling::Executor& executor, const Span& span);

// Error: one sentence, if the terrain has another content than the recorded one.
Outcome<void> checkTerrain(const World& world, const terrain::Terrain& terrain);

}  // namespace ridgecast::recording
