#pragma once
// Operations as JSON, as they travel. Lengths are metres; a step is 2^-8 m, so what is written out comes back as the same steps. One text
// form serves the stream, HTTP, export and every language that can read JSON; logs and recordings have packed.h's.
//
//   {"op": "raise", "x": 10, "z": -4, "radius": 5, "core": 2, "by": 1.5}            "lower" likewise
//   {"op": "crater", "x": 0, "z": 0, "radius": 12, "depth": 4}
//   {"op": "level", "x": 0, "z": 0, "radius": 20, "height": 310, "slope": 0.5}      or "polygon": [[x, z], ...] instead of x, z, radius
//   {"op": "smooth", "x": 0, "z": 0, "radius": 8, "passes": 4}
//   {"op": "road", "line": [[x, z], ...], "width": 6, "grade": 0.1, "slope": 0.5}   or [[x, z, height], ...]
//   {"op": "stamp", "x": 0, "z": 0, "spacing": 0.5, "columns": 3, "samples": [0, 0.5, 0, ...]}
//   {"op": "undo", "edit": 17}
// A place may be "at": [x, z] instead of "x" and "z". With "crs", which fromJson() takes where its caller can place it, every place is one
// of that CRS: "at": [longitude, latitude], "polygon" and "line" likewise. Lengths stay metres of the world.
// All but undo may have a "material": "earth", "rock", "gravel", "sand", "grass", "asphalt", "concrete" or "snow". Left out: core 0,
// slope 1 (of a road 0.667), passes 4, grade 0.1, spacing 0.5.

#include <array>
#include <functional>
#include <string>
#include <string_view>

#include "common/edits/operation.h"
#include "common/outcome/outcome.h"

namespace ridgecast::edits {

// One line.
std::string toJson(const Operation& operation);
// From two coordinates of a CRS to x and z, metres of the world. Error: one sentence.
using ToWorld = std::function<Outcome<std::array<double, 2>>(const std::string& crs, double first, double second)>;

// Error: one sentence that names the field. The operation is checked (check()).
Outcome<Operation> fromJson(std::string_view text, const ToWorld& toWorld = {});

}  // namespace ridgecast::edits
