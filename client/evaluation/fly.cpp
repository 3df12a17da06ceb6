#include "client/evaluation/fly.h"

#include <cstdio>
#include <utility>

#include "client/evaluation/measurer.h"
#include "client/exit/exit.h"
#include "client/render/context.h"
#include "common/camera/path.h"

namespace ridgecast::evaluation {
int fly(const FlyOptions& options) {
  auto path = camera::readPath(options.path);
  if (!path) return fail(kBadInput, path.error());
  auto recorder = Recorder::create(options.out);
  if (!recorder) return fail(kBadInput, recorder.error());
  auto context = render::HeadlessContext::create();
  if (!context) return fail(kNoGraphics, context.error());

  wire::Hello hello;
  hello.clientName = "ridgecast-client fly";
  hello.settings = options.settings;
  hello.pacing = options.realtime ? wire::Pacing::kFree : wire::Pacing::kLockstep;
  auto client = replica::Client::open(options.url, hello, {.reconnects = options.realtime});
  if (!client) return fail(kRuntimeFailure, client.error());
  const wire::World& world = (*client)->world();
  auto drawing = render::drawingOf(world, options.remoteShaders);
  auto renderer = render::createOrNeutral(world, drawing, render::Renderer::create);
  if (!drawing.why.empty()) std::fprintf(stderr, "warning: %s\n", drawing.why.c_str());
  if (!path->terrain.empty() && (path->terrain != world.terrainName || path->seed != world.seed))
    std::fprintf(stderr, "warning: the path was made for terrain %s, seed %u; the server has %s, seed %u\n", path->terrain.c_str(),
                 path->seed, world.terrainName.c_str(), world.seed);
  if (!renderer) return fail(kNoGraphics, renderer.error());
  std::fprintf(stderr, "flying %s over %s (seed %u, horizon %.0f m), %ux%u, %s\n", options.path.filename().c_str(),
               world.terrainName.c_str(), world.seed, world.horizon, options.width, options.height, render::contextDescription().c_str());

  if (auto measured = measure(options, std::move(*path), **client, std::move(drawing), std::move(*renderer), std::move(*recorder));
      !measured)
    return fail(kRuntimeFailure, measured.error());
  std::fprintf(stderr, "figures in %s\n", (options.out / "summary.json").c_str());
  return kSuccess;
}

}  // namespace ridgecast::evaluation
