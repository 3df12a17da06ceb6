// What a user would pick instead: the stream, whole leaves, 3D Tiles, Terrarium tiles, along the evaluation's flights over the same line.
//
//   ridgecast-bench doors [--seconds S] [--flights alpine,canyon,archipelago] [--doors stream,whole,tiles,draco,maplibre]
//                         [--lines free,narrow] [--detail D] [--plot FILE.svg]
//
// Each door has a server of its own behind a relay, stands at the flight's beginning until all is there, then flies, ten poses a second.
// Rays to the true ground, cast before, say where it is looked at: 40 x 22 a picture, one picture a second. Viewers of others run in
// Chromium (doors.ts) and say their heights there.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "client/core/mesh/follower.h"
#include "client/link/connection.h"
#include "common/camera/path.h"
#include "common/terrain/terrain.h"
#include "tests/bench/bench.h"
#include "tests/bench/panels.h"
#include "tests/support/rays.h"
#include "tests/support/relay.h"
#include "tests/support/server_process.h"

namespace ridgecast::bench {
namespace {

using namespace std::chrono_literals;
using testing_support::Hit;

constexpr double kRate = 10;      // poses a second
constexpr double kPatience = 60;  // seconds for the first picture
constexpr double kFine = 1.5;     // pixels: a first picture whose 99th percentile is below is one that one would keep

struct Door {
  std::string name;
  double detail;  // pixels: of error; of MapLibre: that a tile of 256 samples stands for
};
struct Way {
  std::string name;
  testing_support::Line line;
};

struct Plan {
  double seconds = 1e9;
  std::vector<std::string> flights{"alpine", "canyon", "archipelago"};
  // For 3D Tiles the detail at which the error is the stream's; for MapLibre the finest that it takes (each half is twice the bytes).
  std::vector<Door> doors{{"stream", 1}, {"whole", 1}, {"tiles", 2}, {"draco", 2}, {"maplibre", 64}};
  std::vector<Way> ways{{"free", {}}, {"narrow", {.delay = 25ms, .bytesPerSecond = 1'250'000}}};
  std::string plot;
};

// One look: where, and what is seen.
struct Look {
  double t;  // seconds of flight
  camera::Camera camera;
  std::vector<Hit> hits;  // empty: nobody looks
};

// Metres at the hits of a look; nothing where no ground is shown.
using Heights = std::vector<std::optional<double>>;
struct Seen {
  double t;
  Heights heights;
};
struct Shown {
  std::vector<Seen> first, flight;
  double began = 0;  // the flight, wallSeconds()
  std::size_t requests = 1;
};

double wallSeconds() { return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count(); }

// What came over a line, and when: viewers of others say afterwards when they flew.
class Meter {
 public:
  explicit Meter(const testing_support::Relay& relay)
      : thread_([this, &relay](const std::stop_token& stop) {
          for (; !stop.stop_requested(); std::this_thread::sleep_for(20ms))
            seen_.emplace_back(wallSeconds(), static_cast<double>(relay.bytesDown()) / 1e6);
        }) {}
  void stop() { thread_ = {}; }
  // Megabytes until then. After stop().
  double until(double seconds) const {
    const auto at = std::ranges::upper_bound(seen_, seconds, {}, [](const auto& one) { return one.first; });
    return at == seen_.begin() ? 0 : std::prev(at)->second;
  }

