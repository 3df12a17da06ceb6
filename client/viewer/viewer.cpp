#include "client/viewer/viewer.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <epoxy/gl.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <list>
#include <string>
#include <tuple>
#include <utility>

#include "client/exit/exit.h"
#include "client/render/context.h"
#include "client/viewer/compiling.h"
#include "client/viewer/people.h"
#include "client/viewer/remembered.h"
#include "client/viewer/theme.h"
#include "client/viewer/window.h"
#include "client/viewer/world_window.h"

namespace ridgecast::viewer {
namespace {

using Clock = std::chrono::steady_clock;
constexpr double kMoment = 0.7;  // seconds: shorter waits are not reported

// Opens the connection. Shows in the window what it waits for, if that takes more than a moment. Empty if the window was closed meanwhile
// or the time is over.
std::optional<Outcome<Link>> arrive(const ViewOptions& options, const ViewerState& state, Window& window, Clock::time_point began) {
  Arrival arrival(options.url, options.settings, ownName(state.panel.name.data()));
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
      overlay.emplace(handle, state.panel.textScale);
    }
    if (overlay) {
      if (const int news = arrival.prepares() ? 2 : 1; std::exchange(told, news) != news)
        std::fprintf(stderr, "%s; Esc gives up\n", arrival.describe().c_str());
      int width = 0, height = 0;
      glfwGetFramebufferSize(handle, &width, &height);
      glViewport(0, 0, width, height);
      const auto share = [](int shift) { return static_cast<float>(theme::kGround.rgb >> shift & 0xff) / 255; };
      glClearColor(share(16), share(8), share(0), 1);
      glClear(GL_COLOR_BUFFER_BIT);
      overlay->drawMessageAlone(arrival.describe() + "\nEsc gives up");
      glfwSwapBuffers(handle);
    }
    glfwWaitEventsTimeout(overlay ? 0.1 : 0.005);
  }
}

// What the command line says wins over what is remembered.
Remembered recall(const ViewOptions& options, const std::optional<std::filesystem::path>& file) {
  Remembered out;
  if (file) {
    auto read = readRemembered(*file);
    if (read)
      out = std::move(*read);
    else
      std::fprintf(stderr, "warning: %s\n", read.error().message.c_str());
  }
  if (options.width > 0) std::tie(out.width, out.height) = std::pair(options.width, options.height);
  out.textScale = options.textScale.value_or(out.textScale);
  if (!options.vsync) out.vsync = false;
  if (options.invertY) out.invertY = true;
  if (options.reducedMotion) out.smooth = false;
  if (!options.name.empty()) out.name = options.name.substr(0, 32);
  return out;
}

void show(const Remembered& remembered, ViewerState& state) {
  state.mode = remembered.mode;
  state.divider = remembered.divider;
  state.figures = remembered.figures;
  state.plots = remembered.plots;
  state.smooth = remembered.smooth;
  state.lines.wireframe = remembered.wireframe;
  state.lines.borders = remembered.borders;
  state.panel.invertY = remembered.invertY;
  state.panel.vsync = remembered.vsync;
  state.panel.members = remembered.members;
  state.panel.textScale = static_cast<float>(remembered.textScale);
  std::snprintf(state.panel.name.data(), state.panel.name.size(), "%s", remembered.name.c_str());
}

// What show() would show again, and the place left.
Remembered toRemember(const Remembered& before, const ViewerState& state, const Window& window, const WorldWindow::Ending& ending) {
  Remembered out;
  std::tie(out.width, out.height) = window.size();
  out.speed = ending.place.speed;
  out.mode = state.mode;
  out.divider = state.divider;
  out.figures = state.figures;
  out.plots = state.plots;
  out.smooth = state.smooth;
  out.wireframe = state.lines.wireframe;
  out.borders = state.lines.borders;
  out.invertY = state.panel.invertY;
  out.vsync = state.panel.vsync;
  out.members = state.panel.members;
  out.textScale = static_cast<double>(state.panel.textScale) == static_cast<double>(static_cast<float>(before.textScale))
                      ? before.textScale
                      : std::round(static_cast<double>(state.panel.textScale) * 100) / 100;
  out.name = state.panel.name.data();
  out.visit({ending.where, ending.place.at, ending.place.altitude, ending.place.yaw, ending.place.pitch});
  return out;
}

Start startOf(const ViewOptions& options, const Remembered& remembered) {
  const bool given = options.x || options.z || options.altitude || options.yaw || options.pitch || options.path;
  const Remembered::Place* const last = remembered.placeAt(sessionAt(options.url));
  if (last && !given) return {last->at, last->altitude, last->yaw, last->pitch, remembered.speed};
  const auto steps = [](const std::optional<double>& metres) { return std::llround(metres.value_or(0) * lattice::kStepsPerMetre); };
  return {{steps(options.x), steps(options.z)},
          options.altitude.value_or(150),
          options.yaw.value_or(0),
          options.pitch.value_or(-10),
          remembered.speed};
}

}  // namespace

int view(const ViewOptions& given) {
  ViewOptions options = given;
  const auto began = Clock::now();
  const auto file = options.fresh ? std::nullopt : rememberedFile();
  const Remembered first = recall(options, file);
  Start start = startOf(options, first);
  ViewerState state;
  show(first, state);
  auto window = Window::open(first.width, first.height, first.vsync);
  if (!window) return fail(kNoGraphics, window.error());
  auto arrived = arrive(options, state, **window, began);
  if (!arrived)
    return fail(kRuntimeFailure, {"closed before the server at " + options.url.host + ":" + options.url.port + " had answered"});
  auto link = std::move(*arrived);
  if (!link) return fail(kRuntimeFailure, link.error());
  std::list<Compiling> compiled;  // for worlds that were left, too, until they are done: the driver cannot be stopped
  std::string session;
  bool isAsked = options.x || options.z || start.at != lattice::Point{};
  for (;; state.leaveWorld()) {
    const wire::World& world = link->client->world();
    if (std::exchange(session, world.session) != world.session && !std::exchange(isAsked, false)) start.at = world.onMap(start.at);
    std::erase_if(compiled, std::mem_fn(&Compiling::done));
    const Compiling* const compiling = render::compilesText(world, options.remoteShaders) ? &compiled.emplace_back(world) : nullptr;
    auto drawing = compiling ? render::drawingMeanwhile(world) : render::drawingOf(world, options.remoteShaders);
    auto passes = render::createOrNeutral(world, drawing, Passes::create);
    if (!drawing.why.empty()) std::fprintf(stderr, "%s%s\n", compiling ? "" : "warning: ", drawing.why.c_str());
    if (!passes) return fail(kNoGraphics, passes.error());
    std::fprintf(stderr, "viewing %s, seed %u, %s; H lists the keys\n", world.terrainName.c_str(), world.seed,
                 render::contextDescription().c_str());
    WorldWindow::Ending ending = [&] {
      WorldWindow inside(options, start, **window, std::move(*link), drawing, std::move(*passes), state, compiling);
      return inside.run(began);
    }();
    if (file) {
      const auto kept = keepChanges(*file, first, toRemember(first, state, **window, ending));
      if (!kept) std::fprintf(stderr, "warning: %s\n", kept.error().message.c_str());
    }
    if (!ending.next) {
      if (!std::ranges::all_of(compiled, &Compiling::done)) Compiling::abandon(ending.code);
      return ending.code;
    }
    link = std::move(*ending.next);
    start = ending.place;
    options.path.reset();
  }
}

}  // namespace ridgecast::viewer
