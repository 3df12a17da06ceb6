#pragma once
// Parts of the metadata (snapshot.h) that files and tilesets share.

#include <nlohmann/json_fwd.hpp>

#include "common/lattice/lattice.h"
#include "server/session/session.h"

namespace ridgecast::snapshot {

nlohmann::json describeBox(lattice::Point low, lattice::Point high);  // a box

// Adds the session's and its terrain's part; `origin` is the file's. What is private stays so: parameters stand in the terrain's text.
void describeWorld(const session::Session& session, const editing::Ground& ground, lattice::Point origin, nlohmann::json& extras);

}  // namespace ridgecast::snapshot
