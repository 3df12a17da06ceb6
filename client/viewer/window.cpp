#include "client/viewer/window.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <cmath>
#include <string>
#include <tuple>

namespace ridgecast::viewer {
namespace {

std::string reason() {
  const char* text = nullptr;
  glfwGetError(&text);
  return text ? text : "no reason given";
}

}  // namespace

Outcome<std::unique_ptr<Window>> Window::open(std::uint32_t width, std::uint32_t height, bool vsync) {
  glfwSetErrorCallback(nullptr);
  auto window = std::unique_ptr<Window>(new Window);
  if (!glfwInit())
    return Error{"no window can be opened here (" + reason() + "): set DISPLAY, or use `ridgecast-client fly`, which needs no display"};
  window->started_ = true;
  glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
  glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
  glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
  glfwWindowHint(GLFW_OPENGL_FORWARD_COMPAT, GLFW_TRUE);
  glfwWindowHint(GLFW_SCALE_TO_MONITOR, GLFW_TRUE);
  glfwWindowHint(GLFW_VISIBLE, GLFW_FALSE);
  window->handle_ = glfwCreateWindow(static_cast<int>(width), static_cast<int>(height), "Ridgecast", nullptr, nullptr);
  if (!window->handle_)
    return Error{"this display offers no OpenGL 3.3 core (" + reason() +
                 "): install a newer graphics driver, or use `ridgecast-client fly`"};
  glfwMakeContextCurrent(window->handle_);
  window->setVsync(vsync);
  return window;
}

Window::~Window() {
  if (handle_) glfwDestroyWindow(handle_);
  if (started_) glfwTerminate();
}

void Window::show() { glfwShowWindow(handle_); }

std::pair<std::uint32_t, std::uint32_t> Window::size() const {
  int width = 0, height = 0, pixels = 0, ignored = 0;
  glfwGetFramebufferSize(handle_, &pixels, &ignored);
  glfwGetWindowSize(handle_, &width, &height);
  float x = 1, y = 1;
  // GLFW_SCALE_TO_MONITOR has made it larger only where a screen coordinate is a pixel.
  if (pixels == width) glfwGetWindowContentScale(handle_, &x, &y);
  if (glfwGetWindowMonitor(handle_)) std::tie(width, height) = std::pair(width_, height_);
  return {static_cast<std::uint32_t>(std::lround(static_cast<float>(width) / x)),
          static_cast<std::uint32_t>(std::lround(static_cast<float>(height) / y))};
}

void Window::setVsync(bool vsync) { glfwSwapInterval(vsync ? 1 : 0); }

void Window::toggleFullScreen() {
  if (glfwGetWindowMonitor(handle_)) {
    glfwSetWindowMonitor(handle_, nullptr, x_, y_, width_, height_, GLFW_DONT_CARE);
    return;
  }
  GLFWmonitor* monitor = glfwGetPrimaryMonitor();
  const GLFWvidmode* mode = monitor ? glfwGetVideoMode(monitor) : nullptr;
  if (!mode) return;
  glfwGetWindowPos(handle_, &x_, &y_);
  glfwGetWindowSize(handle_, &width_, &height_);
  glfwSetWindowMonitor(handle_, monitor, 0, 0, mode->width, mode->height, mode->refreshRate);
}

}  // namespace ridgecast::viewer
