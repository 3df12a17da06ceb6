#include "client/snapshot/snapshot.h"

#include <unistd.h>

#include <charconv>
#include <cstdio>

#include "client/connection/download.h"
#include "client/exit/exit.h"

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
  void operator()(const connection::Progress& p) {
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

std::string query(const SnapshotOptions& o) {
  std::string out;
  const auto add = [&](const char* name, const std::string& value) {
    out.append(out.empty() ? "" : "&").append(name).append("=").append(value);
  };
  if (o.camera) {
    add("camera", std::to_string(*o.camera));
  } else if (o.wholeMap) {
    add("box", "all");
    add("error", number(o.error));
  } else if (o.box) {
    const char* names[4] = {"x0", "z0", "x1", "z1"};
    for (std::size_t k = 0; k < 4; ++k) add(names[k], number((*o.box)[k]));
    add("error", number(o.error));
  } else {
    add("x", number(o.x));
    add("z", number(o.z));
    add("altitude", number(o.altitude));
    add("yaw", number(o.yaw));
    add("pitch", number(o.pitch));
    add("fov", number(o.fov));
    add("width", std::to_string(o.width));
    add("height", std::to_string(o.height));
    add("threshold", number(o.threshold));
    if (o.colourError > 0) add("colour_error", number(o.colourError));
  }
  if (o.draco) add("compression", "draco");
  if (!o.normals) add("normals", "0");
  if (!o.colours) add("colours", "0");
  if (o.origin != "cell") add("origin", o.origin);
  if (o.up != "y") add("up", o.up);
  if (o.texture > 0) add("texture", std::to_string(o.texture));
  if (!o.at.empty()) add("at", o.at);
  if (!o.heights.empty()) add("heights", o.heights);
  return out;
}

std::string target(const SnapshotOptions& o) {
  const std::string ending = o.metadata ? ".json" : o.out.extension() == ".ply" || o.out.extension() == ".obj" ? o.out.extension() : ".glb";
  return "/v1/sessions/" + o.url.session + "/snapshot" + ending + "?" + query(o);
}

namespace {

// Becomes the server's program, which says the rest. Returns only if that fails.
int becomeServer(const SnapshotOptions& options) {
  const Offline& offline = *options.offline;
  if (options.metadata && options.out.extension() != ".json") return fail(kBadInput, {"--metadata writes JSON: let --out end in .json"});
  std::error_code failed;
  const std::filesystem::path program = offline.program.empty()
                                            ? std::filesystem::read_symlink("/proc/self/exe", failed).parent_path() / "ridgecast-server"
                                            : offline.program;
  std::vector<std::string> words{program.string(),
                                 "snapshot",
                                 options.tiles.empty() ? options.out.string() : (options.tiles / "").string(),
                                 query(options),
                                 "--terrain",
                                 offline.terrain,
                                 "--seed",
                                 std::to_string(offline.seed),
                                 "--max-snapshot-triangles",
                                 std::to_string(offline.triangles)};
  for (const std::string& parameter : offline.parameters) words.insert(words.end(), {"--param", parameter});
  for (const std::string& option : offline.raster) words.insert(words.end(), {"--raster", option});
  if (!offline.drape.empty()) words.insert(words.end(), {"--drape", offline.drape.string()});
  if (!offline.folder.empty()) words.insert(words.end(), {"--terrain-dir", offline.folder.string()});
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  execv(program.c_str(), arguments.data());
  return fail(kBadInput, {"cannot start " + program.string() + ": build ridgecast-server, or name it with --server"});
}

}  // namespace

int snapshot(const SnapshotOptions& options) {
  if (options.offline) return becomeServer(options);
  Teller teller;
  const auto made = connection::download(options.url, target(options), options.out,
                                         std::chrono::milliseconds(static_cast<std::int64_t>(options.timeout * 1000)), std::ref(teller));
  teller.end();
  if (!made) return fail(kRuntimeFailure, made.error());
  std::printf("%s: %llu bytes\n", options.out.c_str(), static_cast<unsigned long long>(*made));
  return kSuccess;
}

}  // namespace ridgecast::snapshot
