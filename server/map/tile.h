#pragma once
// A sheet as the file of a map tile. Pure functions; any thread. Empty: `stop` was requested or, of colours, the terrain has none in C++.

#include <stop_token>
#include <string>

#include "common/terrain/terrain.h"
#include "server/map/sheet.h"

namespace ridgecast::map {

std::string heightTile(const terrain::Terrain& terrain, const Sheet& sheet, const std::stop_token& stop = {});  // PNG, Terrarium
std::string colourTile(const terrain::Terrain& terrain, const Sheet& sheet, const std::stop_token& stop = {});  // JPEG

}  // namespace ridgecast::map
