#pragma once
// The window: fly over a server's terrain, the streamed mesh beside a local ray march of the same camera.

#include <filesystem>
#include <optional>
#include <string>

#include "client/link/connection.h"
#include "common/camera/path.h"
#include "common/wire/messages.h"

namespace ridgecast::viewer {

struct ViewOptions {
  core::Url url;
  wire::Settings settings;
  std::uint32_t width = 0, height = 0;               // of the window at first, screen coordinates; 0: as remembered
  std::optional<double> x, z, altitude, yaw, pitch;  // the start, metres and degrees; all null: the last place in this session
  std::optional<camera::Path> path;                  // followed from the start
  bool vsync = true, invertY = false;                // unless remembered otherwise
  bool reducedMotion = false;                        // changes of the mesh show at once
  std::optional<double> textScale;                   // relative to the screen's own; null: as remembered
  std::string name;                                  // the user's, for the others; empty: as remembered, at first a guest's
  bool fresh = false;                                // neither uses nor changes what is remembered (remembered.h)
  bool remoteShaders = true;                         // draw with GLSL sent by the server; otherwise neutrally, see drawingOf
  std::optional<double> seconds;                     // close after this time
  std::filesystem::path screenshot;                  // a PNG of the window when it closes; empty: none
};

// Returns the exit code: 0 closed by the user or after `seconds`; 1 no server, or closed without a connection; 3 no display or OpenGL, or
// the driver rejects a shader. If a connection ends, the window says so, keeps drawing what it holds and reconnects. Errors go to stderr.
// Must run on the main thread.
int view(const ViewOptions& options);

}  // namespace ridgecast::viewer
