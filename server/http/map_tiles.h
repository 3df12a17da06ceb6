#pragma once
// Tiles of 256 x 256 pixels for map viewers (MapLibre, Leaflet, OpenLayers, QGIS), Web Mercator (server/map/mercator.h).
//
//   GET /v1/sessions/NAME/heights/Z/X/Y.png?at=LON,LAT     heights in the Terrarium encoding, to 1/256 m
//   GET /v1/sessions/NAME/colours/Z/X/Y.jpg?at=LON,LAT     the terrain's own colours, without light and shadow
//   GET /v1/sessions/NAME/heights/tiles.json, .../colours/tiles.json    TileJSON 3.0.0 of them
// at: where on Earth the world's x 0, z 0 lies, in degrees; latitude within 85; a map may say so itself. Z: 0 to 24. HEAD returns the same
// header. Tiles carry an ETag, and pages of any origin may read them. They need the right `query`.
//   400 invalid   404 no such session or tile   405 other method   422 a terrain without colours   429, 503 too busy

#include <memory>

#include "server/directory/directory.h"
#include "server/http/routes.h"

namespace ridgecast::http {

Route mapTileRoute(std::shared_ptr<directory::Directory> directory);

}  // namespace ridgecast::http