 private:
  std::vector<std::pair<double, double>> seen_;
  std::jthread thread_;
};

struct Picture {
  double p99 = NAN, most = NAN;  // pixels, where ground is shown
  std::size_t holes = 0;         // rays that meet ground, and none is shown
};
Picture judge(const std::vector<Hit>& hits, const Heights& heights) {
  Picture out;
  std::vector<double> pixels;
  for (std::size_t k = 0; k < hits.size(); ++k)
    if (heights[k])
      pixels.push_back(std::abs(*heights[k] - hits[k].y) * hits[k].pixels);
    else
      ++out.holes;
  out.p99 = percentile(pixels, 0.99);
  out.most = percentile(pixels, 1);
  return out;
}

std::vector<Look> looksOf(const std::string& flight, double most, std::string& terrainName) {
  const auto path = camera::readPath(RIDGECAST_PATHS "/" + flight + ".json");
  if (!path) throw std::runtime_error(path.error().message);
  terrainName = path->terrain;
  const auto terrain = terrain::create(path->terrain, path->seed).value();
  std::vector<Look> out;
  const double seconds = std::min(most, path->duration());
  for (int n = 0; n <= static_cast<int>(seconds * kRate); ++n) {
    Look look{n / kRate, {}, {}};
    look.camera.pose = camera::poseAt(*path, look.t, [&](lattice::Point p) { return terrain->height(p); });
    look.camera.projection.verticalFov = path->verticalFov;
    if (n % static_cast<int>(kRate) == 0) look.hits = testing_support::castRays(*terrain, look.camera, 40);
    out.push_back(std::move(look));
  }
  return out;
}

// ---- the stream ----

class Stream {
 public:
  Stream(const std::string& url, const Door& door) {
    wire::Hello hello;
    hello.clientName = "bench";
    hello.points = door.name == "stream";
    hello.settings.threshold = door.detail;
    auto opened = link::Connection::open(core::parseUrl(url).value(), hello, {.reconnects = false});
    if (!opened) throw std::runtime_error(opened.error().message);
    connection_ = std::move(*opened);
    follower_.follow({hello.points, false, connection_->world().settings.triangleBudget});
  }

  void look(const camera::Camera& camera) { connection_->send({++sequence_, camera, {}}), settled_ = false; }
  // Applies what comes until then.
  void until(double seconds, const Clock& clock) {
    for (double left; (left = seconds - clock.seconds()) > 0;) {
      const auto received = connection_->receive(std::chrono::milliseconds(static_cast<int>(1000 * left) + 1));
      if (!received) {
        if (connection_->error()) throw std::runtime_error(connection_->error()->message);
        return;
      }
      const auto answer = follower_.apply(received->iteration);
      if (answer.wrong) throw std::runtime_error(answer.wrong->message);
      connection_->acknowledge(answer.acknowledge);
      settled_ = received->iteration.settled && received->iteration.poseSequence == sequence_;
    }
  }
  bool settled() const { return settled_; }
  Heights heights(const std::vector<Hit>& hits) const {
    Heights out;
    for (const Hit& hit : hits) out.push_back(follower_.scene().height(hit.point));
    return out;
  }

