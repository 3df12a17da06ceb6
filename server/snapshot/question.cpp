#include "server/snapshot/question.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numbers>

#include "common/settings/settings.h"
#include "common/text/text.h"
#include "server/snapshot/parameters.h"

namespace ridgecast::snapshot {
namespace {

constexpr double kMostMetres = 4e12;
constexpr std::array<std::string_view, 3> kOrigins{"cell", "centre", "world"};
constexpr double kRadians = std::numbers::pi / 180;

using lattice::metres;
lattice::Step steps(double metres) { return static_cast<lattice::Step>(std::floor(metres * lattice::kStepsPerMetre)); }

OfPose poseOf(Parameters& p, const Limits& limits) {
  OfPose out;
  const auto place = [&](const char* name, lattice::Step& whole) { whole = steps(p.number(name, -kMostMetres, kMostMetres, " m")); };
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
  if (p.has("colour_error")) out.colourError = p.number("colour_error", settings::kLeastColourError, settings::kMostColourError, "");
  return out;
}

// From the first to the last sample.
OfBox wholeOf(const terrain::RasterShape& s) {
  OfBox out;
  out.low = {s.x.origin, s.z.origin};
  out.high = {s.x.of(s.width - 1), s.z.of(s.height - 1)};
  return out;
}

OfBox boxOf(Parameters& p, const Limits& limits, const terrain::Raster* map) {
  OfBox out;
  double corner[4];
  const char* names[4] = {"x0", "z0", "x1", "z1"};
  if (const auto all = p.take("box")) {
    if (*all != "all" || !map)
      p.refuse(*all == "all" ? "box=all is the whole of a height map, and this terrain never ends: say x0, z0, x1 and z1."
                             : "'box' is " + inQuotes(*all) + "; it must be all, or say x0, z0, x1 and z1.");
    if (map) out = wholeOf(map->shape());
    const double at[4] = {metres(out.low.x), metres(out.low.z), metres(out.high.x), metres(out.high.z)};
    std::ranges::copy(at, corner);
  } else {
    for (int k = 0; k < 4; ++k) corner[k] = p.number(names[k], -kMostMetres, kMostMetres, " m");
  }
  out.error = p.number("error", limits.leastError, limits.mostError, " m");
  for (int k = 0; k < 2; ++k) {
    const double side = corner[k + 2] - corner[k];
    if (!(side >= 1 && side <= limits.boxSide))
      p.refuse("The box is " + text::rounded(side, 12) + " m wide from " + names[k] + " to " + names[k + 2] + "; it must be 1 to " +
               text::rounded(limits.boxSide, 12) + " m.");
  }
  out.low = {steps(corner[0]), steps(corner[1])};
  out.high = {steps(corner[2]), steps(corner[3])};
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
  out.normals = p.flag("normals");
  out.colours = p.flag("colours");
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
  if ((format == Format::kPly || format == Format::kObj) && (p.has("compression") || p.has("texture")))
    p.refuse("A PLY or OBJ file has neither compression nor a texture; leave them out, or ask for a .glb.");
  if (const auto up = p.take("up")) {
    out.isZUp = *up == "z";
    if (*up != "y" && *up != "z") p.refuse("'up' is " + inQuotes(*up) + "; it must be y or z.");
    if (out.isZUp && format != Format::kPly && format != Format::kObj)
      p.refuse("glTF has y up; leave 'up' out, or ask for a .ply or an .obj.");
  }
  const bool inTiles = format == Format::kTiles;
  if (inTiles && (p.has("texture") || p.has("origin")))
    p.refuse("Tiles have neither a texture nor an origin of their own; leave them out, or ask for a .glb.");
  readForm(p, out);
  if (inTiles) out.where = readWhere(p);
  if (const auto value = p.take("origin")) {
    const auto known = std::ranges::find(kOrigins, *value);
    if (known == kOrigins.end())
      p.refuse("'origin' is " + inQuotes(*value) + "; it must be cell, centre or world.");
    else
      out.origin = static_cast<Origin>(known - kOrigins.begin());
  }
  if (p.has("camera") && !inTiles)
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
    out.colours = false;
  }
  if (auto error = p.finish("A snapshot is of camera=ID, of x, z, altitude, yaw, pitch, fov, width, height, threshold, colour_error, or of "
                            "x0, z0, x1, z1, error, texture (or box=all in place of the corners); with compression, normals, colours, "
                            "origin and up."))
    return *error;
  return out;
}

std::optional<Format> formatOf(std::string_view file) {
  if (file.ends_with(".glb")) return Format::kGlb;
  if (file.ends_with(".ply")) return Format::kPly;
  if (file.ends_with(".obj")) return Format::kObj;
  return std::nullopt;
}

std::string canonical(const Question& q) {
  std::string out = q.compression == gltf::Compression::kDraco ? "draco" : "none";
  out += q.normals ? " normals" : "";
  out += q.colours ? " colours" : "";
  if (q.format != Format::kGlb) out += q.format == Format::kPly ? " ply" : " obj";
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
  }
  return out;
}

}  // namespace ridgecast::snapshot
