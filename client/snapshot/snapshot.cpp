#include "client/snapshot/snapshot.h"

#include <unistd.h>

#include <charconv>
#include <cstdio>

#include "client/exit/exit.h"
#include "client/link/download.h"

namespace ridgecast::snapshot {

namespace {

// Without an exponent, whose + would be a blank in a URL.
std::string number(double v) {
  char out[400];
  return std::string(out, std::to_chars(out, out + sizeof out, v, std::chars_format::fixed).ptr);
}

// Progress: on a terminal one line that changes, in a file a line for each stage.
class Teller {
 public:
  void operator()(const link::Progress& p) {
    const double mega = 1e-6, seconds = static_cast<double>(p.waited.count()) / 1000;
    const bool arrives = p.total > 0;
    if (isatty(STDERR_FILENO)) {
      if (!arrives)
        std::fprintf(stderr, "\rThe server is at work, %.0f s%s%-50s", seconds, p.work.empty() ? "" : ": ", p.work.c_str());
      else
        std::fprintf(stderr, "\r%.1f of %.1f MB, %3.0f %%%60s", static_cast<double>(p.received) * mega, static_cast<double>(p.total) * mega,
                     100.0 * static_cast<double>(p.received) / static_cast<double>(p.total), "");
      open_ = true;
    } else if (stage_ < 1 + arrives) {
      stage_ = 1 + arrives;
      if (arrives)
        std::fprintf(stderr, "Receiving %.1f MB after %.1f s\n", static_cast<double>(p.total) * mega, seconds);
      else
        std::fprintf(stderr, "The server is at work\n");
    } else if (!arrives && !p.work.empty() && p.work.substr(0, p.work.find(',')) != work_) {
      work_ = p.work.substr(0, p.work.find(','));
      std::fprintf(stderr, "After %.1f s: %s\n", seconds, p.work.c_str());
    }
  }
  void end() {
    if (open_) std::fprintf(stderr, "\n");
  }

 private:
  int stage_ = 0;
  std::string work_;  // the server's stage that was reported
  bool open_ = false;
};

}  // namespace

std::vector<std::string> arguments(const Offline& offline) {
  std::vector<std::string> words{"--terrain", offline.terrain, "--seed", std::to_string(offline.seed)};
  for (const std::string& parameter : offline.parameters) words.insert(words.end(), {"--param", parameter});
  for (const std::string& option : offline.raster) words.insert(words.end(), {"--raster", option});
  if (!offline.drape.empty()) words.insert(words.end(), {"--drape", offline.drape.string()});
  if (!offline.folder.empty()) words.insert(words.end(), {"--terrain-dir", offline.folder.string()});
  return words;
}

std::filesystem::path programOf(const Offline& offline) {
  std::error_code failed;
  return offline.program.empty() ? std::filesystem::read_symlink("/proc/self/exe", failed).parent_path() / "ridgecast-server"
                                 : offline.program;
}

std::string query(const SnapshotOptions& o) {
  std::string out;
  const auto add = [&](const char* name, const std::string& value) {
    out.append(out.empty() ? "" : "&").append(name).append("=").append(value);
  };
  if (o.camera) {
    add("camera", std::to_string(*o.camera));
  } else if (!o.box.empty()) {
    add("box", o.box);
    if (!o.crs.empty()) add("crs", o.crs);
    if (o.out.extension() != ".tif" && o.tiles.extension() != ".pmtiles") add("error", number(o.error));
    if (o.spacing > 0) add("spacing", number(o.spacing));
  } else {
    add("x", number(o.pose.x));
    add("z", number(o.pose.z));
    add("altitude", number(o.pose.altitude));
    add("yaw", number(o.pose.yaw));
    add("pitch", number(o.pose.pitch));
    add("fov", number(o.pose.fov));
    add("width", std::to_string(o.width));
    add("height", std::to_string(o.height));
    add("threshold", number(o.pose.threshold));
    if (o.pose.colourError > 0) add("colour_error", number(o.pose.colourError));
  }
  if (o.draco) add("compression", "draco");
  if (!o.normals) add("normals", "0");
  if (!o.colours) add("colours", "0");
  if (o.materials) add("materials", "1");
  if (o.origin != "cell") add("origin", o.origin);
  if (o.up != "y") add("up", o.up);
  if (o.texture > 0) add("texture", std::to_string(o.texture));
  if (!o.layer.empty()) add("layer", o.layer);
  if (o.zoom) add("zoom", std::to_string(*o.zoom));
  if (!o.at.empty()) add("at", o.at);
  if (!o.heights.empty()) add("heights", o.heights);
  return out;
}

std::string target(const SnapshotOptions& o) {
  const std::string own = o.out.extension();
  const std::string ending = o.metadata ? ".json" : own == ".ply" || own == ".obj" || own == ".tif" ? own : ".glb";
  return "/v1/sessions/" + o.url.session + "/snapshot" + ending + "?" + query(o);
}

namespace {

// Becomes the server's program, which says the rest. Returns only if that fails.
int becomeServer(const SnapshotOptions& options) {
  const Offline& offline = *options.offline;
  if (options.metadata && options.out.extension() != ".json") return fail(kBadInput, {"--metadata writes JSON: let --out end in .json"});
  const std::filesystem::path program = programOf(offline);
  const std::filesystem::path file = options.tiles.empty()                     ? options.out
                                     : options.tiles.extension() == ".pmtiles" ? options.tiles
                                                                               : options.tiles / "";
  std::vector<std::string> words{program.string(), "snapshot", file.string(), query(options)};
  const auto more = arguments(offline);
  words.insert(words.end(), more.begin(), more.end());
  words.insert(words.end(), {"--max-snapshot-triangles", std::to_string(offline.triangles)});
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  execv(program.c_str(), argv.data());
  return fail(kBadInput, {"cannot start " + program.string() + ": build ridgecast-server, or name it with --server"});
}

}  // namespace

int snapshot(const SnapshotOptions& options) {
  if (options.offline) return becomeServer(options);
  Teller teller;
  const auto made = link::download(options.url, target(options), options.out,
                                   std::chrono::milliseconds(static_cast<std::int64_t>(options.timeout * 1000)), std::ref(teller));
  teller.end();
  if (!made) return fail(kRuntimeFailure, made.error());
  std::printf("%s: %llu bytes\n", options.out.c_str(), static_cast<unsigned long long>(*made));
  return kSuccess;
}

}  // namespace ridgecast::snapshot
