#pragma once
// The window: fly over a server's terrain, the streamed mesh beside a local ray march of the same camera.

#include <filesystem>
#include <optional>
#include <string>

#include "client/connection/connection.h"
#include "common/camera/path.h"
#include "common/wire/messages.h"

namespace ridgecast::viewer {

struct ViewOptions {
  connection::Url url;
  wire::Settings settings;
  std::uint32_t width = 1280, height = 720;  // of the window at first, screen coordinates
  double x = 0, z = 0, altitude = 150;       // metres; where the flight begins, above the ground there
  double yaw = 0, pitch = -10;               // degrees
  std::optional<lattice::Point> at;          // where the flight begins, instead of x and z: exact however far out
  std::optional<camera::Path> path;          // followed from the beginning on
  bool vsync = true, invertY = false;
  bool reducedMotion = false;        // changes of the mesh show at once
  float textScale = 1;               // beside the screen's own
  bool remoteShaders = true;         // draw with a terrain's GLSL that the server sent; else neutrally, see drawingOf
  std::optional<double> seconds;     // close by itself after so long
  std::filesystem::path screenshot;  // empty: none; else a PNG of the window when it closes
};

// Returns the program's exit code: 0 closed by the user or after `seconds`, 1 no server, or closed without a connection, 3 no display or
// OpenGL, or the driver refuses what is to be drawn. A connection that ends is said in the window, which keeps drawing what it holds and tries to connect
// again. Errors go to stderr. Must run on the main thread.
int view(const ViewOptions& options);

}  // namespace ridgecast::viewer
