// ridgecast-client: looks at and measures the terrain that a server streams.
// Exit codes: client/exit/exit.h.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <charconv>
#include <cstdio>
#include <fstream>
#include <functional>
#include <memory>
#include <string>

#include "client/evaluation/evaluate.h"
#include "client/evaluation/fly.h"
#include "client/evaluation/picture.h"
#include "client/exit/exit.h"
#include "client/link/connection.h"
#include "client/snapshot/snapshot.h"
#include "client/viewer/viewer.h"
#include "common/camera/path.h"
#include "common/settings/settings.h"
#include "common/text/text.h"
#include "common/version/version.h"

namespace {

using namespace ridgecast;

// CLI11's own range accepts "nan".
CLI::Validator within(double low, double high) {
  const auto judge = [low, high](const std::string& text) {
    double value = 0;
    if (CLI::detail::lexical_cast(text, value) && value >= low && value <= high) return std::string();
    char range[64];
    std::snprintf(range, sizeof range, "%.12g to %.12g", low, high);
    return "'" + text + "' is not a number from " + range;
  };
  return CLI::Validator(judge, "");
}

// Goes into a URL as it is; the server judges the rest.
CLI::Validator places() {
  return CLI::Validator(
      [](const std::string& text) {
        return text::hasOnly(text, ".,:-") ? std::string()
                                           : "'" + text + "' has other characters than letters, digits, dots, commas, colons and -";
      },
      "");
}

template <class Value>
CLI::Option* addNumber(CLI::App& command, const char* name, Value& value, double low, double high, const char* help) {
  auto* const option = command.add_option(name, value, help)->check(within(low, high));
  if constexpr (std::is_arithmetic_v<Value>) option->capture_default_str();
  return option;
}

// Options of view, fly and snapshot.
struct Shared {
  std::string url = "ws://127.0.0.1:7070", ca, tokenFile;
  std::string metric = "default", size = "1280x720";
  wire::Settings settings;
  bool noRemoteShaders = false;
};

constexpr const char* kColourHelp =
    "also refine where colours of vertices are off by more than this share of full red, green or blue, 0.01 to 1; default: ignore colour";

// `draws`: the command refines and draws its own mesh.
void addShared(CLI::App& command, Shared& shared, bool draws) {
  command.add_option("url", shared.url, "host:port, ws:// or wss:// (also http:// or https://), optional ?session=NAME")
      ->capture_default_str();
  if (draws) {
    command
        .add_option("--metric", shared.metric,
                    "metric of refinement: default, pixels, area (pixels weighted by the area they cover) or thesis")
        ->check(CLI::IsMember({"default", "pixels", "area", "thesis"}).description(""))
        ->type_name("NAME");
    command
        .add_option("--threshold", shared.settings.threshold,
                    "error above which to refine: pixels, or the thesis's product; 0: the server's default")
        ->check(within(0.0, 1e9))
        ->type_name("NUMBER");
    command.add_option("--colour-error", shared.settings.colourError, kColourHelp)->check(within(0.0, 1.0))->type_name("SHARE");
    command.add_option("--budget", shared.settings.triangleBudget, "triangle budget; 0: the server's default")->type_name("TRIANGLES");
  }
  command.add_option("--ca", shared.ca, "certificate authorities (PEM) to trust instead of the system's")->type_name("FILE");
  command.add_option("--token-file", shared.tokenFile, "send the token in this file")->type_name("FILE");
  if (draws)
    command.add_flag("--no-remote-shaders", shared.noRemoteShaders,
                     "never compile GLSL from the server: draw terrains that this client does not have in neutral colours");
}

// "1280x720" -> width and height.
template <class Size>
Outcome<void> parseSize(const std::string& text, Size& out) {
  std::uint32_t width = 0, height = 0;
  const char* const end = text.data() + text.size();
  const char* const cross = std::from_chars(text.data(), end, width).ptr;
  if (*cross != 'x' || std::from_chars(cross + 1, end, height).ptr != end || std::min(width, height) < 16 ||
      std::max(width, height) > 16384)
    return Error{"--size: '" + text + "' is not WIDTHxHEIGHT with 16 to 16384 pixels a side, such as 1280x720"};
  out.width = width;
  out.height = height;
  return {};
}

template <class Options>
Outcome<void> share(const Shared& shared, Options& options) {
  auto url = core::parseUrl(shared.url);
  if (!url) return url.error();
  url->ca = shared.ca;
  if (!shared.tokenFile.empty()) {
    std::ifstream in(shared.tokenFile);
    if (!(in >> url->token) || url->token.size() > 4096 || !std::ranges::all_of(url->token, [](char c) { return c > ' ' && c < 0x7f; }))
      return Error{"--token-file: '" + shared.tokenFile + "' holds no token; 'ridgecast-server token' prints one"};
  }
  options.url = std::move(*url);
  if constexpr (requires { options.settings; }) {
    options.settings = shared.settings;
    options.settings.metric = settings::metricNamed(shared.metric).value();
    options.remoteShaders = !shared.noRemoteShaders;
  }
  if (shared.size.empty()) return {};
  return parseSize(shared.size, options);
}

using Run = std::function<int()>;

Run viewCommand(CLI::App& command) {
  const auto shared = std::make_shared<Shared>();
  const auto view = std::make_shared<viewer::ViewOptions>();
  const auto path = std::make_shared<std::string>();
  addShared(command, *shared, true);
  shared->size.clear();
  command.add_option("--size", shared->size, "size of the window, WIDTHxHEIGHT; default: as last time, at first 1280x720");
  command.add_flag("--fresh", view->fresh, "neither use nor change what the window remembers: size, place, toggles, text size");
  addNumber(command, "--x", view->x, -4e12, 4e12, "start, metres; default: where you last were in the session, at first 0");
  addNumber(command, "--z", view->z, -4e12, 4e12, "start, metres");
  addNumber(command, "--altitude", view->altitude, 1.0, 100000.0, "metres above the ground there");
  addNumber(command, "--yaw", view->yaw, -360.0, 360.0, "degrees, positive to the left");
  addNumber(command, "--pitch", view->pitch, -89.0, 89.0, "degrees, positive upwards");
  addNumber(command, "--seconds", view->seconds, 0.0, 86400.0, "close after this time, seconds");
  command.add_option("--screenshot", view->screenshot, "write a PNG of the window when it closes")->type_name("FILE.png");
  command.add_option("--path", *path, "follow this camera path, as `fly` does; O stops and restarts it")->type_name("FILE.json");
  command.add_flag("!--no-vsync", view->vsync, "do not wait for the screen's refresh");
  command.add_flag("--invert-y", view->invertY, "invert looking up and down, by mouse and sticks");
  command.add_flag("--reduced-motion", view->reducedMotion, "show changes of the mesh at once, without morphing");
  command.add_option("--name", view->name, "your name, as the others see it")->type_name("NAME");
  addNumber(command, "--text-scale", view->textScale, 0.5, 4.0, "text size, relative to the screen's own scale");
  return [=] {
    if (auto set = share(*shared, *view); !set) return fail(kBadInput, set.error());
    if (!path->empty()) {
      auto read = camera::readPath(*path);
      if (!read) return fail(kBadInput, {"--path: " + read.error().message});
      view->path = std::move(*read);
    }
    return viewer::view(*view);
  };
}

Run flyCommand(CLI::App& command) {
  const auto shared = std::make_shared<Shared>();
  const auto fly = std::make_shared<evaluation::FlyOptions>();
  addShared(command, *shared, true);
  command.add_option("--path", fly->path, "camera path")->required()->type_name("FILE.json");
  command.add_option("--out", fly->out, "folder for pictures and results")->required()->type_name("DIR");
  addNumber(command, "--rate", fly->rate, 0.01, 1000.0, "iterations a second of path time");
  addNumber(command, "--frames-every", fly->framesEvery, 0.001, 86400.0, "seconds of path time between pictures; default: six in all");
  command.add_option("--size", shared->size, "size of the pictures, WIDTHxHEIGHT")->capture_default_str();
  command.add_option("--supersample", fly->supersample, "N x N samples a pixel")
      ->check(CLI::Range(1, 16).description(""))
      ->capture_default_str();
  command.add_option("--export", fly->exportFile, "write the held mesh as uncompressed glTF")->type_name("FILE.glb");
  addNumber(command, "--export-at", fly->exportAt, 0.0, 86400.0, "path time of the export, seconds; default: at the end, settled");
  addNumber(command, "--settle-limit", fly->settleLimit, 0.0, 86400.0, "longest wait for the mesh to settle at the end, seconds");
  command.add_flag("--realtime", fly->realtime, "fly in real time instead of in lock-step");
  addNumber(command, "--seconds", fly->seconds, 0.0, 86400.0, "fly only this much of the path");
  command.add_flag("--corrected", fly->corrected, "also draw and compare the mesh corrected onto the true surface along each ray");
  command.add_flag("--uploads", fly->measureFrames,
                   "in lock-step: upload every iteration to the graphics card, draw it, and time both (upload_ms, draw_ms)");
  command.add_flag("--unfiltered", fly->unfiltered, "also compare without filtering by footprint");
  command.add_flag("--popping", fly->measurePopping,
                   "measure how much pictures jump while the mesh refines at the end of the path, with and without morphing");
  return [=] {
    if (auto set = share(*shared, *fly); !set) return fail(kBadInput, set.error());
    if (fly->exportAt && fly->exportFile.empty()) return fail(kBadInput, {"--export-at requires --export FILE.glb"});
    return evaluation::fly(*fly);
  };
}

// A terrain of one's own instead of a server's.
CLI::Option* addOffline(CLI::App& command, snapshot::Offline& offline) {
  auto* const terrain =
      command
          .add_option("--terrain", offline.terrain,
                      "without a server: of this terrain, a name, NAME.glsl, or a height map (.tif, .png, .asc, .hgt, .r16)")
          ->type_name("NAME|FILE")
          ->excludes(command.get_option("url"));
  command.add_option("--seed", offline.seed, "seed of that terrain")->needs(terrain)->capture_default_str();
  command.add_option("--param", offline.parameters, "a parameter of that terrain; repeatable")
      ->needs(terrain)
      ->allow_extra_args(false)
      ->type_name("NAME=NUMBER");
  command.add_option("--raster", offline.raster, "how to read a height map, as for ridgecast-server; repeatable")
      ->needs(terrain)
      ->allow_extra_args(false)
      ->type_name("NAME=VALUE");
  command
      .add_flag_callback(
          "--project", [&offline] { offline.raster.emplace_back("project=local"); },
          "lay a height map in degrees on the tangent plane at its middle: --raster project=local")
      ->needs(terrain);
  command
      .add_option("--drape", offline.drape,
                  "picture on a height map: a GeoTIFF of red, green and blue in the map's CRS, or a .txt of heights and colours")
      ->needs(terrain)
      ->type_name("FILE");
  command.add_option("--terrain-dir", offline.folder, "folder of terrain files")->needs(terrain)->type_name("DIR");
  command.add_option("--server", offline.program, "server program; default: ridgecast-server beside this one")
      ->needs(terrain)
      ->type_name("FILE");
  return terrain;
}

Run pictureCommand(CLI::App& command) {
  const auto shared = std::make_shared<Shared>();
  const auto picture = std::make_shared<evaluation::PictureOptions>();
  const auto own = std::make_shared<snapshot::Offline>();
  const auto drawn = std::make_shared<std::string>("corrected");
  addShared(command, *shared, true);
  addOffline(command, *own);
  command.add_option("--out", picture->out, "the file to write")->required()->type_name("FILE.png");
  addNumber(command, "--x", picture->x, -4e12, 4e12, "place, metres; default: 0, or the middle of a map that lies elsewhere");
  addNumber(command, "--z", picture->z, -4e12, 4e12, "place, metres");
  addNumber(command, "--altitude", picture->altitude, 0.1, 100000.0, "metres above the ground there");
  addNumber(command, "--yaw", picture->yaw, -360.0, 360.0, "degrees, positive to the left");
  addNumber(command, "--pitch", picture->pitch, -89.0, 89.0, "degrees, positive upwards");
  addNumber(command, "--fov", picture->fov, 1.0, 120.0, "vertical field of view, degrees");
  command.add_option("--size", shared->size, "size of the picture, WIDTHxHEIGHT")->capture_default_str();
  command.add_option("--supersample", picture->supersample, "N x N samples a pixel")
      ->check(CLI::Range(1, 16).description(""))
      ->capture_default_str();
  command.add_option("--draw", *drawn, "corrected: the mesh moved onto the true surface; mesh: as it is; march: the ray march")
      ->check(CLI::IsMember({"corrected", "mesh", "march"}).description(""))
      ->type_name("WHAT")
      ->capture_default_str();
  return [=] {
    if (auto set = share(*shared, *picture); !set) return fail(kBadInput, set.error());
    if (!own->terrain.empty()) {
      picture->server = snapshot::programOf(*own);
      picture->arguments = snapshot::arguments(*own);
    }
    using evaluation::Drawn;
    picture->drawn = *drawn == "mesh" ? Drawn::kMesh : *drawn == "march" ? Drawn::kMarch : Drawn::kCorrected;
    return evaluation::picture(*picture);
  };
}

Run evaluateCommand(CLI::App& command) {
  const auto evaluate = std::make_shared<evaluation::EvaluateOptions>();
  const auto size = std::make_shared<std::string>();
  const auto refined = std::make_shared<std::vector<std::string>>();
  command.add_option("--out", evaluate->out, "folder for all results; existing results are kept")->required()->type_name("DIR");
  command.add_flag("--quick", evaluate->quick, "small pictures and short flights: minutes on a software driver");
  command.add_option("--terrains", evaluate->terrains, "built-in terrains; default: all")
      ->delimiter(',')
      ->check(CLI::IsMember({"alpine", "canyon", "archipelago"}).description(""))
      ->type_name("NAME,...");
  command.add_option("--views", evaluate->views, "cameras at rest: low, overview, grazing; default: all")
      ->delimiter(',')
      ->check(CLI::IsMember({"low", "overview", "grazing"}).description(""))
      ->type_name("NAME,...");
  command
      .add_option("--refined", *refined,
                  "how to refine the meshes, such as area:0.3; default: pixels:1, pixels:0.5 and area:0.3 for cameras at rest, seven "
                  "ways along the flights")
      ->delimiter(',')
      ->type_name("METRIC:THRESHOLD,...");
  command.add_option("--only", evaluate->only, "views (cameras at rest, settled meshes) or flights; default: both")
      ->check(CLI::IsMember({"views", "flights"}).description(""))
      ->type_name("WHICH");
  command.add_option("--size", *size, "size of the pictures, WIDTHxHEIGHT; default: 1280x720, quick 480x270");
  command
      .add_option("--supersample", evaluate->supersample,
                  "largest number of samples a pixel side for cameras at rest: 1, 2, 4 or 8; default: 4, quick 2")
      ->check(CLI::IsMember({1, 2, 4, 8}).description(""));
  command.add_option("--repeats", evaluate->repeats, "repeats of what is timed; default: 3, quick 1")
      ->check(CLI::Range(1, 100).description(""));
  addNumber(command, "--seconds", evaluate->seconds, 0.0, 86400.0, "seconds of each flight; default: 20 (the finest: whole), quick 3");
  command.add_flag("--report", evaluate->reportOnly, "measure nothing: report the results that are in the folder");
  command.add_option("--server", evaluate->server, "server program; default: ridgecast-server beside this one")->type_name("FILE");
  return [=] {
    if (!size->empty())
      if (auto set = parseSize(*size, *evaluate); !set) return fail(kBadInput, set.error());
    for (const std::string& text : *refined) {
      auto mesh = evaluation::meshCaseFrom(text);
      if (!mesh) return fail(kBadInput, {"--refined: " + mesh.error().message});
      evaluate->refined.push_back(std::move(*mesh));
    }
    return evaluation::evaluate(*evaluate);
  };
}

// A folder instead of a file.
void addTiles(CLI::App& command, snapshot::SnapshotOptions& shot, CLI::Option* file) {
  auto* const tiles =
      command
          .add_option("--tiles", shot.tiles, "a new folder of 3D Tiles, of which the finest keep the error; FILE.pmtiles: web map tiles")
          ->needs(command.get_option("--terrain"))
          ->needs(command.get_option("--box"))
          ->excludes(file)
          ->excludes(command.get_option("--metadata"))
          ->type_name("DIR|FILE.pmtiles");
  command.add_option("--layer", shot.layer, "of a .pmtiles: heights (Terrarium), the default, or colours")
      ->needs(tiles)
      ->check(CLI::IsMember({"heights", "colours"}))
      ->type_name("heights|colours");
  command.add_option("--zoom", shot.zoom, "finest level of a .pmtiles; default: as the height map's samples")
      ->needs(tiles)
      ->type_name("LEVEL");
  command
      .add_option("--at", shot.at,
                  "where on Earth the middle of the tiles' box lies, degrees and metres, of a .pmtiles the world's origin; default: the "
                  "map's place")
      ->needs(tiles)
      ->check(places())
      ->type_name("LON,LAT[,HEIGHT]");
  command
      .add_option("--heights", shot.heights,
                  "from where the heights of tiles on Earth count: sea (EGM96), the default, or ellipsoid, the default with HEIGHT in --at")
      ->needs(tiles)
      ->check(CLI::IsMember({"sea", "ellipsoid"}))
      ->type_name("sea|ellipsoid");
}

// The server checks the limits. Here: only what could not be sent as a number.
Run snapshotCommand(CLI::App& command) {
  const auto shared = std::make_shared<Shared>();
  const auto offline = std::make_shared<snapshot::Offline>();
  const auto shot = std::make_shared<snapshot::SnapshotOptions>();
  addShared(command, *shared, false);
  const auto any = within(-1e15, 1e15);
  auto* const file = command.add_option("--out", shot->out, "the file to write: .glb, .ply, .obj or, of a box's heights, .tif (GeoTIFF)")
                         ->type_name("FILE");
  auto* camera = command.add_option("--camera", shot->camera, "snapshot of what this camera's client holds")->type_name("ID");
  auto* box = command.add_option("--box", shot->box, "snapshot of this box, in metres or as --crs says; all: of a whole height map")
                  ->type_name("X0,Z0,X1,Z1|WEST,SOUTH,EAST,NORTH|all")
                  ->check(places())
                  ->excludes(camera);
  command.add_option("--crs", shot->crs, "the box is in longitudes and latitudes, or in eastings and northings of a CRS")
      ->type_name("lonlat|EPSG:N")
      ->check(places())
      ->needs(box);
  command.add_option("--error", shot->error, "largest vertical error of a box, metres")->needs(box)->check(any)->capture_default_str();
  command.add_option("--spacing", shot->spacing, "distance between the samples of a .tif, metres; default: the height map's own")
      ->needs(box)
      ->check(within(0.01, 1000))
      ->type_name("METRES");
  const auto pose = [&](const char* name, double& value, const char* help) {
    command.add_option(name, value, help)->excludes(camera)->excludes(box)->check(any)->capture_default_str();
  };
  pose("--x", shot->pose.x, "place of a pose, metres");
  pose("--z", shot->pose.z, "place of a pose, metres");
  pose("--altitude", shot->pose.altitude, "metres above the ground there");
  pose("--yaw", shot->pose.yaw, "degrees, positive to the left");
  pose("--pitch", shot->pose.pitch, "degrees, positive upwards");
  pose("--fov", shot->pose.fov, "vertical field of view, degrees");
  pose("--threshold", shot->pose.threshold, "error above which to refine, pixels");
  command.add_option("--colour-error", shot->pose.colourError, kColourHelp)->excludes(camera)->excludes(box)->check(within(0.0, 1.0));
  command.add_option("--size", shared->size, "picture that the pose is refined for, WIDTHxHEIGHT")
      ->excludes(camera)
      ->excludes(box)
      ->capture_default_str();
  command.add_option("--origin", shot->origin, "where the file's coordinates begin: cell, centre (of the box, or the camera) or world")
      ->check(CLI::IsMember({"cell", "centre", "world"}).description(""))
      ->capture_default_str();
  command.add_option("--up", shot->up, "the axis that is up in a .ply or .obj: y, or z, with y north")
      ->check(CLI::IsMember({"y", "z"}).description(""))
      ->capture_default_str();
  command
      .add_option("--texture", shot->texture,
                  "colours as a picture with this many pixels along the box's longer side, in a .glb; default: colours of vertices")
      ->needs(box)
      ->type_name("PIXELS");
  command.add_flag("--draco", shot->draco, "compress with Draco");
  command.add_flag("!--no-normals", shot->normals, "omit normals");
  command.add_flag("!--no-colours", shot->colours, "omit vertex colours");
  command.add_flag("--materials", shot->materials, "add what the ground is made of, by vertex (EXT_structural_metadata)");
  command.add_flag("--metadata", shot->metadata, "write only the metadata, as JSON");
  addNumber(command, "--timeout", shot->timeout, 1, 3600, "timeout for the server, seconds");
  addNumber(command, "--patience", shot->timeout, 1, 3600, "its old name")->group("");
  auto* const terrain = addOffline(command, *offline)->excludes(camera);
  command.add_option("--max-triangles", offline->triangles, "largest file, in triangles")
      ->needs(terrain)
      ->check(within(10'000, 20'000'000))
      ->capture_default_str();
  addTiles(command, *shot, file);
  return [=] {
    if (shot->out.empty() && shot->tiles.empty()) return fail(kBadInput, {"say --out FILE, or --tiles DIR with --terrain"});
    if (auto set = share(*shared, *shot); !set) return fail(kBadInput, set.error());
    if (!offline->terrain.empty()) shot->offline = *offline;
    return snapshot::snapshot(*shot);
  };
}

// Sets `run` if the command line names the command.
void add(CLI::App& app, Run& run, const char* name, const char* help, Run (*options)(CLI::App&)) {
  CLI::App* const command = app.add_subcommand(name, help);
  command->callback([&run, its = options(*command)] { run = its; });
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Flies over terrain that a Ridgecast server streams, beside the same terrain ray-marched."};
  app.set_version_flag("--version", version::describe("ridgecast-client", wire::kProtocolVersion));
  app.require_subcommand(0, 1);
  Run run;
  add(app, run, "view", "A window: fly with keyboard and mouse", viewCommand);
  add(app, run, "fly", "Without a window: fly a path, draw both renderings, compare and measure", flyCommand);
  add(app, run, "picture", "Without a window: a PNG of the settled mesh from one pose", pictureCommand);
  add(app, run, "evaluate", "Fly over all terrains with its own servers: tables, plots and one HTML report", evaluateCommand);
  add(app, run, "snapshot", "A glTF, PLY or OBJ file of a pose, a live camera or a box, from a server or a terrain", snapshotCommand);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? kSuccess : kBadInput;
  }
  return run ? run() : fail(kBadInput, {"name a command: view, fly, picture, snapshot or evaluate; see --help"});
}
