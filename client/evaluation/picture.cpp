#include "client/evaluation/picture.h"

#include <cstdio>
#include <cstdlib>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>
#include <utility>

#include "client/evaluation/fly.h"
#include "client/evaluation/own_server.h"
#include "client/evaluation/text_file.h"
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

}  // namespace

int picture(const PictureOptions& options) {
  const ScratchFolder scratch;
  const std::filesystem::path path = scratch.path() / "pose.json";
  const nlohmann::json pose{
      {"t", 0}, {"x", options.x}, {"z", options.z}, {"altitude", options.altitude}, {"yaw", options.yaw}, {"pitch", options.pitch}};
  if (scratch.path().empty() || !writeText(path, nlohmann::json{{"fov", options.fov}, {"keyframes", {pose}}}.dump()))
    return fail(kRuntimeFailure, {"cannot write to the folder for temporary files; choose another with TMPDIR"});
  FlyOptions flight;
  flight.url = options.url;
  std::unique_ptr<OwnServer> own;
  if (!options.server.empty()) {
    auto started = OwnServer::start(options.server, options.arguments, scratch.path());
    if (!started) return fail(kBadInput, started.error());
    own = std::move(*started);
    flight.url = connection::parseUrl("ws://127.0.0.1:" + std::to_string(own->port())).value();
  }
  flight.path = path;
  flight.out = scratch.path();
  flight.settings = options.settings;
  flight.width = options.width;
  flight.height = options.height;
  flight.remoteShaders = options.remoteShaders;
  flight.atRest = [&](const AtRest& at) -> Outcome<void> {
    auto drawn = draw(options, at);
    if (!drawn) return drawn.error();
    if (auto written = render::writePng(drawn->picture, options.out); !written) return written;
    std::fprintf(stderr, "%s: %llu triangles\n", options.out.c_str(), static_cast<unsigned long long>(at.scene.triangles()));
    return {};
  };
  return fly(flight);
}

}  // namespace ridgecast::evaluation
