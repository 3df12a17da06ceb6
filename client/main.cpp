// ridgecast-client: looks at and measures the terrain that a server streams.
// Exit codes: 0 done, 1 it failed on the way (no server, ...), 2 wrong arguments or a wrong file, 3 no OpenGL or no display.

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

// CLI11's own range lets "nan" pass.
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
  command.add_option("url", server.url, "host:port, ws:// or wss:// (http:// and https:// are the same), optional ?session=NAME")->capture_default_str();
  command.add_option("--metric", server.metric, "what refinement is measured by: default, pixels, area (pixels weighted by what they cover) or thesis")
      ->check(CLI::IsMember({"default", "pixels", "area", "thesis"}).description(""))
      ->type_name("NAME");
  command
      .add_option("--threshold", server.settings.threshold, "refine above this: pixels, or the thesis's product; 0: the server's default")
      ->check(within(0.0, 1e9))
      ->type_name("NUMBER");
  command.add_option("--budget", server.settings.triangleBudget, "most triangles; 0: the server's default")->type_name("TRIANGLES");
  command.add_option("--ca", server.ca, "trust servers by these authorities (PEM) instead of the system's")->type_name("FILE");
  command.add_option("--token-file", server.tokenFile, "show the token in this file")->type_name("FILE");
  command.add_flag("--no-remote-shaders", server.noRemoteShaders,
                   "never compile GLSL that the server sent: terrains that this client does not have are drawn neutrally");
}

// "1280x720" -> width and height; an error message, empty when it is right.
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

