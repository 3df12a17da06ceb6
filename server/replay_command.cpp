#include "server/replay_command.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/text/text.h"
#include "common/user_terrain/catalogue.h"
#include "server/config/config.h"
#include "server/logging/logging.h"
#include "server/playback/playback.h"
#include "server/recording/paths.h"
#include "server/recording/reader.h"
#include "server/recording/records.h"
#include "server/recording/replay.h"
#include "server/scheduling/pool.h"

namespace ridgecast {
namespace {

using recording::Parts;
using Recordings = std::vector<Parts>;  // of one session

constexpr const char* kHelp = R"(Usage: ridgecast-server replay FILE|DIR... [OPTIONS] [SETTINGS]

Repeats what ridgecast-server --record DIR recorded: makes every camera's meshes again from their inputs, and compares each with the
recorded one by its hash.

  FILE           a part, NAME.0001.recording, and those after it
  DIR            all recordings in it
  several        One recording each: those that several servers made of one session, which is repeated as one. Its edits and its clock are
                 the same in all
  --from TIME    Compare from this time, in seconds of the recording. A mesh has a history, so each camera that is still there at that
                 time is repeated from where it joined
  --until TIME   End there
  --export DIR   Instead, write each camera's flight as a path for ridgecast-client fly --path
  --serve        Instead, play one session in real time to onlookers who join the default session: its members fly and the ground
                 changes as recorded. The session's clock (V in window and page) pauses it, changes its speed and goes to any time;
                 --from says where it begins. It is one server's, whatever the environment says of --shared
  --threads N    Threads; 0, the default: one for each core. They change nothing but the time it takes
  SETTINGS       Those of ridgecast-server that name the terrain, such as --terrain dem.tif, if the recorded name does not suffice; with
                 --serve all, such as --port

Exit status: 0 if all meshes are equal; 1 if one differs, or after a failure; 2 after bad input.
)";

struct Options {
  recording::Span span;
  std::filesystem::path paths;  // --export; empty: none
  bool serves = false;
};

int refuse(int status, const std::string& sentence) {
  std::cerr << "ridgecast-server replay: " << sentence << "\n";
  return status;
}

std::string count(std::uint64_t n, const char* one) { return std::to_string(n) + " " + one + (n == 1 ? "" : "s"); }

// The settings' terrain if they name one, otherwise the recorded one; with the recorded seed and parameters.
void nameTerrain(const recording::World& world, user_terrain::Request& request) {
  if (request.terrain == user_terrain::Request().terrain) request.terrain = world.terrain;
  request.seed = world.seed;
  request.parameters = world.parameters;
  request.build.colours = world.colours;
}

// Error: there is no such terrain, or it is not the recorded one.
Outcome<std::shared_ptr<const terrain::Terrain>> terrainOf(const recording::World& world, user_terrain::Request request) {
  nameTerrain(world, request);
  auto terrain = user_terrain::load(request, [](const std::string& complaint) { std::cerr << complaint << "\n"; });
  if (!terrain) return terrain.error();
  if (auto same = recording::checkTerrain(world, **terrain); !same) return same.error();
  return terrain;
}

void tellCutOff(const Recordings& recordings) {
  std::cerr << recordings.back().back().string() << (recordings.size() > 1 ? ", or another" : "")
            << ": its last block was not written in whole; it ends before that.\n";
}

int exportAll(const std::vector<Recordings>& sessions, const Options& options) {
  std::size_t files = 0;
  int status = 0;
  for (const Recordings& recordings : sessions) {
    const auto written = recording::exportPaths(recordings, options.paths, options.span);
    if (!written) return refuse(1, written.error().message);
    files += written->files;
    if (written->wasCutOff) tellCutOff(recordings);
    if (!written->damage.empty()) status = refuse(1, written->damage);
  }
  std::cout << count(files, "path") << " in " << options.paths.string() << "\n";
  return status;
}

int play(const std::vector<Recordings>& sessions, config::Config config, const Options& options, const Serve& serve) {
  if (sessions.size() != 1)
    return refuse(2, "There are " + count(sessions.size(), "recording") + "; --serve takes one: name its first part.");
  auto reader = recording::openRecords(sessions[0]);
  if (!reader) return refuse(2, reader.error().message);
  const recording::World& world = (*reader)->world();
  if (auto terrain = terrainOf(world, config.terrain); !terrain) return refuse(2, terrain.error().message);
  nameTerrain(world, config.terrain);
  config.limits.maxSessions = 1;
  config.limits.takesEdits = false;
  config.state.clear();
  config.record.clear();
  config.shared = {};  // of the environment or the settings file, as the others
  config.watch = false;
  return serve(config, [&](directory::Directory& directory) -> Outcome<StartServing> {
    auto begun = playback::Playback::begin(sessions[0], directory, directory.find(directory::kDefaultName), options.span.from);
    if (!begun) return begun.error();
    return StartServing([playback = std::shared_ptr(std::move(*begun))](const auto& sendAway) { playback->start(sendAway); });
  });
}

// Adds to `all`. The exit status.
int repeat(const Recordings& recordings, const config::Config& config, const Options& options, scheduling::Executor& executor,
           recording::Summary& all) {
  auto reader = recording::openRecords(recordings);
  if (!reader) return refuse(2, reader.error().message);
  const std::string first = recordings.front().front().string();
  const std::string session = (*reader)->world().session;
  auto terrain = terrainOf((*reader)->world(), config.terrain);
  if (!terrain) return refuse(2, terrain.error().message);
  reader->reset();
  const auto summary = recording::replay(recordings, std::move(*terrain), executor, options.span);
  if (!summary) return refuse(1, first + ": " + summary.error().message);
  if (summary->wasCutOff) tellCutOff(recordings);
  if (summary->unknown > 0)
    std::cerr << first << ": " << count(summary->unknown, "iteration")
              << " of cameras that joined in an earlier part cannot be repeated.\n";
  all.cameras += summary->cameras;
  all.iterations += summary->iterations;
  all.before += summary->before;
  all.edits += summary->edits;
  all.questions += summary->questions;
  all.seconds += std::max(0.0, summary->seconds - options.span.from);
  if (const auto& difference = summary->first) {
    std::cout << "Session " << session << ", camera " << difference->camera << ", iteration " << difference->iteration << " at "
              << text::rounded(difference->seconds, 9) << " s differs: the recorded hash is " << text::hexadecimal(difference->recorded)
              << ", the repeated one " << text::hexadecimal(difference->repeated) << ".\n";
    return 1;
  }
  return summary->damage.empty() ? 0 : refuse(1, summary->damage);
}

int repeatAll(const std::vector<Recordings>& sessions, const config::Config& config, const Options& options) {
  scheduling::Executor executor(config.threads);
  recording::Summary all;
  const auto start = std::chrono::steady_clock::now();
  for (const Recordings& recordings : sessions)
    if (const int status = repeat(recordings, config, options, executor, all)) return status;
  const double took = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  std::cout << count(sessions.size(), "session") << ", " << count(all.cameras, "camera") << ", " << count(all.iterations, "iteration")
            << ", all equal; " << count(all.edits, "edit") << ", " << count(all.questions, "question") << "; ";
  if (all.before > 0) std::cout << count(all.before, "iteration") << " repeated before that; ";
  std::cout << text::rounded(all.seconds, 4) << " s in " << text::rounded(took, 3) << " s, " << text::rounded(all.seconds / took, 3)
            << " times real time\n";
  return 0;
}

// Takes `name` and its value, if any, out of the arguments. Error: there is no value.
Outcome<std::optional<std::string>> take(std::vector<const char*>& arguments, std::string_view name) {
  const auto at = std::ranges::find(arguments, name);
  if (at == arguments.end()) return std::optional<std::string>();
  if (at + 1 == arguments.end()) return Error{std::string(name) + " takes a value; see --help."};
  const std::string value = *(at + 1);
  arguments.erase(at, at + 2);
  return std::optional(value);
}

// Takes this command's own options out of the arguments.
Outcome<Options> takeOptions(std::vector<const char*>& arguments) {
  Options options;
  for (const auto& [name, time] : {std::pair{"--from", &options.span.from}, {"--until", &options.span.until}}) {
    const auto value = take(arguments, name);
    if (!value) return value.error();
    if (!*value) continue;
    const auto seconds = text::number<double>(**value);
    if (!seconds || *seconds < 0) return Error{std::string(name) + " takes a time in seconds, such as 12.5."};
    *time = *seconds;
  }
  const auto folder = take(arguments, "--export");
  if (!folder) return folder.error();
  options.paths = folder->value_or("");
  options.serves = std::erase_if(arguments, [](std::string_view a) { return a == "--serve"; }) > 0;
  if (options.serves && (folder->has_value() || std::isfinite(options.span.until)))
    return Error{"--serve takes neither --until nor --export; see --help."};
  if (options.serves && std::any_of(arguments.begin(), arguments.end(), [](std::string_view a) { return a.starts_with("--shared"); }))
    return Error{"--serve plays a recording on one server, whose clock is the recording's; leave out --shared."};
  return options;
}

// What the arguments name. Several: one recording each, of one session.
Outcome<std::vector<Recordings>> sessionsAt(const std::vector<const char*>& paths) {
  std::vector<Recordings> sessions;
  Recordings merged;
  for (const char* path : paths) {
    auto found = recording::recordingsAt(path);
    if (!found) return found.error();
    if (paths.size() == 1)
      for (Parts& parts : *found) sessions.push_back({std::move(parts)});
    else if (found->size() > 1)
      return Error{"There are " + count(found->size(), "recording") + " in '" + path +
                   "': of several servers' recordings of one session, name the first part of each."};
    else
      merged.push_back(std::move(found->front()));
  }
  if (!merged.empty()) sessions.push_back(std::move(merged));
  return sessions;
}

}  // namespace

