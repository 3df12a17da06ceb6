#pragma once
// The server's terrain as a function on this machine: for heights above ground, and for how high the ray march must look.

#include <memory>

#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"

namespace ridgecast::render {

// Error: this client has no terrain of that name, or another version of it (the content hashes differ).
Outcome<std::shared_ptr<const terrain::Terrain>> localTerrain(const wire::World& world);

}  // namespace ridgecast::render
