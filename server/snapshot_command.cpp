#include "server/snapshot_command.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <future>
#include <iostream>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "common/user_terrain/catalogue.h"
#include "server/config/config.h"
#include "server/directory/directory.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"
#include "server/snapshot/archive.h"
#include "server/snapshot/snapshot.h"
#include "server/snapshot/tiles.h"

namespace ridgecast {
namespace {

constexpr const char* kHelp = R"(Usage: ridgecast-server snapshot FILE|FOLDER/ QUERY [SETTINGS]

Makes a snapshot of a terrain without serving it, for example
  ridgecast-server snapshot out.glb 'box=all&error=1' --terrain dem.tif

  FILE      .glb, .ply, .obj, or .json for the metadata only; .tif: heights on a grid, as a GeoTIFF; .pmtiles: web map tiles
  FOLDER/   with the slash: 3D Tiles of a box, in a new or empty folder; without its tileset.json, written last, it is unfinished
  QUERY     what follows the ? in a snapshot's URL, without camera=: a pose (x=0&z=0&altitude=150&yaw=0&pitch=-10) or a box
            (x0=0&z0=0&x1=500&z1=500&error=1, in metres, up to 1,000 km wide; box=all: a whole height map); of a .tif a box
            and spacing=METRES
  SETTINGS  those of ridgecast-server that name the terrain, and --max-snapshot-triangles

Exit status: 0; 1 after a failure; 2 after bad input.
)";

struct Taking {
  snapshot::Limits limits;
  unsigned threads;
  std::shared_ptr<session::Session> session = {};
};

int refuse(int status, const std::string& sentence) {
  std::cerr << "ridgecast-server snapshot: " << sentence << "\n";
  return status;
}

// Waits for the result and tells meanwhile what is done: on a terminal in one line, elsewhere in a line a stage, and every ten seconds.
template <class Result>
Result follow(std::future<Result> result, const std::function<std::string()>& progress) {
  const auto start = std::chrono::steady_clock::now();
  const bool terminal = isatty(STDERR_FILENO);
  std::string told;
  double due = 0;
  while (result.wait_for(std::chrono::milliseconds(terminal ? 250 : 100)) != std::future_status::ready) {
    const std::string text = progress(), stage = text.substr(0, text.rfind(','));
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    if (terminal) {
      std::fprintf(stderr, "\r%.0f s: %-60s", seconds, text.c_str());
    } else if (stage != told || seconds >= due) {
      std::fprintf(stderr, "After %.1f s: %s\n", seconds, text.c_str());
      due = seconds + 10;
    }
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

int takeFile(const Taking& of, snapshot::Question question, const std::filesystem::path& file) {
  const bool metadataOnly = file.extension() == ".json";
  snapshot::Snapshots snapshots(of.limits, of.threads);
  snapshot::Progress progress;
  const auto made = follow(
      std::async(std::launch::async,
                 [&] { return snapshots.take(*of.session, of.session->ground(), question, metadataOnly, std::stop_token(), &progress); }),
      [&] { return progress.text(); });
  if (!made) return refuse(1, made.error().message);
  const std::string& bytes = metadataOnly ? made->metadata : made->file;
  if (!write(file, bytes)) return refuse(1, "Cannot write '" + file.string() + "'.");
  std::cout << file.string() << ": " << bytes.size() << " bytes\n";
  return 0;
}

int takeTiles(const Taking& of, const snapshot::Question& question, const std::filesystem::path& folder) {
  std::error_code failed;
  std::filesystem::create_directories(folder, failed);
  if (failed) return refuse(2, "Cannot make the folder '" + folder.string() + "': " + failed.message() + ".");
  if (!std::filesystem::is_empty(folder, failed) || failed)
    return refuse(2, "'" + folder.string() + "' is not empty; name a new folder for tiles, or remove what is there.");
  snapshot::Snapshots snapshots(of.limits, 1);  // each thread below makes a tile
  snapshot::TilesProgress progress;
  std::atomic<std::uint64_t> bytes{0};
  const auto put = [&](const std::string& name, std::string_view content) {
    std::error_code ignored;
    std::filesystem::create_directories((folder / name).parent_path(), ignored);
    bytes += content.size();
    return write(folder / name, content);
  };
  const auto made = follow(
      std::async(std::launch::async,
                 [&] { return snapshot::makeTiles(snapshots, *of.session, question, of.threads, put, std::stop_token(), &progress); }),
      [&] { return progress.text(); });
  if (!made) return refuse(1, made.error().message);
  std::cout << (folder / "tileset.json").string() << ": " << *made << " tiles, " << bytes << " bytes\n";
  return 0;
}

int takeArchive(const Taking& of, const snapshot::OfMapTiles& tiles, const std::filesystem::path& file) {
  const std::filesystem::path unfinished = file.string() + ".new";
  snapshot::TilesProgress progress;
  const auto made =
      follow(std::async(std::launch::async,
                        [&] { return snapshot::makeArchive(*of.session, tiles, of.threads, unfinished, std::stop_token(), &progress); }),
             [&] { return progress.text(); });
  std::error_code failed;
  if (made) std::filesystem::rename(unfinished, file, failed);
  if (made && !failed) {
    std::cout << file.string() << ": " << *made << " tiles, " << std::filesystem::file_size(file, failed) << " bytes\n";
    return 0;
  }
  const std::string sentence = made ? "Cannot write '" + file.string() + "'." : made.error().message;
  std::filesystem::remove(unfinished, failed);
  return refuse(1, sentence);
}

int take(const config::Config& config, const std::string& out, const std::string& query) {
  const auto format = out.ends_with("/")       ? snapshot::Format::kTiles
                      : out.ends_with(".json") ? snapshot::Format::kGlb
                                               : snapshot::formatOf(out);
  if (!format) return refuse(2, "'" + out + "' must end in .glb, .ply, .obj, .tif, .pmtiles or .json, or in / for a folder of tiles.");
  auto terrain = user_terrain::load(config.terrain, [](const std::string& complaint) { std::cerr << complaint << "\n"; });
  if (!terrain) return refuse(2, terrain.error().message);
  Taking of{.limits = config.snapshots, .threads = config.threads ? config.threads : std::max(1u, std::thread::hardware_concurrency())};
  of.limits.seconds = 86'400;
  of.limits.boxSide = 1e6;
  of.limits.samples = 1u << 28;
  auto question = snapshot::parse(query, of.limits, (*terrain)->raster(), *format);
  if (!question) return refuse(2, question.error().message);

  scheduling::Executor executor(1);  // of cameras, of which there are none
  auto resources = std::make_shared<session::Resources>();
  resources->executor = &executor;
  resources->makeMesh = session::pipelineMeshes();
  resources->limits = config.limits;
  const auto directory = std::make_shared<directory::Directory>(resources, *terrain, config.terrain.parameters);
  of.session = directory->find(directory::kDefaultName);
  if (const auto* tiles = std::get_if<snapshot::OfMapTiles>(&question->of)) return takeArchive(of, *tiles, out);
  return *format == snapshot::Format::kTiles ? takeTiles(of, *question, out) : takeFile(of, *question, out);
}

}  // namespace

int runSnapshotCommand(int argc, const char* const* argv, const char* const* environment) {
  if (std::any_of(argv, argv + argc, [](std::string_view a) { return a == "--help" || a == "-h"; }))
    return std::cout << kHelp << std::flush ? 0 : 1;
  if (argc < 3 || std::string_view(argv[1]).starts_with("-"))
    return refuse(2, "Say FILE or FOLDER/, QUERY, then settings: ridgecast-server snapshot out.glb 'box=all&error=1'; see --help.");
  std::vector<const char*> settings{argv[0]};
  settings.insert(settings.end(), argv + 3, argv + argc);
  const config::Parsed parsed = config::parse(static_cast<int>(settings.size()), settings.data(), environment);
  if (!parsed.config) return parsed.status;
  return take(*parsed.config, argv[1], argv[2]);
}

}  // namespace ridgecast
