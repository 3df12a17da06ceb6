#pragma once
// ridgecast-server snapshot FILE|FOLDER/ QUERY [settings]: a snapshot without a server, of the terrain that the settings name. It listens
// nowhere and ends when all is written. ridgecast-client snapshot --terrain becomes it.
//
// FILE ends in .glb, .ply, .obj, .tif, .pmtiles, or .json (only the metadata). FOLDER/, with the slash, becomes a box's 3D Tiles
// (server/snapshot/tiles.h); it is made where there is none, and refused if there is anything in it. tileset.json comes last: without it a
// folder is unfinished.
// QUERY is what stands behind the ? of a snapshot's URL (server/snapshot/question.h), without camera=. Boxes may be 1,000 km wide and take
// a day; triangles have the server's limit. Progress goes to standard error: on a terminal one line that changes, otherwise a line for each
// stage and every ten seconds.

namespace ridgecast {

// argv[0] is "snapshot". The exit status: 0; 1 after a failure, 2 after bad input, with one sentence on standard error.
int runSnapshotCommand(int argc, const char* const* argv, const char* const* environment);

}  // namespace ridgecast
