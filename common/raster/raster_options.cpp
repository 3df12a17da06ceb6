#include "common/raster/raster_options.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "common/terrain/materials.h"
#include "common/terrain/raster.h"
#include "common/terrain/terrain.h"
#include "common/text/text.h"

namespace ridgecast::raster {
namespace {

std::optional<std::uint32_t> count(std::string_view text) {
  const auto v = text::number<std::uint32_t>(text);
  return v && *v >= 2 ? v : std::nullopt;
}

std::string builtInNames() {
  std::string out;
  for (const terrain::Description& d : terrain::builtIn()) out.append(out.empty() ? "" : ", ").append(d.name);
  return out;
}

bool isHeight(double v) { return std::abs(v) <= terrain::kMaxSample * lattice::kMetresPerStep; }

}  // namespace

Outcome<void> addRasterOption(std::string_view assignment, RasterOptions& o) {
  std::string_view value = assignment;
  const std::string_view name = text::takePart(value, '=');
  const auto wrong = [&](const std::string& right) { return Error{"--raster " + std::string(assignment.substr(0, 64)) + ": " + right}; };
  if (name == "pitch") {
    constexpr double kMin = terrain::kMinPitch / terrain::kPartsPerMetre, kMax = terrain::kMaxPitch / terrain::kPartsPerMetre;
    const auto v = text::number<double>(value);
    if (!v || *v < kMin || *v > kMax) return wrong("pitch is the distance between samples, 0.0625 to 1024 metres");
    o.pitch = *v;
  } else if (name == "scale" || name == "offset") {
    const auto v = text::number<double>(value);
    if (!v || std::abs(*v) > 1e9 || (name == "scale" && *v == 0)) return wrong("it must be a finite number, and scale must not be 0");
    (name == "scale" ? o.scale : o.offset) = *v;
  } else if (name == "edge") {
    if (value == "clamp")
      o.edge = Edge::kClamp;
    else if (value == "mirror")
      o.edge = Edge::kMirror;
    else if (value == "repeat")
      o.edge = Edge::kRepeat;
    else if (const auto v = text::number<double>(value); v && isHeight(*v))
      o.edge = Edge::kConstant, o.constant = *v;
    else
      return wrong("edge is clamp, mirror, repeat or a height in metres: how the ground continues beyond the map");
  } else if (name == "missing") {
    const auto v = text::number<double>(value);
    if (!v) return wrong("missing is the value of samples that are missing, a number");
    o.missing = v;
  } else if (name == "nodata") {
    const auto v = text::number<double>(value);
    if (value != "fill" && (!v || !isHeight(*v)))
      return wrong("nodata is a height in metres for missing samples, or fill: from their neighbours");
    o.fill = value == "fill";
    o.noData = v;
  } else if (name == "project" && value == "local") {
    o.project = true;
  } else if (name == "size") {
    const auto w = count(text::takePart(value, 'x')), h = count(value);
    if (!w || !h) return wrong("size is COLUMNSxROWS of a raw file, at least 2x2");
    o.width = *w;
    o.height = *h;
  } else if (name == "order" && (value == "little" || value == "big")) {
    o.bigEndian = value == "big";
  } else if (name == "type" && (value == "unsigned" || value == "signed")) {
    o.isSigned = value == "signed";
  } else if (name == "detail") {
    Detail detail;
    detail.terrain = text::takePart(value, ':');
    const auto factor = text::number<double>(text::takePart(value, ':'));
    const auto parts = value.empty() ? std::optional<std::uint32_t>(0) : count(value);
    const auto isBuiltIn = std::ranges::any_of(terrain::builtIn(), [&](const terrain::Description& d) { return d.name == detail.terrain; });
    if (!isBuiltIn || !factor || !(*factor > 0 && *factor <= 4) || !parts || *parts > 64)
      return wrong("detail is TERRAIN:FACTOR or TERRAIN:FACTOR:PARTS, such as alpine:0.2:8: " + builtInNames() +
                   ", a factor above 0 and up to 4, and 2 to 64 samples in the place of one");
    detail.factor = *factor;
    detail.parts = *parts;
    o.detail = detail;
  } else if (name == "class") {
    const auto number = text::number<std::int32_t>(text::takePart(value, ':'));
    const auto isOwn = [](const NamedClass& n) { return terrain::materialNumber(n.material) == 0; };
    if (!number || !terrain::isMaterialName(value))
      return wrong(
          "class is VALUE:NAME, what a value of --classes stands for, such as 10:forest: a whole number, and 1 to 32 of a-z 0-9 _ -");
    if (std::ranges::find(o.named, *number, &NamedClass::value) != o.named.end())
      return wrong("this value has a name already: leave one of them out");
    o.named.push_back({*number, std::string(value)});
    if (std::set<std::string> names; std::ranges::count_if(o.named, [&](const NamedClass& n) {
                                       return isOwn(n) && names.insert(n.material).second;
                                     }) > static_cast<std::ptrdiff_t>(terrain::kMaxOwnMaterials))
      return wrong("at most " + std::to_string(terrain::kMaxOwnMaterials) + " names: give several values one name");
  } else if (name == "place" && (value == "centre" || value == "geo")) {
    o.geographic = value == "geo";
  } else {
    return wrong(
        "there is pitch=METRES, scale=NUMBER, offset=METRES, edge=clamp|mirror|repeat|METRES, missing=VALUE, nodata=METRES|fill, "
        "project=local, "
        "place=centre|geo, detail=TERRAIN:FACTOR[:PARTS], class=VALUE:NAME, and for raw files size=COLUMNSxROWS, order=little|big, "
        "type=unsigned|signed");
  }
  return {};
}

bool isRasterName(std::string_view name) {
  static constexpr std::array kEndings{".tif",   ".tiff", ".png", ".asc",  ".hgt", ".r16", ".raw",  ".vrt",  ".geotiff",
                                       ".gtiff", ".jp2",  ".j2k", ".img",  ".nc",  ".grd", ".exr",  ".pgm",  ".dt0",
                                       ".dt1",   ".dt2",  ".dem", ".bil",  ".flt", ".ter", ".bt",   ".adf",  ".xyz",
                                       ".gpkg",  ".kap",  ".rst", ".sdat", ".hdf", ".h5",  ".grib", ".grb2", ".gsb"};
  const std::string lower = text::lower(name);
  return std::ranges::any_of(kEndings, [&](const char* end) { return lower.ends_with(end); });
}

}  // namespace ridgecast::raster
