// ridgecast-client: looks at and measures the terrain that a server streams.
// Exit codes: 0 done, 1 failed (no server, ...), 2 wrong arguments or file, 3 no OpenGL or display.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <cstdio>
#include <fstream>
#include <string>

#include "client/connection/connection.h"
#include "client/evaluation/evaluate.h"
#include "client/evaluation/fly.h"
#include "client/snapshot/snapshot.h"
#include "client/viewer/viewer.h"
#include "common/camera/path.h"
#include "common/settings/settings.h"
#include "common/version/version.h"

namespace {

using ridgecast::evaluation::FlyOptions;
using ridgecast::viewer::ViewOptions;
namespace wire = ridgecast::wire;

struct Server {
  std::string url = "ws://127.0.0.1:7070";
  std::string metric = "default";
  wire::Settings settings;
  bool noRemoteShaders = false;
  std::string ca, tokenFile;
};

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

void addServerOptions(CLI::App& command, Server& server) {
  command.add_option("url", server.url, "host:port, ws:// or wss:// (also http:// or https://), optional ?session=NAME")
      ->capture_default_str();
  command
      .add_option("--metric", server.metric,
                  "metric of refinement: default, pixels, area (pixels weighted by the area they cover) or thesis")
      ->check(CLI::IsMember({"default", "pixels", "area", "thesis"}).description(""))
      ->type_name("NAME");
  command
      .add_option("--threshold", server.settings.threshold,
                  "error above which to refine: pixels, or the thesis's product; 0: the server's default")
      ->check(within(0.0, 1e9))
      ->type_name("NUMBER");
  command.add_option("--budget", server.settings.triangleBudget, "triangle budget; 0: the server's default")->type_name("TRIANGLES");
  command.add_option("--ca", server.ca, "certificate authorities (PEM) to trust instead of the system's")->type_name("FILE");
  command.add_option("--token-file", server.tokenFile, "send the token in this file")->type_name("FILE");
  command.add_flag("--no-remote-shaders", server.noRemoteShaders,
                   "never compile GLSL from the server: draw terrains that this client does not have in neutral colours");
}

// "1280x720" -> width and height. Returns an error message, or an empty string.
std::string parseSize(const std::string& text, std::uint32_t& width, std::uint32_t& height) {
  const auto cross = text.find('x');
  const char* end = text.data() + text.size();
  bool ok = cross != std::string::npos;
  if (ok) {
    const auto first = std::from_chars(text.data(), text.data() + cross, width),
               second = std::from_chars(text.data() + cross + 1, end, height);
    ok = first.ec == std::errc() && first.ptr == text.data() + cross && second.ec == std::errc() && second.ptr == end;
  }
  if (ok && width >= 16 && height >= 16 && width <= 16384 && height <= 16384) return {};
  return "--size: '" + text + "' is not WIDTHxHEIGHT with 16 to 16384 pixels a side, such as 1280x720";
}

// The server checks the limits. Here: only what could not be sent as a number.
void addSnapshotOptions(CLI::App& command, Server& server, ridgecast::snapshot::SnapshotOptions& shot, std::string& size) {
  const auto any = within(-1e15, 1e15);
  command.add_option("url", server.url, "host:port, ws:// or wss:// (also http:// or https://), optional ?session=NAME")
      ->capture_default_str();
  command.add_option("--ca", server.ca, "certificate authorities (PEM) to trust instead of the system's")->type_name("FILE");
  command.add_option("--token-file", server.tokenFile, "send the token in this file")->type_name("FILE");
  command.add_option("--out", shot.out, "the file to write")->required()->type_name("FILE.glb");
  auto* camera = command.add_option("--camera", shot.camera, "snapshot of what this camera's client holds")->type_name("ID");
  auto* box = command.add_option("--box", shot.box, "snapshot of this box, in metres: X0 Z0 X1 Z1")
                  ->delimiter(',')
                  ->type_name("X0,Z0,X1,Z1")
                  ->excludes(camera);
  command.add_option("--error", shot.error, "largest vertical error of a box, metres")->needs(box)->check(any)->capture_default_str();
  const auto pose = [&](const char* name, double& value, const char* help) {
    command.add_option(name, value, help)->excludes(camera)->excludes(box)->check(any)->capture_default_str();
  };
  pose("--x", shot.x, "place of a pose, metres");
  pose("--z", shot.z, "place of a pose, metres");
  pose("--altitude", shot.altitude, "metres above the ground there");
  pose("--yaw", shot.yaw, "degrees, positive to the left");
  pose("--pitch", shot.pitch, "degrees, positive upwards");
  pose("--fov", shot.fov, "vertical field of view, degrees");
  pose("--threshold", shot.threshold, "error above which to refine, pixels");
  command.add_option("--size", size, "picture that the pose is refined for, WIDTHxHEIGHT")
      ->excludes(camera)
      ->excludes(box)
      ->capture_default_str();
  command.add_flag("--draco", shot.draco, "compress with Draco");
  command.add_flag("!--no-normals", shot.normals, "omit normals");
  command.add_flag("!--no-colours", shot.colours, "omit vertex colours");
  command.add_flag("--metadata", shot.metadata, "write only the metadata, as JSON");
  command.add_option("--patience", shot.timeout, "timeout for the server, seconds")->check(within(1, 3600))->capture_default_str();
}

int wrongArguments(const std::string& message) {
  std::fprintf(stderr, "ridgecast-client: %s\n", message.c_str());
  return ridgecast::evaluation::kBadInput;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Flies over terrain that a Ridgecast server streams, beside the same terrain ray-marched."};
  app.set_version_flag("--version", ridgecast::version::describe("ridgecast-client", wire::kProtocolVersion));

  Server server;
  std::string size = "1280x720";

  ViewOptions view;
  CLI::App* viewCommand = app.add_subcommand("view", "A window: fly with keyboard and mouse");
  addServerOptions(*viewCommand, server);
  viewCommand->add_option("--size", size, "size of the window, WIDTHxHEIGHT")->capture_default_str();
  viewCommand->add_option("--x", view.x, "start, metres")->check(within(-4e12, 4e12))->capture_default_str();
  viewCommand->add_option("--z", view.z, "start, metres")->check(within(-4e12, 4e12))->capture_default_str();
  viewCommand->add_option("--altitude", view.altitude, "metres above the ground there")
      ->check(within(1.0, 100000.0))
      ->capture_default_str();
  viewCommand->add_option("--yaw", view.yaw, "degrees, positive to the left")->check(within(-360.0, 360.0))->capture_default_str();
  viewCommand->add_option("--pitch", view.pitch, "degrees, positive upwards")->check(within(-89.0, 89.0))->capture_default_str();
  viewCommand->add_option("--seconds", view.seconds, "close after this time, seconds")->check(within(0.0, 86400.0));
  viewCommand->add_option("--screenshot", view.screenshot, "write a PNG of the window when it closes")->type_name("FILE.png");
  std::string viewPath;
  viewCommand->add_option("--path", viewPath, "follow this camera path, as `fly` does; P stops and restarts it")->type_name("FILE.json");
  viewCommand->add_flag("!--no-vsync", view.vsync, "do not wait for the screen's refresh");
  viewCommand->add_flag("--invert-y", view.invertY, "invert vertical looking, of mouse and sticks");
  viewCommand->add_flag("--reduced-motion", view.reducedMotion, "show changes of the mesh at once, without morphing");
  viewCommand->add_option("--text-scale", view.textScale, "text size, relative to the screen's own scale")
      ->check(within(0.5, 4.0))
      ->capture_default_str();

  FlyOptions fly;
  CLI::App* flyCommand = app.add_subcommand("fly", "Without a window: fly a path, draw both renderings, compare and measure");
  addServerOptions(*flyCommand, server);
  flyCommand->add_option("--path", fly.path, "camera path")->required()->type_name("FILE.json");
  flyCommand->add_option("--out", fly.out, "folder for pictures and results")->required()->type_name("DIR");
  flyCommand->add_option("--rate", fly.rate, "iterations a second of path time")->check(within(0.01, 1000.0))->capture_default_str();
  flyCommand->add_option("--frames-every", fly.framesEvery, "seconds of path time between pictures; default: six in all")
      ->check(within(0.001, 86400.0));
  flyCommand->add_option("--size", size, "size of the pictures, WIDTHxHEIGHT")->capture_default_str();
  flyCommand->add_option("--supersample", fly.supersample, "N x N samples a pixel")
      ->check(CLI::Range(1, 16).description(""))
      ->capture_default_str();
  flyCommand->add_option("--export", fly.exportFile, "write the held mesh as uncompressed glTF")->type_name("FILE.glb");
  flyCommand->add_option("--export-at", fly.exportAt, "path time of the export, seconds; default: at the end, settled")
      ->check(within(0.0, 86400.0));
  flyCommand->add_option("--settle-limit", fly.settleLimit, "longest wait for the mesh to settle at the end, seconds")
      ->check(within(0.0, 86400.0))
      ->capture_default_str();
  flyCommand->add_flag("--realtime", fly.realtime, "fly by the clock instead of in lock-step");
  flyCommand->add_option("--seconds", fly.seconds, "fly only this much of the path")->check(within(0.0, 86400.0));

  flyCommand->add_flag("--corrected", fly.corrected, "also draw and compare the mesh corrected onto the true surface along each ray");
  flyCommand->add_flag("--uploads", fly.measureFrames,
                       "in lock-step: upload every iteration to the graphics card, draw it, and time both (upload_ms, draw_ms)");
  flyCommand->add_flag("--unfiltered", fly.unfiltered, "also compare without filtering by footprint");
  flyCommand->add_flag("--popping", fly.measurePopping,
                       "measure how much pictures jump while the mesh refines at the end of the path, with and without morphing");

  ridgecast::evaluation::EvaluateOptions evaluate;
  CLI::App* evaluateCommand =
      app.add_subcommand("evaluate", "Fly over all terrains with its own servers: tables, plots and one HTML report");
  evaluateCommand->add_option("--out", evaluate.out, "folder for all results; existing results are kept")->required()->type_name("DIR");
  evaluateCommand->add_flag("--quick", evaluate.quick, "small pictures and short flights: minutes on a software driver");
  std::string evaluateSize;
  evaluateCommand->add_option("--terrains", evaluate.terrains, "built-in terrains; default: all")
      ->delimiter(',')
      ->check(CLI::IsMember({"alpine", "canyon", "archipelago"}).description(""))
      ->type_name("NAME,...");
  evaluateCommand->add_option("--views", evaluate.views, "cameras at rest: low, overview, grazing; default: all")
      ->delimiter(',')
      ->check(CLI::IsMember({"low", "overview", "grazing"}).description(""))
      ->type_name("NAME,...");
  std::vector<std::string> refined;
  evaluateCommand
      ->add_option("--refined", refined,
                   "how to refine the meshes, such as area:0.3; default: pixels:1, pixels:0.5 and area:0.3 for cameras at rest, seven "
                   "ways along the flights")
      ->delimiter(',')
      ->type_name("METRIC:THRESHOLD,...");
  evaluateCommand->add_option("--only", evaluate.only, "views (cameras at rest, settled meshes) or flights; default: both")
      ->check(CLI::IsMember({"views", "flights"}).description(""))
      ->type_name("WHICH");
  evaluateCommand->add_option("--size", evaluateSize, "size of the pictures, WIDTHxHEIGHT; default: 1280x720, quick 480x270");
  evaluateCommand
      ->add_option("--supersample", evaluate.supersample,
                   "largest number of samples a pixel side for cameras at rest: 1, 2, 4 or 8; default: 4, quick 2")
      ->check(CLI::IsMember({1, 2, 4, 8}).description(""));
  evaluateCommand->add_option("--repeats", evaluate.repeats, "repeats of what is timed; default: 3, quick 1")
      ->check(CLI::Range(1, 100).description(""));
  evaluateCommand->add_option("--seconds", evaluate.seconds, "seconds of each flight; default: 20 (the finest: whole), quick 3")
      ->check(within(0.0, 86400.0));
  evaluateCommand->add_flag("--report", evaluate.reportOnly, "measure nothing: report the results in the folder so far");
  evaluateCommand->add_option("--server", evaluate.server, "server program; default: ridgecast-server beside this one")->type_name("FILE");

  ridgecast::snapshot::SnapshotOptions shot;
  CLI::App* snapshotCommand = app.add_subcommand("snapshot", "A glTF file of a pose, a live camera or a box, made by the server");
  addSnapshotOptions(*snapshotCommand, server, shot, size);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : ridgecast::evaluation::kBadInput;
  }

