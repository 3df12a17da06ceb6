#pragma once
// Flies a camera path without a window against a running server, and compares the mesh held with a ray march of the same camera. In
// lock-step a lost connection ends the flight with an error: results before and after a gap would not belong to one flight. By the clock
// the flight continues with what is held, and with the server once it is back, even with another world.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>

#include "client/evaluation/recorder.h"
#include "client/evaluation/views.h"
#include "client/flight/flight.h"
#include "client/link/connection.h"
#include "common/camera/path.h"
#include "common/wire/messages.h"

namespace ridgecast::evaluation {

struct FlyOptions : flight::Options {
  core::Url url;
  std::filesystem::path path;  // a path file, see common/camera/path.h
  std::filesystem::path out;   // a folder, made when missing
  wire::Settings settings;
  std::optional<double> framesEvery;  // seconds of path time between pictures; nothing: six in all
  std::uint32_t supersample = 1;      // N x N samples a pixel
  std::filesystem::path exportFile;   // empty: no export
  std::optional<double> exportAt;     // seconds of path time; nothing: at the end, once settled
  bool remoteShaders = true;          // draw with a terrain's GLSL that the server sent; else neutrally, see drawingOf
  bool corrected = false;             // also draw and compare the corrected mesh (render/correction_pass.h)
  bool unfiltered = false;            // also compare without filtering
  bool measureFrames = false;         // lock-step: upload and draw every iteration, a quarter of the size
  bool measurePopping = false;        // lock-step: from frame to frame while the mesh refines at the end of the path (popping.h)
  bool warm = true;                   // shaders are compiled before the flight, whether drawn with or not
  bool pictures = true;               // false: none, the flight is measured for its times
  References* references = nullptr;   // ray marches of other flights over this terrain; null: of this flight's last picture
  std::function<Outcome<void>(const AtRest&)> atRest;  // in place of all pictures: called at the end
};

// Progress and errors, one sentence each, go to stderr; returns an exit code (exit.h). Lock-step: one pose, one iteration, pictures in
// between, so that the same flight gives the same pictures on any machine. At the end the last pose is repeated until the mesh has settled.
// Every iteration's hash is compared with the mesh held; if they differ, all leaves are requested again.
int fly(const FlyOptions& options);
// The same along a path that depends on the world.
int fly(const FlyOptions& options, const std::function<camera::Path(const wire::World&)>& pathOver);

}  // namespace ridgecast::evaluation
