#include "server/snapshot_command.h"

#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <future>
#include <iostream>
#include <string>
#include <string_view>
#include <vector>

#include "server/config/config.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"
#include "server/snapshot/snapshot.h"
#include "server/terrain/catalogue.h"

namespace ridgecast {
namespace {

using Result = snapshot::Result<snapshot::Snapshot>;

int refuse(int status, const std::string& sentence) {
  std::cerr << "ridgecast-server snapshot: " << sentence << "\n";
  return status;
}

// Waits for the result and tells meanwhile what is done.
Result follow(std::future<Result> result, const snapshot::Progress& progress) {
  const auto start = std::chrono::steady_clock::now();
  const bool terminal = isatty(STDERR_FILENO);
  std::string told;
  while (result.wait_for(std::chrono::milliseconds(terminal ? 250 : 100)) != std::future_status::ready) {
    const std::string text = progress.text(), stage = text.substr(0, text.rfind(','));
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    if (terminal)
      std::fprintf(stderr, "\r%.0f s: %-60s", seconds, text.c_str());
    else if (stage != told)
      std::fprintf(stderr, "After %.1f s: %s\n", seconds, text.c_str());
    told = stage;
  }
  if (terminal && !told.empty()) std::fprintf(stderr, "\n");
  return result.get();
}

// Whole or not at all.
bool write(const std::filesystem::path& file, std::string_view bytes) {
  const std::filesystem::path unfinished = file.string() + ".new";
  {
    std::ofstream out(unfinished, std::ios::binary);
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    if (!out.flush()) return false;
  }
  std::error_code failed;
  std::filesystem::rename(unfinished, file, failed);
  return !failed;
}

int take(const config::Config& config, const std::filesystem::path& file, const std::string& query) {
  const bool metadataOnly = file.extension() == ".json";
  const auto format = metadataOnly ? snapshot::Format::kGlb : snapshot::formatOf(file.string());
  if (!format) return refuse(2, "'" + file.string() + "' must end in .glb, .ply, .obj or .json.");
  auto terrain = user_terrain::load(config.terrain, [](const std::string& complaint) { std::cerr << complaint << "\n"; });
  if (!terrain) return refuse(2, terrain.error().message);
  snapshot::Limits limits = config.snapshots;
  limits.seconds = 86'400;
  limits.boxSide = 1e6;
  auto question = snapshot::parse(query, limits, (*terrain)->raster(), *format);
  if (!question) return refuse(2, question.error().message);

  scheduling::Executor executor(1);  // of cameras, of which there are none
  auto resources = std::make_shared<session::Resources>();
  resources->executor = &executor;
  resources->makeMesh = session::pipelineMeshes();
  resources->limits = config.limits;
  const auto directory = std::make_shared<session::Directory>(resources, *terrain, config.terrain.parameters);
  const auto session = directory->find(session::kDefaultName);
  snapshot::Snapshots snapshots(limits, config.threads ? config.threads : std::max(1u, std::thread::hardware_concurrency()));
  snapshot::Progress progress;
  const auto made = follow(
      std::async(std::launch::async, [&] { return snapshots.take(*session, *question, metadataOnly, std::stop_token(), &progress); }),
      progress);
  if (!made) return refuse(1, made.error().message);
  const std::string& bytes = metadataOnly ? made->metadata : made->file;
  if (!write(file, bytes)) return refuse(1, "Cannot write '" + file.string() + "'.");
  std::cout << file.string() << ": " << bytes.size() << " bytes\n";
  return 0;
}

}  // namespace

int runSnapshotCommand(int argc, const char* const* argv, const char* const* environment) {
  if (argc < 3 || std::string_view(argv[1]).starts_with("-"))
    return refuse(2, "Say FILE and QUERY, then settings: ridgecast-server snapshot out.glb 'box=all&error=1' --terrain dem.tif.");
  std::vector<const char*> settings{argv[0]};
  settings.insert(settings.end(), argv + 3, argv + argc);
  const config::Parsed parsed = config::parse(static_cast<int>(settings.size()), settings.data(), environment);
  if (!parsed.config) return parsed.status;
  return take(*parsed.config, argv[1], argv[2]);
}

}  // namespace ridgecast