// The server has the limits; here only what would not reach it as a number.
void addSnapshotOptions(CLI::App& command, Server& server, ridgecast::snapshot::SnapshotOptions& shot, std::string& size) {
  const auto any = within(-1e15, 1e15);
  command.add_option("url", server.url, "host:port, ws:// or wss:// (http:// and https:// are the same), optional ?session=NAME")->capture_default_str();
  command.add_option("--ca", server.ca, "trust servers by these authorities (PEM) instead of the system's")->type_name("FILE");
  command.add_option("--token-file", server.tokenFile, "show the token in this file")->type_name("FILE");
  command.add_option("--out", shot.out, "the file to write")->required()->type_name("FILE.glb");
  auto* camera = command.add_option("--camera", shot.camera, "of what this camera's client holds")->type_name("ID");
  auto* box = command.add_option("--box", shot.box, "of this box, in metres: X0 Z0 X1 Z1")->delimiter(',')->type_name("X0,Z0,X1,Z1")->excludes(camera);
  command.add_option("--error", shot.error, "most vertical error in a box, metres")->needs(box)->check(any)->capture_default_str();
  const auto pose = [&](const char* name, double& value, const char* help) {
    command.add_option(name, value, help)->excludes(camera)->excludes(box)->check(any)->capture_default_str();
  };
  pose("--x", shot.x, "of a pose: where, metres");
  pose("--z", shot.z, "where, metres");
  pose("--altitude", shot.altitude, "metres above the ground there");
  pose("--yaw", shot.yaw, "degrees, positive to the left");
  pose("--pitch", shot.pitch, "degrees, positive upwards");
  pose("--fov", shot.fov, "vertical, degrees");
  pose("--threshold", shot.threshold, "refined above this, pixels");
  command.add_option("--size", size, "of the picture that the pose is refined for, WIDTHxHEIGHT")->excludes(camera)->excludes(box)->capture_default_str();
  command.add_flag("--draco", shot.draco, "compressed by Draco");
  command.add_flag("!--no-normals", shot.normals, "without normals");
  command.add_flag("!--no-colours", shot.colours, "without vertex colours");
  command.add_flag("--metadata", shot.metadata, "the metadata alone, as JSON");
  command.add_option("--patience", shot.patience, "seconds to wait for the server")->check(within(1, 3600))->capture_default_str();
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
  viewCommand->add_option("--size", size, "of the window, WIDTHxHEIGHT")->capture_default_str();
  viewCommand->add_option("--x", view.x, "where to begin, metres")->check(within(-4e12, 4e12))->capture_default_str();
  viewCommand->add_option("--z", view.z, "where to begin, metres")->check(within(-4e12, 4e12))->capture_default_str();
  viewCommand->add_option("--altitude", view.altitude, "metres above the ground there")
      ->check(within(1.0, 100000.0))
      ->capture_default_str();
  viewCommand->add_option("--yaw", view.yaw, "degrees, positive to the left")->check(within(-360.0, 360.0))->capture_default_str();
  viewCommand->add_option("--pitch", view.pitch, "degrees, positive upwards")->check(within(-89.0, 89.0))->capture_default_str();
  viewCommand->add_option("--seconds", view.seconds, "close by itself after so long")->check(within(0.0, 86400.0));
  viewCommand->add_option("--screenshot", view.screenshot, "a PNG of the window when it closes")->type_name("FILE.png");
  std::string viewPath;
  viewCommand->add_option("--path", viewPath, "follow this camera path, as `fly` does; P ends it and begins it again")->type_name("FILE.json");
  viewCommand->add_flag("!--no-vsync", view.vsync, "do not wait for the screen with each frame");
  viewCommand->add_flag("--invert-y", view.invertY, "the mouse and the sticks look up where they looked down");
  viewCommand->add_flag("--reduced-motion", view.reducedMotion, "changes of the mesh show at once instead of growing");
  viewCommand->add_option("--text-scale", view.textScale, "size of the text, beside the screen's own scale")->check(within(0.5, 4.0))->capture_default_str();

  FlyOptions fly;
  CLI::App* flyCommand = app.add_subcommand("fly", "No window: fly a path, draw both renderings, compare and measure");
  addServerOptions(*flyCommand, server);
  flyCommand->add_option("--path", fly.path, "camera path")->required()->type_name("FILE.json");
  flyCommand->add_option("--out", fly.out, "folder for pictures and figures")->required()->type_name("DIR");
  flyCommand->add_option("--rate", fly.rate, "iterations a second of path time")->check(within(0.01, 1000.0))->capture_default_str();
  flyCommand->add_option("--frames-every", fly.framesEvery, "seconds of path time between pictures; left out: six in all")
      ->check(within(0.001, 86400.0));
  flyCommand->add_option("--size", size, "of the pictures, WIDTHxHEIGHT")->capture_default_str();
  flyCommand->add_option("--supersample", fly.supersample, "N x N samples a pixel")
      ->check(CLI::Range(1, 16).description(""))
      ->capture_default_str();
  flyCommand->add_option("--export", fly.exportFile, "the mesh held, as uncompressed glTF")->type_name("FILE.glb");
  flyCommand->add_option("--export-at", fly.exportAt, "second of path time to export at; left out: at the end, settled")
      ->check(within(0.0, 86400.0));
  flyCommand->add_option("--settle-limit", fly.settleLimit, "seconds to wait at the end until nothing more is refined")
      ->check(within(0.0, 86400.0))
      ->capture_default_str();
  flyCommand->add_flag("--realtime", fly.realtime, "fly by the clock instead of in lock-step");
  flyCommand->add_option("--seconds", fly.seconds, "fly only so much of the path")->check(within(0.0, 86400.0));

  flyCommand->add_flag("--corrected", fly.corrected, "draw and compare the mesh corrected onto the true surface along each ray, too");
  flyCommand->add_flag("--uploads", fly.measureFrames,
                       "in lock-step: bring every iteration to the graphics card, draw it, and note how long both take (upload_ms, draw_ms)");
  flyCommand->add_flag("--unfiltered", fly.unfiltered, "compare without filtering by footprint, too");
  flyCommand->add_flag("--popping", fly.measurePopping,
                       "measure how much pictures jump while the mesh refines at the end of the path, with and without morphing");

  ridgecast::evaluation::EvaluateOptions evaluate;
  CLI::App* evaluateCommand =
      app.add_subcommand("evaluate", "Fly over all terrains with servers of its own: tables, plots and one HTML report");
  evaluateCommand->add_option("--out", evaluate.out, "folder for it all; flights that are there already are not repeated")
      ->required()
      ->type_name("DIR");
  evaluateCommand->add_flag("--quick", evaluate.quick, "small pictures and short flights: minutes on a software driver");
  std::string evaluateSize;
  evaluateCommand->add_option("--terrains", evaluate.terrains, "of the built-in ones; left out: all of them")
      ->delimiter(',')
      ->check(CLI::IsMember({"alpine", "canyon", "archipelago"}).description(""))
      ->type_name("NAME,...");
  evaluateCommand->add_option("--views", evaluate.views, "of the standing cameras: low, overview, grazing; left out: all of them")
      ->delimiter(',')
      ->check(CLI::IsMember({"low", "overview", "grazing"}).description(""))
      ->type_name("NAME,...");
  std::vector<std::string> refined;
  evaluateCommand
      ->add_option("--refined", refined,
                   "how the meshes are refined, as in area:0.3; left out: by pixels:1, pixels:0.5 and area:0.3 under standing cameras, in seven "
                   "ways along the flights")
      ->delimiter(',')
      ->type_name("METRIC:THRESHOLD,...");
  evaluateCommand->add_option("--only", evaluate.only, "views (standing cameras, settled meshes) or flights; left out: both")
      ->check(CLI::IsMember({"views", "flights"}).description(""))
      ->type_name("WHICH");
  evaluateCommand->add_option("--size", evaluateSize, "of the pictures, WIDTHxHEIGHT; left out: 1280x720, quick 480x270");
  evaluateCommand->add_option("--supersample", evaluate.supersample, "most samples a side of each pixel of the standing cameras, 1, 2, 4 or 8; left out: 4, quick 2")
      ->check(CLI::IsMember({1, 2, 4, 8}).description(""));
  evaluateCommand->add_option("--repeats", evaluate.repeats, "of what is timed; left out: 3, quick 1")->check(CLI::Range(1, 100).description(""));
  evaluateCommand->add_option("--seconds", evaluate.seconds, "only the beginning of each flight; left out: 20, the finest whole, quick 3")->check(within(0.0, 86400.0));
  evaluateCommand->add_flag("--report", evaluate.reportOnly, "measure nothing: report what is in the folder already, of an evaluation that goes on or was stopped");
  evaluateCommand->add_option("--server", evaluate.server, "the server's program; left out: ridgecast-server beside this one")
      ->type_name("FILE");

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
  if (!flies && !shoots && !viewCommand->parsed()) return wrongArguments("say what to do: view, fly, snapshot or evaluate; --help tells more");

  auto url = ridgecast::connection::parseUrl(server.url);
  if (!url) return wrongArguments(url.error().message);
  url->ca = server.ca;
  if (!server.tokenFile.empty()) {
    std::ifstream in(server.tokenFile);
    if (!(in >> url->token) || url->token.size() > 4096 ||
        !std::all_of(url->token.begin(), url->token.end(), [](char c) { return c > ' ' && c < 0x7f; }))
      return wrongArguments("--token-file: '" + server.tokenFile + "' holds no token, as 'ridgecast-server token' prints one");
  }
  server.settings.metric = ridgecast::settings::metricNamed(server.metric).value();
  if (const std::string wrong = parseSize(size, flies ? fly.width : shoots ? shot.width : view.width, flies ? fly.height : shoots ? shot.height : view.height);
      !wrong.empty())
    return wrongArguments(wrong);
  if (shoots) {
    shot.url = *url;
    return ridgecast::snapshot::snapshot(shot);
  }
  if (flies) {
    if (fly.exportAt && fly.exportFile.empty()) return wrongArguments("--export-at wants --export FILE.glb beside it");
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
