#pragma once
// A world's text being compiled beside the window (render/warming.h), which shows the mesh in neutral colours meanwhile. Main thread only.

#include <atomic>
#include <chrono>
#include <string>
#include <thread>

#include "common/wire/messages.h"

struct GLFWwindow;

namespace ridgecast::viewer {

class Compiling {
 public:
  // The current context stays; the work has its own hidden window and thread. Without a second window nothing is compiled.
  explicit Compiling(const wire::World& world);
  ~Compiling();  // waits for the driver, which cannot be stopped: to end at once, end the process (abandon())
  Compiling(const Compiling&) = delete;

  bool done() const { return done_; }  // posts an event once it is
  // "compiling dunes's colours for the graphics driver, 12 s"
  std::string describe() const;
  // Ends the process with this exit code, whatever the driver does.
  [[noreturn]] static void abandon(int code);

 private:
  const wire::World world_;
  const std::chrono::steady_clock::time_point began_ = std::chrono::steady_clock::now();
  std::atomic<bool> done_ = false;
  GLFWwindow* window_ = nullptr;
  std::thread thread_;
};

}  // namespace ridgecast::viewer
