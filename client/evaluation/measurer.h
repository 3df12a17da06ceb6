#pragma once
// What `fly` measures on a flight: every iteration, pictures of the mesh against a ray march of the same camera, and at rest what is asked for.

#include "client/evaluation/fly.h"
#include "client/evaluation/recorder.h"
#include "client/render/local_terrain.h"
#include "client/render/renderer.h"
#include "client/replica/client.h"
#include "common/camera/path.h"

namespace ridgecast::evaluation {

// Flies, waits until nothing more is refined, and leaves all files. Errors: the flight's, a driver's, a file's.
Outcome<void> measure(const FlyOptions& options, camera::Path path, replica::Client& client, render::Drawing drawing,
                      render::Renderer renderer, Recorder recorder);

}  // namespace ridgecast::evaluation
