#include "client/viewer/viewer.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <epoxy/gl.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <list>
#include <numbers>
#include <string>
#include <thread>
#include <utility>

#include "client/exit/exit.h"
#include "client/render/context.h"
#include "client/viewer/compiling.h"
#include "client/viewer/people.h"
#include "client/viewer/window.h"
#include "client/viewer/world_window.h"

namespace ridgecast::viewer {
namespace {

using Clock = std::chrono::steady_clock;
constexpr double kMoment = 0.7;  // seconds: shorter waits are not reported

// Fetches the heights around the start. Gives up after five seconds; they arrive later then.
Outcome<void> fetchGround(Link& link, scene::HeightWindow& window, lattice::Point at) {
  window.moveTo(at);
  for (const auto began = Clock::now(); !window.complete() && Clock::now() - began < std::chrono::seconds(5);) {
    if (auto exchanged = link.client->exchangeTiles(window); !exchanged) return exchanged.error();
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return {};
}

// Opens the connection. Shows in the window what it waits for, if that takes more than a moment. Empty if the window was closed meanwhile
// or the time is over.
std::optional<Outcome<Link>> arrive(const ViewOptions& options, Window& window, Clock::time_point began) {
  Arrival arrival(options.url, options.settings, ownName(options.name));
  std::optional<Overlay> overlay;
  int told = 0;
  GLFWwindow* const handle = window.handle();
  for (;;) {
    if (auto link = arrival.take()) return link;
    if (glfwWindowShouldClose(handle) || (options.seconds && Clock::now() - began > std::chrono::duration<double>(*options.seconds)))
      return std::nullopt;
    if (!overlay && arrival.seconds() > kMoment) {
      glfwSetKeyCallback(handle, [](GLFWwindow* w, int key, int, int action, int with) {
        if ((key == GLFW_KEY_ESCAPE || (key == GLFW_KEY_Q && (with & GLFW_MOD_CONTROL))) && action == GLFW_PRESS)
          glfwSetWindowShouldClose(w, GLFW_TRUE);
      });
      window.show();
      overlay.emplace(handle, options.textScale);
    }
    if (overlay) {
      if (const int news = arrival.prepares() ? 2 : 1; std::exchange(told, news) != news)
        std::fprintf(stderr, "%s; Esc gives up\n", arrival.describe().c_str());
      int width = 0, height = 0;
      glfwGetFramebufferSize(handle, &width, &height);
      glViewport(0, 0, width, height);
      glClearColor(0.09f, 0.11f, 0.14f, 1);
      glClear(GL_COLOR_BUFFER_BIT);
      overlay->drawMessageAlone(arrival.describe() + "\nEsc gives up");
      glfwSwapBuffers(handle);
    }
    glfwWaitEventsTimeout(overlay ? 0.1 : 0.005);
  }
}

}  // namespace

int view(const ViewOptions& given) {
  ViewOptions options = given;
  const auto began = Clock::now();
  if (!options.at)
    options.at = lattice::Point{std::llround(options.x * lattice::kStepsPerMetre), std::llround(options.z * lattice::kStepsPerMetre)};
  auto window = Window::open(options.width, options.height, options.vsync);
  if (!window) return fail(kNoGraphics, window.error());
  auto arrived = arrive(options, **window, began);
  if (!arrived)
    return fail(kRuntimeFailure, {"closed before the server at " + options.url.host + ":" + options.url.port + " had answered"});
  auto link = std::move(*arrived);
  if (!link) return fail(kRuntimeFailure, link.error());
  ViewerState state;
  state.smooth = !options.reducedMotion;
  state.panel.invertY = options.invertY;
  state.panel.vsync = options.vsync;
  state.panel.textScale = options.textScale;
  std::snprintf(state.panel.name.data(), state.panel.name.size(), "%s", options.name.c_str());
  std::list<Compiling> compiled;  // also for worlds that were left: the driver cannot be stopped
  for (;; state.leaveWorld()) {
    const wire::World& world = link->client->world();
    Compiling* const compiling = render::compilesForeignText(world, options.remoteShaders) ? &compiled.emplace_back(world) : nullptr;
    auto drawing = compiling ? render::neutralDrawing(world, "the graphics driver compiles " + world.terrainName)
                             : render::drawingOf(world, options.remoteShaders);
    auto passes = render::createOrNeutral(world, drawing, Passes::create);
    if (!drawing.why.empty()) std::fprintf(stderr, "%s%s\n", compiling ? "" : "warning: ", drawing.why.c_str());
    if (!passes) return fail(kNoGraphics, passes.error());
    std::fprintf(stderr, "viewing %s, seed %u, %s; H lists the keys\n", world.terrainName.c_str(), world.seed,
                 render::contextDescription().c_str());
    if (drawing.window)
      if (auto fetched = fetchGround(*link, *drawing.window, *options.at); !fetched) return fail(kRuntimeFailure, fetched.error());
    WorldWindow::Ending ending = [&] {
      WorldWindow inside(options, **window, std::move(*link), drawing, std::move(*passes), state, compiling);
      return inside.run(began);
    }();
    if (!ending.next) {
      if (!std::ranges::all_of(compiled, &Compiling::done)) Compiling::abandon(ending.code);
      return ending.code;
    }
    link = std::move(*ending.next);
    options.at = lattice::Point{ending.pose.x, ending.pose.z};
    options.altitude = std::max(2.0, ending.aboveGround);
    options.yaw = ending.pose.yaw * 180 / std::numbers::pi;
    options.pitch = ending.pose.pitch * 180 / std::numbers::pi;
    options.path.reset();
  }
}

}  // namespace ridgecast::viewer
