#pragma once
// Starts and ends GLFW; the one window.

#include <cstdint>
#include <memory>
#include <utility>

#include "common/outcome/outcome.h"

struct GLFWwindow;

namespace ridgecast::viewer {

class Window {
 public:
  // Makes its context current; the window stays hidden until show(). `width` and `height` in screen coordinates. Errors: no display, no
  // OpenGL 3.3 core; each says what to do.
  static Outcome<std::unique_ptr<Window>> open(std::uint32_t width, std::uint32_t height, bool vsync);
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  GLFWwindow* handle() const { return handle_; }
  void show();
  // As open() takes it; while the screen is filled, the size to come back to.
  std::pair<std::uint32_t, std::uint32_t> size() const;
  void setVsync(bool vsync);  // whether frames wait for the screen's refresh
  // Full screen, or a window again.
  void toggleFullScreen();

 private:
  Window() = default;
  GLFWwindow* handle_ = nullptr;
  bool started_ = false;
  int x_ = 0, y_ = 0, width_ = 0, height_ = 0;  // of the window, while it is full screen
};

}  // namespace ridgecast::viewer
