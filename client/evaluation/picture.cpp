#include "client/evaluation/picture.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <system_error>
#include <utility>

#include "client/evaluation/fly.h"
#include "client/evaluation/own_server.h"
#include "client/exit/exit.h"

namespace ridgecast::evaluation {

namespace {

// What a flight leaves behind; gone with its owner.
class ScratchFolder {
 public:
  ScratchFolder() {
    std::error_code failed;
    std::string name = (std::filesystem::temp_directory_path(failed) / "ridgecast-picture-XXXXXX").string();
    if (!failed && mkdtemp(name.data())) path_ = name;
  }
  ~ScratchFolder() {
    std::error_code ignored;
    if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }  // empty: it cannot be made

 private:
  std::filesystem::path path_;
};

Outcome<render::Renderer::Drawn> draw(const PictureOptions& options, const AtRest& at) {
  if (at.terrain && options.drawn == Drawn::kMarch) return at.renderer.drawMarch(at.view, options.supersample);
  if (at.terrain && options.drawn == Drawn::kCorrected) return at.renderer.drawCorrected(at.scene.leaves(), at.view, options.supersample);
  return at.renderer.drawMesh(at.scene.leaves(), at.view, options.supersample);
}

// A path that stays where it is.
camera::Path poseIn(const wire::World& world, const PictureOptions& options) {
  constexpr double kDegree = std::numbers::pi / 180;
  const auto steps = [](const std::optional<double>& metres) { return std::llround(metres.value_or(0) * lattice::kStepsPerMetre); };
  const lattice::Point asked{steps(options.x), steps(options.z)}, at = options.x || options.z ? asked : world.onMap(asked);
  camera::Path path;
  path.verticalFov = options.fov * kDegree;
  path.keyframes = {{.x = at.x, .z = at.z, .height = options.altitude, .yaw = options.yaw * kDegree, .pitch = options.pitch * kDegree}};
  return path;
}

}  // namespace

int picture(const PictureOptions& options) {
  const ScratchFolder scratch;
  if (scratch.path().empty()) return fail(kRuntimeFailure, {"cannot write to the folder for temporary files; choose another with TMPDIR"});
  FlyOptions flight;
  flight.url = options.url;
  std::unique_ptr<OwnServer> own;
  if (!options.server.empty()) {
    auto started = OwnServer::start(options.server, options.arguments, scratch.path());
    if (!started) return fail(kBadInput, started.error());
    own = std::move(*started);
    flight.url = core::parseUrl("ws://127.0.0.1:" + std::to_string(own->port())).value();
  }
  flight.out = scratch.path();
  flight.settings = options.settings;
  flight.width = options.width;
  flight.height = options.height;
  flight.remoteShaders = options.remoteShaders;
  flight.warm = false;  // one way of drawing is all that is wanted
  flight.atRest = [&](const AtRest& at) -> Outcome<void> {
    auto drawn = draw(options, at);
    if (!drawn) return drawn.error();
    if (auto written = render::writePng(drawn->picture, options.out); !written) return written;
    std::fprintf(stderr, "%s: %llu triangles\n", options.out.c_str(), static_cast<unsigned long long>(at.scene.triangles()));
    return {};
  };
  return fly(flight, [&](const wire::World& world) { return poseIn(world, options); });
}

}  // namespace ridgecast::evaluation
