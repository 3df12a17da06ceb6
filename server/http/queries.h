#pragma once
// Queries over HTTP, for scripts and people:
//   GET /v1/heights?at=X,Z&at=X,Z            {"heights": [metres, ...]}
//   GET /v1/normals?at=X,Z&spacing=METRES    {"normals": [[x, y, z], ...]}
//   GET /v1/materials?at=X,Z                 {"materials": ["grass" or null, ...]}
//   GET /v1/rays?ray=X,Y,Z,DX,DY,DZ&reach=M  {"rays": [{"distance": metres, "at": [x, y, z]} or null, ...]}
// Places are in metres; on a map that says where it lies, &crs=lonlat takes longitudes and latitudes in degrees, and &crs=EPSG:N eastings
// and northings. A ray then has two coordinates, a height and a direction east, north and up, in metres of the world; its hit `at` has two
// coordinates and a height. Normals keep the world's axes. Places are rounded to the lattice's 1/256 m. &session=NAME selects a session
// (default `default`), and &terrain=NAME makes it, as a stream's URL does. Repeat `at` and `ray` as often as the header's limit allows, up
// to kMaxHttpPlaces and kMaxHttpRays. The numbers equal those of the socket's queries, digit for digit. The header Ridgecast-Edit names the
// last edit in the answer's ground; in a request, one that it must include.
//
// POST asks for up to kMaxPosted places or rays, by its Content-Type:
//   application/json            {"at": [[x, z], ...], "spacing": metres} or {"rays": [[x, y, z, dx, dy, dz], ...], "reach": metres},
//                               answered as GET is
//   application/octet-stream    little-endian doubles, two or six of each; answered by floats, one a height and three a normal; by
//                               bytes, materials (terrain/materials.h); or by doubles, distances (-1: none). spacing and reach stand in
//                               the URL
//
// Answers are made in turns of milliseconds, between which others run, and charge their heights to the client's Budgets::queries.

#include <cstddef>
#include <memory>

#include "server/directory/directory.h"
#include "server/http/routes.h"

namespace ridgecast::http {

inline constexpr std::size_t kMaxHttpPlaces = 1000, kMaxHttpRays = 64;
// The rays' heights are then at most about as many as the budget has in a second.
inline constexpr std::size_t kMaxPosted = 100'000;

Route queryRoute(std::shared_ptr<directory::Directory> directory);

}  // namespace ridgecast::http