int runReplayCommand(int argc, const char* const* argv, const char* const* environment, const Serve& serve) {
  if (std::any_of(argv, argv + argc, [](std::string_view a) { return a == "--help" || a == "-h"; }))
    return std::cout << kHelp << std::flush ? 0 : 1;
  if (argc < 2 || std::string_view(argv[1]).starts_with("-"))
    return refuse(2, "Say which recording: ridgecast-server replay FILE or DIR; see --help.");
  const char* const* const firstOption = std::find_if(argv + 1, argv + argc, [](std::string_view a) { return a.starts_with("-"); });
  std::vector<const char*> settings{argv[0]};
  settings.insert(settings.end(), firstOption, argv + argc);
  const auto options = takeOptions(settings);
  if (!options) return refuse(2, options.error().message);
  const config::Parsed parsed = config::parse(static_cast<int>(settings.size()), settings.data(), environment);
  if (!parsed.config) return parsed.status;
  const auto sessions = sessionsAt({argv + 1, firstOption});
  if (!sessions) return refuse(2, sessions.error().message);
  if (options->serves) return play(*sessions, *parsed.config, *options, serve);
  logging::setUp(parsed.config->logFormat, logging::Level::kWarning);
  return options->paths.empty() ? repeatAll(*sessions, *parsed.config, *options) : exportAll(*sessions, *options);
}

}  // namespace ridgecast