  if (evaluateCommand->parsed() && !evaluateSize.empty()) {
    std::uint32_t width = 0, height = 0;
    if (const std::string wrong = parseSize(evaluateSize, width, height); !wrong.empty()) return wrongArguments(wrong);
    evaluate.width = width;
    evaluate.height = height;
  }
  for (const std::string& text : refined) {
    auto mesh = ridgecast::evaluation::meshCaseFrom(text);
    if (!mesh) return wrongArguments("--refined: " + mesh.error().message);
    evaluate.refined.push_back(std::move(*mesh));
  }
  if (evaluateCommand->parsed()) return ridgecast::evaluation::evaluate(evaluate);
  const bool flies = flyCommand->parsed(), shoots = snapshotCommand->parsed();
  if (!flies && !shoots && !viewCommand->parsed()) return wrongArguments("name a command: view, fly, snapshot or evaluate; see --help");

  auto url = ridgecast::connection::parseUrl(server.url);
  if (!url) return wrongArguments(url.error().message);
  url->ca = server.ca;
  if (!server.tokenFile.empty()) {
    std::ifstream in(server.tokenFile);
    if (!(in >> url->token) || url->token.size() > 4096 ||
        !std::all_of(url->token.begin(), url->token.end(), [](char c) { return c > ' ' && c < 0x7f; }))
      return wrongArguments("--token-file: '" + server.tokenFile + "' holds no token; 'ridgecast-server token' prints one");
  }
  server.settings.metric = ridgecast::settings::metricNamed(server.metric).value();
  if (const std::string wrong = parseSize(size,
                                          flies    ? fly.width
                                          : shoots ? shot.width
                                                   : view.width,
                                          flies    ? fly.height
                                          : shoots ? shot.height
                                                   : view.height);
      !wrong.empty())
    return wrongArguments(wrong);
  if (shoots) {
    shot.url = *url;
    return ridgecast::snapshot::snapshot(shot);
  }
  if (flies) {
    if (fly.exportAt && fly.exportFile.empty()) return wrongArguments("--export-at requires --export FILE.glb");
    fly.url = *url;
    fly.settings = server.settings;
    fly.remoteShaders = !server.noRemoteShaders;
    return ridgecast::evaluation::fly(fly);
  }
  if (!viewPath.empty()) {
    auto path = ridgecast::camera::readPath(viewPath);
    if (!path) return wrongArguments("--path: " + path.error().message);
    view.path = std::move(*path);
  }
  view.url = *url;
  view.settings = server.settings;
  view.remoteShaders = !server.noRemoteShaders;
  return ridgecast::viewer::view(view);
}
