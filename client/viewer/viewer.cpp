#include "client/viewer/viewer.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>
#include <thread>
#include <utility>

#include "client/render/context.h"
#include "client/scene/exchange_tiles.h"
#include "client/viewer/flight.h"
#include "client/viewer/window.h"

namespace ridgecast::viewer {
namespace {

using Clock = std::chrono::steady_clock;

int fail(int code, const std::string& message) {
  std::fprintf(stderr, "ridgecast-client: %s\n", message.c_str());
  return code;
}

// The heights around the place where a flight begins; gives up after five seconds, they come later then.
Outcome<void> fetchGround(Link& link, scene::HeightWindow& window, lattice::Point at) {
  window.moveTo(at);
  for (const auto began = Clock::now(); !window.complete() && Clock::now() - began < std::chrono::seconds(5);) {
    if (auto exchanged = scene::exchangeTiles(*link.connection, window); !exchanged) return exchanged.error();
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return {};
}

}  // namespace

int view(const ViewOptions& given) {
  ViewOptions options = given;
  const auto began = Clock::now();
  if (!options.at)
    options.at = lattice::Point{std::llround(options.x * lattice::kStepsPerMetre), std::llround(options.z * lattice::kStepsPerMetre)};
  auto window = Window::open(options.width, options.height, options.vsync);
  if (!window) return fail(3, window.error().message);
  auto link = Link::open(options.url, options.settings);
  if (!link) return fail(1, link.error().message);
  for (Flight::Kept kept;;) {
    const wire::World& world = link->connection->world();
    auto drawing = render::drawingOf(world, options.remoteShaders);
    auto passes = render::createOrNeutral(world, drawing, Passes::create);
    if (!drawing.why.empty()) std::fprintf(stderr, "warning: %s\n", drawing.why.c_str());
    if (!passes) return fail(3, passes.error().message);
    std::fprintf(stderr, "viewing %s, seed %u, %s; F1 help\n", world.terrainName.c_str(), world.seed, render::contextDescription().c_str());
    if (drawing.window)
      if (auto fetched = fetchGround(*link, *drawing.window, *options.at); !fetched) return fail(1, fetched.error().message);
    Flight flight(options, **window, std::move(*link), std::move(drawing), std::move(*passes), std::move(kept));
    Flight::Ending ending = flight.run(began);
    if (!ending.next) return ending.code;
    link = std::move(*ending.next);
    kept = std::move(ending.kept);
    options.at = lattice::Point{ending.pose.x, ending.pose.z};
    options.altitude = std::max(2.0, ending.aboveGround);
    options.yaw = ending.pose.yaw * 180 / std::numbers::pi;
    options.pitch = ending.pose.pitch * 180 / std::numbers::pi;
    options.path.reset();
  }
}

}  // namespace ridgecast::viewer
