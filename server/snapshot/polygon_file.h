#pragma once
// A document of leaves as one polygon file, for programs that read no glTF. Units and origin are those of the .glb (common/gltf/glb.h), and
// so are the axes; with isZUp x is east, y north and z up, as programs for maps and CAD have them. A vertex that leaves share is written
// once. Equal documents give equal bytes. Pure functions; any thread.
//
//   PLY   binary, little-endian; positions are floats where those are exact (within 65 km of the file's origin), otherwise doubles;
//         nx ny nz; red green blue, sRGB
//   OBJ   text: v x y z, with sRGB red green blue in 0..1 behind; vn
// The metadata stand in comments, a line each.

#include <string>

#include "common/gltf/glb.h"
#include "common/outcome/outcome.h"

namespace ridgecast::snapshot {

// Error: more vertices than 32 bits count, or `stop` was requested.
Outcome<std::string> writePly(const gltf::Document& document, bool isZUp, const std::stop_token& stop);
Outcome<std::string> writeObj(const gltf::Document& document, bool isZUp, const std::stop_token& stop);

}  // namespace ridgecast::snapshot