 private:
  core::Follower follower_;
  std::unique_ptr<link::Connection> connection_;
  std::uint64_t sequence_ = 0;
  bool settled_ = false;
};

Shown flyStream(const testing_support::Relay& relay, const Door& door, const std::vector<Look>& looks) {
  Shown out;
  const Clock start;
  Stream stream(relay.url(), door);
  stream.look(looks[0].camera);
  for (int calm = 0; calm < 5 && start.seconds() < kPatience; calm = stream.settled() ? calm + 1 : 0) {
    stream.until(start.seconds() + 0.1, start);
    out.first.push_back({start.seconds(), stream.heights(looks[0].hits)});
  }
  out.began = wallSeconds();
  const Clock flight;
  for (const Look& look : looks) {
    stream.until(look.t, flight);
    if (!look.hits.empty()) out.flight.push_back({look.t, stream.heights(look.hits)});
    stream.look(look.camera);
  }
  return out;
}

// ---- viewers of others ----

Shown flyPage(const testing_support::Relay& relay, const Door& door, const std::vector<Look>& looks) {
  testing_support::ScratchFolder folder;
  nlohmann::json poses = nlohmann::json::array();
  for (const Look& look : looks) {
    const camera::Pose& pose = look.camera.pose;
    nlohmann::json one{{"t", look.t},     {"x", static_cast<double>(pose.x) * lattice::kMetresPerStep},
                       {"y", pose.y},     {"z", static_cast<double>(pose.z) * lattice::kMetresPerStep},
                       {"yaw", pose.yaw}, {"pitch", pose.pitch}};
    for (const Hit& hit : look.hits)
      one["places"].push_back(
          {static_cast<double>(hit.point.x) * lattice::kMetresPerStep, static_cast<double>(hit.point.z) * lattice::kMetresPerStep});
    poses.push_back(std::move(one));
  }
  const camera::Projection& projection = looks[0].camera.projection;
  std::ofstream(folder / "plan.json") << nlohmann::json{{"viewer", door.name == "maplibre" ? "maplibre" : "three"},
                                                        {"http", "http" + relay.url().substr(2)},
                                                        {"query", door.name == "draco" ? "compression=draco" : "compression=none"},
                                                        {"detail", door.detail},
                                                        {"fov", projection.verticalFov},
                                                        {"width", projection.width},
                                                        {"height", projection.height},
                                                        {"patience", kPatience},
                                                        {"poses", poses}};
  const std::string source = RIDGECAST_SOURCE;
  const auto done = testing_support::runProgram(
      {"node", source + "/client/web/run-tests.mjs", (folder / "built").string(), source + "/tests/bench/doors.ts"},
      {{"RIDGECAST_SOURCE", source}, {"DOORS_PLAN", (folder / "plan.json").string()}, {"DOORS_SHOWN", (folder / "shown.json").string()}},
      std::chrono::seconds(static_cast<int>(300 + looks.back().t)));
  const std::string text = testing_support::readText(folder / "shown.json");
  if (done.code != 0 || text.empty())
    throw std::runtime_error("the viewer did not fly (./run bench doors installs what it needs):\n" + done.output);
  const auto shown = nlohmann::json::parse(text);
  Shown out;
  out.began = shown["began"];
  out.requests = shown["requests"];
  const auto read = [&](const char* name, std::vector<Seen>& to) {
    for (const auto& seen : shown[name]) {
      Seen one{seen["t"], {}};
      for (const auto& height : seen["heights"]) one.heights.push_back(height.is_null() ? std::nullopt : std::optional<double>(height));
      to.push_back(std::move(one));
    }
  };
  read("first", out.first);
  read("flight", out.flight);
  return out;
}

// ---- a flight ----

struct Flown {
  double firstMegabytes = 0, megabytes = 0;  // of the first picture; on the way
  std::vector<double> received;              // MB since the beginning, each second of the way
  std::size_t requests = 0, holes = 0;       // `holes`: rays on the way
  double whole = NAN, fine = NAN;            // seconds until the first picture has no hole; until it is one that one would keep
  double atRest = NAN;                       // pixels, 99th percentile of the first picture at last
  std::vector<double> p99;                   // pixels, each second of the way
  double most = 0;
};

Flown fly(const Options& options, const Door& door, const Way& way, const std::string& terrain, const std::vector<Look>& looks) {
  testing_support::ServerProcess server(options.programFolder + "/ridgecast-server", {"--terrain", terrain});
  testing_support::Relay relay(server.port(), way.line);
  Flown out;
  const bool streams = door.name == "stream" || door.name == "whole";
  Meter meter(relay);
  const Shown shown = streams ? flyStream(relay, door, looks) : flyPage(relay, door, looks);
  meter.stop();
  out.firstMegabytes = meter.until(shown.began);
  out.megabytes = meter.until(shown.began + looks.back().t) - out.firstMegabytes;
  out.requests = shown.requests;
  for (const Seen& seen : shown.first) {
    const Picture picture = judge(looks[0].hits, seen.heights);
    if (picture.holes == 0 && std::isnan(out.whole)) out.whole = seen.t;
    if (picture.holes == 0 && picture.p99 <= kFine && std::isnan(out.fine)) out.fine = seen.t;
    out.atRest = picture.p99;
  }
  for (const Seen& seen : shown.flight) {
    const auto look = std::ranges::find(looks, seen.t, &Look::t);
    const Picture picture = judge(look->hits, seen.heights);
    out.p99.push_back(picture.p99);
    out.received.push_back(meter.until(shown.began + seen.t));
    out.holes += picture.holes;
    out.most = std::max(out.most, picture.most);
  }
  return out;
}

std::vector<std::string> split(const std::string& list) {
  std::vector<std::string> out;
  std::istringstream in(list);
  for (std::string part; std::getline(in, part, ',');) out.push_back(part);
  return out;
}

template <class T>
void keep(std::vector<T>& all, const std::string& list) {
  const auto names = split(list);
  for (const std::string& name : names)
    if (std::ranges::find(all, name, &T::name) == all.end()) throw std::runtime_error("there is no " + name);
  std::erase_if(all, [&](const T& one) { return std::ranges::find(names, one.name) == names.end(); });
}

Plan read(const Options& options) {
  Plan plan;
  if (options.quick) plan.seconds = 3, plan.flights = {"alpine"}, plan.ways.resize(1), plan.doors.resize(2);
  for (std::size_t k = 0; k < options.arguments.size(); k += 2) {
    const std::string& name = options.arguments[k];
    if (k + 1 == options.arguments.size()) throw std::runtime_error(name + " needs a value");
    const std::string& value = options.arguments[k + 1];
    if (name == "--seconds")
      plan.seconds = std::stod(value);
    else if (name == "--flights")
      plan.flights = split(value);
    else if (name == "--doors")
      keep(plan.doors, value);
    else if (name == "--lines")
      keep(plan.ways, value);
    else if (name == "--detail")
      for (Door& door : plan.doors) door.detail = std::stod(value);
    else if (name == "--plot")
      plan.plot = value;
    else
      throw std::runtime_error("doors takes --seconds, --flights, --doors, --lines, --detail and --plot, not " + name);
  }
  return plan;
}

}  // namespace

Report doors(const Options& options) {
  const Plan plan = read(options);
  Report report;
  report.note(
      "| flight | line | door | detail | first picture: MB | whole, s | fine, s | p99 px | on the way: kB/s | p99 px, median | worst | "
      "largest | rays without ground | requests |");
  report.note("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|");
  std::vector<double> seconds;
  Panel errors, bytes;
  errors.title = "error, 99th percentile, px";
  bytes.title = "MB received";
  errors.logarithmic = bytes.logarithmic = true;
  for (const std::string& flight : plan.flights) {
    std::string terrain;
    const std::vector<Look> looks = looksOf(flight, plan.seconds, terrain);
    for (const Way& way : plan.ways)
      for (const Door& door : plan.doors) {
        const Flown flown = fly(options, door, way, terrain, looks);
        const double rate = 1e3 * flown.megabytes / looks.back().t, worst = std::ranges::max(flown.p99);
        char line[300];
        std::snprintf(line, sizeof line, "| %s | %s | %s | %g | %.2f | %.1f | %.1f | %.2f | %.0f | %.2f | %.1f | %.0f | %zu | %zu |",
                      flight.c_str(), way.name.c_str(), door.name.c_str(), door.detail, flown.firstMegabytes, flown.whole, flown.fine,
                      flown.atRest, rate, median(flown.p99), worst, flown.most, flown.holes, flown.requests);
        report.note(line);
        progress(line);
        const std::string of = flight + "_" + way.name + "_" + door.name + "_";
        report.add(of + "first_mb", flown.firstMegabytes, "MB");
        report.add(of + "whole_s", flown.whole, "s");
        report.add(of + "fine_s", flown.fine, "s");
        report.add(of + "kb_per_second", rate, "kB/s");
        report.add(of + "p99_px", median(flown.p99), "px");
        report.add(of + "worst_p99_px", worst, "px");
        if (&flight != &plan.flights[0] || &way != &plan.ways.back()) continue;
        // The plot is of the first flight over the last line.
        Curve error{door.name, {}}, received{door.name, {}};
        seconds.clear();
        for (std::size_t k = 4; k < flown.p99.size(); k += 4) {
          seconds.push_back(static_cast<double>(k));
          error.y.push_back(flown.p99[k]);
          received.y.push_back(flown.received[k]);
        }
        errors.curves.push_back(std::move(error));
        bytes.curves.push_back(std::move(received));
      }
  }
  if (!plan.plot.empty())
    std::ofstream(plan.plot) << drawPanels(plan.flights[0] + ", line " + plan.ways.back().name + ": the same flight through each door",
                                           "seconds of flight", seconds, {errors, bytes});
  return report;
}

}  // namespace ridgecast::bench
