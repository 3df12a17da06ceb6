#include "client/viewer/compiling.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <cstdio>
#include <cstdlib>

#include "client/render/warming.h"
#include "client/viewer/viewer_state.h"

namespace ridgecast::viewer {

Compiling::Compiling(const wire::World& world) : world_(world) {
  // The hints of Window::open() hold: the same kind of context, and hidden.
  window_ = glfwCreateWindow(16, 16, "Ridgecast compiles", nullptr, nullptr);
  if (!window_) {
    done_ = true;
    return;
  }
  thread_ = std::thread([this] {
    glfwMakeContextCurrent(window_);
    render::warm(world_);
    glfwMakeContextCurrent(nullptr);
    done_ = true;
    glfwPostEmptyEvent();
  });
}

Compiling::~Compiling() {
  if (thread_.joinable()) thread_.join();
  if (window_) glfwDestroyWindow(window_);
}

std::string Compiling::describe() const {
  return "compiling " + world_.terrainName + "'s colours for the graphics driver, " +
         std::to_string(static_cast<int>(secondsSince(began_))) + " s";
}

void Compiling::abandon(int code) {
  std::fflush(nullptr);
  std::_Exit(code);
}

}  // namespace ridgecast::viewer
