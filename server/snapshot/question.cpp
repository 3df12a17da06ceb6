#include "server/snapshot/question.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numbers>
#include <utility>

#include "common/settings/settings.h"
#include "common/text/text.h"
#include "server/snapshot/parameters.h"

namespace ridgecast::snapshot {
namespace {

constexpr double kMaxMetres = 4e12;
constexpr std::array<std::string_view, 3> kOrigins{"cell", "centre", "world"};
constexpr double kRadians = std::numbers::pi / 180;

using lattice::metres;
lattice::Step steps(double metres) { return static_cast<lattice::Step>(std::floor(metres * lattice::kStepsPerMetre)); }

OfPose poseOf(Parameters& p, const Limits& limits) {
  OfPose out;
  const auto place = [&](const char* name, lattice::Step& whole) { whole = steps(p.number(name, -kMaxMetres, kMaxMetres, " m")); };
  place("x", out.camera.pose.x);
  place("z", out.camera.pose.z);
  out.aboveGround = !p.has("y");
  if (!out.aboveGround && p.has("altitude")) p.refuse("The query says both 'y' and 'altitude'; say one of them.");
  out.camera.pose.y = out.aboveGround ? p.number("altitude", -1'000, 100'000, " m") : p.number("y", -131'000, 200'000, " m");
  out.camera.pose.yaw = p.number("yaw", -360, 360, " degrees") * kRadians;
  out.camera.pose.pitch = p.number("pitch", -90, 90, " degrees") * kRadians;
  out.camera.projection.verticalFov = p.number("fov", 1, 170, " degrees", 60) * kRadians;
  out.camera.projection.width = static_cast<std::uint32_t>(p.whole("width", 16, 16'384, " pixels", 1280));
  out.camera.projection.height = static_cast<std::uint32_t>(p.whole("height", 16, 16'384, " pixels", 720));
  out.threshold = p.number("threshold", limits.leastThreshold, limits.mostThreshold, " pixels", 0.6);
  if (p.has("colour_error")) out.colourError = p.number("colour_error", settings::kMinColourError, settings::kMaxColourError, "");
  return out;
}

using Corners = std::array<double, 4>;

std::optional<Corners> cornersOf(std::string_view text) {
  Corners out;
  for (double& v : out) {
    const auto number = text::number<double>(text::takePart(text, ','));
    if (!number || !(std::abs(*number) <= kMaxMetres)) return std::nullopt;
    v = *number;
  }
  return text.empty() ? std::optional(out) : std::nullopt;
}

// The least box of the world around west, south, east, north of a CRS.
Outcome<Corners> around(Corners theirs, earth::Coordinates& coordinates, bool isLonLat) {
  constexpr int kParts = 64;  // of a side, which is no straight line
  const auto [west, south, east, north] = theirs;
  const double width = east - west + (isLonLat && east < west ? 360 : 0);  // across the 180th meridian
  if (!(width > 0 && (width < 180 || !isLonLat) && north > south))
    return Error{"With crs a box is WEST,SOUTH,EAST,NORTH: let it begin in the south-west."};
  Corners out{INFINITY, INFINITY, -INFINITY, -INFINITY};
  for (int k = 0; k <= kParts; ++k) {
    const double t = k / static_cast<double>(kParts), x = west + t * width, y = south + t * (north - south);
    for (const auto& [first, second] : {std::pair(x, south), {x, north}, {west, y}, {west + width, y}}) {
      const auto world = coordinates.world(first, second);
      if (!world || !(std::abs((*world)[0]) <= kMaxMetres && std::abs((*world)[1]) <= kMaxMetres))
        return Error{"The CRS of the map does not reach all of the box's sides; make it smaller."};
      out = {std::min(out[0], (*world)[0]), std::min(out[1], (*world)[1]), std::max(out[2], (*world)[0]), std::max(out[3], (*world)[1])};
    }
  }
  return out;
}

// X0,Z0,X1,Z1, or another CRS's corners, or all of a map.
Outcome<Corners> namedBox(const std::string& text, const std::optional<std::string>& crs, const terrain::Raster* map) {
  if (text == "all") {
    if (!map) return Error{"box=all is the whole of a height map, and this terrain never ends: say x0, z0, x1 and z1."};
    if (crs) return Error{"box=all is the whole of a height map, in any CRS: leave crs out."};
    const lattice::Area all = map->shape().area();
    return Corners{metres(all.x0), metres(all.z0), metres(all.x1), metres(all.z1)};
  }
  const auto corners = cornersOf(text);
  if (!corners)
    return Error{"'box' is " + inQuotes(text) +
                 "; it must be X0,Z0,X1,Z1 in metres of the world, WEST,SOUTH,EAST,NORTH with crs, or all of a height map."};
  if (!crs) return *corners;
  auto coordinates = earth::Coordinates::of(map, *crs);
  if (!coordinates) return coordinates.error();
  return around(*corners, *coordinates, *crs == "lonlat");
}

Corners cornersOf(Parameters& p, const Limits& limits, const terrain::Raster* map) {
  Corners corner{};
  const char* names[4] = {"x0", "z0", "x1", "z1"};
  if (const auto text = p.take("box")) {
    const auto named = namedBox(*text, p.take("crs"), map);
    if (!named) p.refuse(named.error().message);
    corner = named ? *named : corner;
  } else {
    for (std::size_t k = 0; k < 4; ++k) corner[k] = p.number(names[k], -kMaxMetres, kMaxMetres, " m");
  }
  for (std::size_t k = 0; k < 2; ++k) {
    const double side = corner[k + 2] - corner[k];
    if (!(side >= 1 && side <= limits.boxSide))
      p.refuse("The box is " + text::rounded(side, 12) + " m wide from " + names[k] + " to " + names[k + 2] + "; it must be 1 to " +
               text::rounded(limits.boxSide, 12) + " m.");
  }
  return corner;
}

OfBox boxOf(Parameters& p, const Limits& limits, const terrain::Raster* map) {
  OfBox out;
  const Corners corner = cornersOf(p, limits, map);
  out.low = {steps(corner[0]), steps(corner[1])};
  out.high = {steps(corner[2]), steps(corner[3])};
  out.error = p.number("error", limits.leastError, limits.mostError, " m");
  return out;
}

// The samples of a map within a step of a stretch: the first, and the last.
std::pair<std::int64_t, std::int64_t> samplesWithin(const terrain::RasterAxis& axis, double from, double to) {
  const auto origin = static_cast<double>(axis.origin), pitch = axis.steps();
  return {static_cast<std::int64_t>(std::ceil((from - 1 - origin) / pitch)),
          static_cast<std::int64_t>(std::floor((to + 1 - origin) / pitch))};
}

OfGrid gridOf(Parameters& p, const Limits& limits, const terrain::Raster* map) {
  Corners corner = cornersOf(p, limits, map);
  for (double& v : corner) v *= lattice::kStepsPerMetre;
  OfGrid out;
  double columns = 0, rows = 0;
  if (p.has("spacing") || !map) {
    const double spacing = p.number("spacing", limits.leastSpacing, limits.mostSpacing, " m") * lattice::kStepsPerMetre;
    out.sheet = {.x = corner[0], .z = corner[1], .pitchX = spacing, .pitchZ = spacing};
    columns = std::floor((corner[2] - corner[0] + 1) / spacing) + 1;  // a step more: the end of a map may lie between two
    rows = std::floor((corner[3] - corner[1] + 1) / spacing) + 1;
  } else {
    const terrain::RasterAxis &x = map->shape().x, &z = map->shape().z;
    const auto [west, east] = samplesWithin(x, corner[0], corner[2]);
    const auto [north, south] = samplesWithin(z, corner[1], corner[3]);
    const auto at = [](const terrain::RasterAxis& axis, std::int64_t sample) {
      return static_cast<double>(axis.origin) + static_cast<double>(sample) * axis.steps();
    };
    out.sheet = {.x = at(x, west), .z = at(z, north), .pitchX = x.steps(), .pitchZ = z.steps()};
    out.first = {{west, north}};
    columns = static_cast<double>(east - west + 1);
    rows = static_cast<double>(south - north + 1);
  }
  if (!(columns >= 2 && rows >= 2)) p.refuse("The box has fewer than 2 x 2 samples; make it larger, or the spacing smaller.");
  if (!(columns * rows <= limits.samples))
    p.refuse("The grid has " + text::rounded(columns, 12) + " x " + text::rounded(rows, 12) + " samples; it may have " +
             std::to_string(limits.samples) + ": make the box smaller or the spacing larger.");
  out.sheet.columns = static_cast<std::uint32_t>(std::clamp(columns, 0.0, 1e9));
  out.sheet.rows = static_cast<std::uint32_t>(std::clamp(rows, 0.0, 1e9));
  return out;
}

OfMapTiles mapTilesOf(Parameters& p, const Limits& limits, const terrain::Raster* map) {
  OfMapTiles out;
  const Corners corner = cornersOf(p, limits, map);
  out.part = {steps(corner[0]), steps(corner[1]), steps(corner[2]), steps(corner[3])};
  if (const auto at = p.take("at")) {
    out.at = map::placeOf(*at);
    if (!out.at) p.refuse("'at' is " + inQuotes(*at) + "; it must be LON,LAT: degrees within 180 and 85.");
  }
  if (p.has("zoom") || !map) out.finest = static_cast<int>(p.whole("zoom", 0, map::kFinestTileLevel, ""));
  const std::string layer = p.take("layer").value_or("heights");
  if (layer != "heights" && layer != "colours") p.refuse("'layer' is " + inQuotes(layer) + "; it must be heights or colours.");
  out.colours = layer == "colours";
  return out;
}

}  // namespace

void readForm(Parameters& p, Question& out) {
  if (const auto value = p.take("compression")) {
    if (*value == "draco")
      out.compression = gltf::Compression::kDraco;
    else if (*value != "none")
      p.refuse("'compression' is " + inQuotes(*value) + "; it must be draco or none.");
  }
  out.attributes = {p.flag("normals", true), p.flag("colours", true), p.flag("materials", false)};
}

earth::Where readWhere(Parameters& p) {
  earth::Where out;
  const auto heights = p.take("heights");
  if (heights && *heights != "sea" && *heights != "ellipsoid")
    p.refuse("'heights' is " + inQuotes(*heights) + "; they count from the sea or from the ellipsoid.");
  const auto value = p.take("at");
  const bool hasHeight = value && std::ranges::count(*value, ',') > 1;
  if (heights ? *heights == "ellipsoid" : hasHeight) out.heights = earth::Heights::kEllipsoid;
  if (!value) return out;
  out.at = earth::placeOf(*value);
  if (!out.at)
    p.refuse("'at' is " + inQuotes(*value) +
             "; it must be LON,LAT or LON,LAT,HEIGHT: degrees within 360 and 90, and metres within 10,000,000.");
  return out;
}

Outcome<Question> parse(std::string_view query, const Limits& limits, const terrain::Raster* map, Format format) {
  Parameters p;
  if (auto read = p.read(query); !read) return read.error();
  Question out;
  out.format = format;
  if ((format == Format::kPly || format == Format::kObj) && (p.has("compression") || p.has("texture") || p.has("materials")))
    p.refuse("A PLY or OBJ file has no compression, texture or materials; leave them out, or ask for a .glb.");
  if (const auto up = p.take("up")) {
    out.isZUp = *up == "z";
    if (*up != "y" && *up != "z") p.refuse("'up' is " + inQuotes(*up) + "; it must be y or z.");
    if (out.isZUp && format != Format::kPly && format != Format::kObj)
      p.refuse("glTF has y up; leave 'up' out, or ask for a .ply or an .obj.");
  }
  const bool inTiles = format == Format::kTiles, isGrid = format == Format::kTiff, isArchive = format == Format::kArchive;
  if (inTiles && (p.has("texture") || p.has("origin")))
    p.refuse("Tiles have neither a texture nor an origin of their own; leave them out, or ask for a .glb.");
  if (!isGrid && !isArchive) readForm(p, out);
  if (inTiles) out.where = readWhere(p);
  if (const auto value = isGrid || isArchive ? std::nullopt : p.take("origin")) {
    const auto known = std::ranges::find(kOrigins, *value);
    if (known == kOrigins.end())
      p.refuse("'origin' is " + inQuotes(*value) + "; it must be cell, centre or world.");
    else
      out.origin = static_cast<Origin>(known - kOrigins.begin());
  }
  if (isGrid)
    out.of = gridOf(p, limits, map);
  else if (isArchive)
    out.of = mapTilesOf(p, limits, map);
  else if (p.has("camera") && !inTiles)
    out.of = OfCamera{p.whole("camera", 1, ~std::uint64_t{0}, "")};
  else if (p.has("x0") || p.has("z0") || p.has("x1") || p.has("z1") || p.has("box"))
    out.of = boxOf(p, limits, map);
  else if (inTiles)
    p.refuse("Tiles are of a box: say x0, z0, x1, z1 and error, or box=all of a height map.");
  else
    out.of = poseOf(p, limits);
  if (std::holds_alternative<OfBox>(out.of) && p.has("texture")) {
    out.texture = static_cast<std::uint32_t>(p.whole("texture", limits.leastTexture, limits.mostTexture, " pixels"));
    if (out.compression == gltf::Compression::kDraco) p.refuse("A texture goes with compression=none; leave one of them out.");
    out.attributes.colours = false;
  }
  if (auto error = p.finish(
          isGrid      ? "A GeoTIFF is of x0, z0, x1, z1 or box, with crs or without, and spacing."
          : isArchive ? "A PMTiles archive is of x0, z0, x1, z1 or box, with crs or without, and layer, zoom and at."
                      : "A snapshot is of camera=ID, of x, z, altitude, yaw, pitch, fov, width, height, threshold, colour_error, or of "
                        "x0, z0, x1, z1, error, texture (or box, with crs or without, in place of the corners); with compression, normals, "
                        "colours, materials, origin and up."))
    return *error;
  return out;
}

std::optional<Format> formatOf(std::string_view file) {
  if (file.ends_with(".glb")) return Format::kGlb;
  if (file.ends_with(".ply")) return Format::kPly;
  if (file.ends_with(".obj")) return Format::kObj;
  if (file.ends_with(".tif")) return Format::kTiff;
  if (file.ends_with(".pmtiles")) return Format::kArchive;
  return std::nullopt;
}

std::string canonical(const Question& q) {
  std::string out = q.compression == gltf::Compression::kDraco ? "draco" : "none";
  out += q.attributes.normals ? " normals" : "";
  out += q.attributes.colours ? " colours" : "";
  out += q.attributes.materials ? " materials" : "";
  if (q.format == Format::kPly || q.format == Format::kObj) out += q.format == Format::kPly ? " ply" : " obj";
  if (q.origin != Origin::kCell) out += q.origin == Origin::kCentre ? " centre" : " world";
  if (q.isZUp) out += " z-up";
  if (q.texture) out += " texture " + std::to_string(q.texture);
  const auto add = [&](auto v) { out += ' ' + std::to_string(v); };
  const auto addExact = [&](double v) {  // every double has one shortest spelling
    char buffer[32];
    const auto end = std::to_chars(buffer, buffer + sizeof buffer, v).ptr;
    out.append(" ").append(buffer, end);
  };
  const auto addBox = [&](const OfBox& box) {
    for (const lattice::Step v : {box.low.x, box.low.z, box.high.x, box.high.z}) add(v);
    addExact(box.error);
  };
  if (const auto* camera = std::get_if<OfCamera>(&q.of)) {
    out += " camera";
    add(camera->id);
  } else if (const auto* pose = std::get_if<OfPose>(&q.of)) {
    out += pose->aboveGround ? " above" : " pose";
    const camera::Pose& p = pose->camera.pose;
    add(p.x);
    add(p.z);
    for (const double v : {p.y, p.yaw, p.pitch, pose->camera.projection.verticalFov, pose->threshold}) addExact(v);
    add(pose->camera.projection.width);
    add(pose->camera.projection.height);
    if (pose->colourError > 0) addExact(pose->colourError);
  } else if (const auto* box = std::get_if<OfBox>(&q.of)) {
    out += " box";
    addBox(*box);
  } else if (const auto* tile = std::get_if<OfTile>(&q.of)) {
    out += " tile";
    add(tile->square.level);
    addBox(tile->box);
  } else if (const auto* grid = std::get_if<OfGrid>(&q.of)) {
    out += " grid";
    const map::Sheet& sheet = grid->sheet;
    for (const double v : {sheet.x, sheet.z, sheet.pitchX, sheet.pitchZ}) addExact(v);
    add(sheet.columns);
    add(sheet.rows);
    if (grid->first) out += " of the map";
  }
  return out;
}

}  // namespace ridgecast::snapshot
