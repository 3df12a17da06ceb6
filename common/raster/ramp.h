#pragma once
// Colours by height, as a picture on a height map: --drape ramp.txt. A text that gdaldem color-relief reads, too:
//
//   # height in metres, red, green, blue and perhaps alpha, 0 to 255
//   0    30 60 120
//   1500 90 140 60
//   3000 255 255 255
//
// By spaces, tabs, commas or colons. Between two heights the colours are mixed, beyond the last ones they stay; two lines of one height
// make a step. Colours are those of the file's heights; edits do not change them.

#include <filesystem>
#include <memory>

#include "common/outcome/outcome.h"
#include "common/raster/raster_file.h"
#include "common/raster/samples.h"

namespace ridgecast::raster {

bool isRamp(const std::filesystem::path& file);  // by its name

// A pixel for each sample, where it lies. `samples` outlive it. Error: the line that is wrong, and what would be right.
Outcome<std::unique_ptr<RasterFile>> openRamp(const std::filesystem::path& file, const Samples& samples, const RasterHeader& map);

}  // namespace ridgecast::raster
