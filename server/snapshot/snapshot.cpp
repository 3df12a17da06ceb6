#include "server/snapshot/snapshot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <condition_variable>
#include <iterator>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>
#include <thread>
#include <utility>

#include "common/outcome/contract.h"
#include "common/settings/settings.h"
#include "common/terrain/raster.h"
#include "common/text/text.h"
#include "server/box/box_mesh.h"
#include "server/map/picture.h"
#include "server/map/sheet.h"
#include "server/pipeline/pipeline.h"
#include "server/session/live_cameras.h"
#include "server/snapshot/attributes.h"
#include "server/snapshot/description.h"
#include "server/snapshot/geotiff.h"
#include "server/snapshot/polygon_file.h"
#include "server/tileset/tile.h"

namespace ridgecast::snapshot {

using box::meshBox;
using box::Watch;

using Json = nlohmann::json;

namespace {

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr int kVersion = 5;  // part of the ETag: change it when the same question gives another file

using lattice::metres;

double shortened(double v) { return std::round(v * 1e9) / 1e9; }  // degrees that were given in degrees

Json describe(const camera::Camera& c, const terrain::Terrain& terrain) {
  const double ground = terrain.height({c.pose.x, c.pose.z});
  return {{"x", metres(c.pose.x)},
          {"z", metres(c.pose.z)},
          {"y", c.pose.y},
          {"altitude", c.pose.y - ground},
          {"yaw", shortened(std::remainder(c.pose.yaw, 2 * std::numbers::pi) * kDegrees)},
          {"pitch", shortened(c.pose.pitch * kDegrees)},
          {"fov", shortened(c.projection.verticalFov * kDegrees)},
          {"width", c.projection.width},
          {"height", c.projection.height}};
}

// Of a box's or a tile's mesh.
Json errorOf(const auto& mesh, double asked) {
  return {{"unit", "metres"},        {"asked", asked},         {"kept", mesh.error}, {"known", mesh.proven ? "proven" : "measured"},
          {"spacing", mesh.spacing}, {"samples", mesh.samples}};
}

// The common result of all kinds of snapshots.
struct Made {
  std::vector<mesh::LeafMesh> own;
  std::shared_ptr<const session::MeshCopy> held;  // or these
  lattice::Point origin;
  lattice::Point low, high;  // of a box or a tile
  std::optional<camera::Camera> camera;
  Json extras;
  std::vector<std::string> names;  // of the leaves; empty: they have none
  std::optional<tileset::Known> tile;
  const std::vector<mesh::LeafMesh>& leaves() const { return held ? held->leaves : own; }
};

// Small leaves as one, square by square of the quadtree: a node takes 600 bytes whatever is in it.
std::vector<mesh::LeafMesh> joined(std::vector<mesh::LeafMesh> leaves) {
  constexpr std::size_t kMaxTriangles = 4096;
  constexpr int kCoarsest = 22 - lattice::kFinestSideBits;  // 16 km a side: coordinates are exact in a float
  std::map<lattice::LeafAddress, mesh::LeafMesh> all;
  for (mesh::LeafMesh& leaf : leaves) all.emplace(leaf.address, std::move(leaf));
  std::set<lattice::LeafAddress> parted;
  for (int level = 0; level < kCoarsest; ++level) {
    std::map<lattice::LeafAddress, std::vector<const mesh::LeafMesh*>> families;
    for (const auto& [address, leaf] : all)
      if (address.level == level) families[address.parent()].push_back(&leaf);
    for (const auto& [parent, children] : families) {
      std::size_t triangles = 0;
      for (const mesh::LeafMesh* child : children) triangles += child->triangles.size();
      if (triangles > kMaxTriangles) parted.insert(parent);
      if (parted.contains(parent)) continue;
      all.emplace(parent, mesh::gather(parent, children));
      for (int quarter = 0; quarter < 4; ++quarter) all.erase(parent.child(quarter));
    }
    for (const lattice::LeafAddress& square : parted)
      if (square.level == level + 1) parted.insert(square.parent());
  }
  leaves.clear();
  for (auto& [address, leaf] : all) leaves.push_back(std::move(leaf));
  return leaves;
}

Result<Made> ofCamera(const session::Session& session, const OfCamera& of, const Watch& watch) {
  const Problem none{Problem::Kind::kNotThere,
                     "Session '" + session.name() + "' has no camera " + std::to_string(of.id) +
                         " that holds a mesh; a client learns the number of its camera from the world it is sent."};
  const auto camera = session.live().find(of.id);
  if (!camera) return none;
  struct Waiting {
    std::mutex mutex;
    std::condition_variable_any come;
    std::shared_ptr<const session::MeshCopy> mesh;
    bool done = false;
  };
  const auto waiting = std::make_shared<Waiting>();
  const bool taken = camera->copy([waiting](std::shared_ptr<const session::MeshCopy> mesh) {
    const std::lock_guard lock(waiting->mutex);
    waiting->mesh = std::move(mesh);
    waiting->done = true;
    waiting->come.notify_all();
  });
  if (!taken) return none;
  std::unique_lock lock(waiting->mutex);
  waiting->come.wait_until(lock, watch.stop, watch.deadline, [&] { return waiting->done; });
  if (!waiting->done) return watch.problem();
  if (!waiting->mesh) return none;
  Made out;
  out.held = waiting->mesh;
  const session::MeshCopy& held = *out.held;
  out.camera = held.camera;
  out.origin = {held.camera.pose.x, held.camera.pose.z};
  out.extras = {
      {"of", "camera"},
      {"camera", {{"id", of.id}, {"iteration", held.iteration}, {"meshHash", text::hexadecimal(held.meshHash)}}},
      {"pose", describe(held.camera, *held.ground.terrain)},
      {"error",
       {{"unit", settings::traits(held.settings.metric).name}, {"asked", held.settings.threshold}, {"kept", held.effectiveThreshold}}}};
  return out;
}

Result<Made> ofPose(const editing::Ground& ground, const OfPose& of, const Limits& limits, const std::shared_ptr<scheduling::Pool>& pool,
                    const Watch& watch) {
  Made out;
  camera::Camera camera = of.camera;
  if (of.aboveGround) camera.pose.y += ground.terrain->height({camera.pose.x, camera.pose.z});
  if (!camera::isValid(camera))
    return Problem{Problem::Kind::kTooMuch, "This pose lies outside the world: up to 4e12 m from the origin and 200 km high."};
  pipeline::Limits budget;
  budget.defaultBudget = budget.maxBudget = limits.triangles;
  settings::Settings requested;
  requested.metric = settings::Metric::kPixels;
  requested.threshold = of.threshold;
  requested.colourError = of.colourError;
  pipeline::Pipeline pipeline(ground.terrain, pipeline::grant(requested, budget), pool);
  settings::IterationStats figures;
  do {
    if (watch.over()) return watch.problem();
    figures = pipeline.iterate(camera);
    watch.has(static_cast<std::uint32_t>(figures.triangles));
    if (figures.effectiveThreshold > of.threshold * 1.0001)
      return Problem{Problem::Kind::kTooMuch, "This pose at a threshold of " + text::rounded(of.threshold, 3) + " pixels takes more than " +
                                                  std::to_string(limits.triangles) + " triangles, the limit; a threshold of " +
                                                  text::rounded(of.threshold * 2, 3) + " pixels takes about a third of them."};
  } while (!pipeline.settled());
  const auto& leaves = pipeline.leaves();
  out.own.resize(leaves.size());
  pool->forEach(leaves.size(), 8, [&](std::size_t k) { out.own[k] = pipeline.extract(leaves[k].address); });
  out.own = joined(std::move(out.own));
  out.camera = camera;
  out.origin = {camera.pose.x, camera.pose.z};
  out.extras = {{"of", "pose"},
                {"pose", describe(camera, *ground.terrain)},
                {"error", {{"unit", "pixels"}, {"asked", of.threshold}, {"kept", figures.effectiveThreshold}}}};
  return out;
}

// A large map's box by squares of the lattice. Boxes share their common sides bit for bit.
std::vector<OfBox> partsOf(const terrain::Raster& map, const OfBox& box, int partBits) {
  const int bits = std::ilogb(map.shape().finest()) + partBits;
  const auto width = static_cast<double>(box.high.x - box.low.x), depth = static_cast<double>(box.high.z - box.low.z);
  if (width * depth <= std::ldexp(1.0, 2 * bits)) return {box};
  expects(bits >= 0 && bits < 62, "a part of a map has a side");
  std::vector<OfBox> parts;
  const lattice::Step side = lattice::Step{1} << bits;
  for (lattice::Step z = lattice::floorTo(box.low.z, bits); z < box.high.z; z += side)
    for (lattice::Step x = lattice::floorTo(box.low.x, bits); x < box.high.x; x += side)
      parts.push_back(
          {{std::max(x, box.low.x), std::max(z, box.low.z)}, {std::min(x + side, box.high.x), std::min(z + side, box.high.z)}, box.error});
  return parts;
}

Result<box::BoxMesh> meshParts(const terrain::Terrain& terrain, const OfBox& of, const Limits& limits, scheduling::Pool& pool,
                               const Watch& watch, Progress* progress) {
  const auto parts = terrain.raster() ? partsOf(*terrain.raster(), of, limits.partBits) : std::vector{of};
  box::BoxMesh all;
  all.low = of.low;
  all.high = of.high;
  all.proven = true;
  if (progress) progress->parts = static_cast<std::uint32_t>(parts.size());
  for (const OfBox& part : parts) {
    expects(all.triangles <= limits.triangles, "the parts of a map share its limit of triangles");
    auto made = meshBox(terrain, part, limits.triangles - all.triangles, pool, watch);
    if (!made) return made.error();
    std::ranges::move(made->leaves, std::back_inserter(all.leaves));
    all.low = {std::min(all.low.x, made->low.x), std::min(all.low.z, made->low.z)};
    all.high = {std::max(all.high.x, made->high.x), std::max(all.high.z, made->high.z)};
    all.error = std::max(all.error, made->error);
    all.proven = all.proven && made->proven;
    all.spacing = std::max(all.spacing, made->spacing);
    all.samples += made->samples;
    all.triangles += made->triangles;
    if (progress) ++progress->part;
  }
  return all;
}

Result<Made> ofBox(const editing::Ground& ground, const OfBox& of, const Limits& limits, const std::shared_ptr<scheduling::Pool>& pool,
                   const Watch& watch, Progress* progress) {
  auto box = meshParts(*ground.terrain, of, limits, *pool, watch, progress);
  if (!box) return box.error();
  Made out;
  out.own = std::move(box->leaves);
  out.origin = box->low;
  out.low = box->low;
  out.high = box->high;
  out.extras = {{"of", "box"}, {"box", describeBox(box->low, box->high)}, {"error", errorOf(*box, of.error)}};
  return out;
}

tileset::Known knownOf(const tileset::Tile& tile, const OfTile& of) {
  std::int32_t lowest = lattice::kMaxHeight, highest = -lowest;
  for (const mesh::LeafMesh* mesh : {&tile.surface, &tile.skirt})
    for (const mesh::LocalVertex& v : mesh->vertices) {
      lowest = std::min(lowest, v.y);
      highest = std::max(highest, v.y);
    }
  return {tile.low, tile.high, metres(lowest), metres(highest), of.box.error};
}

Result<Made> ofTile(const editing::Ground& ground, const OfTile& of, const Limits& limits, const std::shared_ptr<scheduling::Pool>& pool,
                    const Watch& watch) {
  auto tile = tileset::meshTile(*ground.terrain, of, limits.triangles, *pool, watch);
  if (!tile) return tile.error();
  Made out;
  out.origin = tileset::frameOf(of.square);
  out.low = tile->low;
  out.high = tile->high;
  out.extras = {{"of", "tile"}, {"box", describeBox(tile->low, tile->high)}, {"error", errorOf(*tile, of.box.error)}};
  if (tile->ramp > 0) out.extras["error"]["ramp"] = tile->ramp;
  out.tile = knownOf(*tile, of);
  out.own.push_back(std::move(tile->surface));
  out.own.push_back(std::move(tile->skirt));
  out.names = {"surface", "skirt"};
  return out;
}

void place(gltf::Document& document, const Made& made, Origin origin) {
  document.origin = made.origin;
  document.atOrigin = origin != Origin::kCell;
  if (origin == Origin::kWorld) document.origin = {};
  if (origin == Origin::kCentre && made.high.x > made.low.x)
    document.origin = {(made.low.x + made.high.x) / 2, (made.low.z + made.high.z) / 2};
}

// With what writeGlb adds.
Json withOrigin(const gltf::Document& document, Json extras) {
  const lattice::Point origin = gltf::originOf(document);
  extras["origin"] = {{"x", metres(origin.x)}, {"z", metres(origin.z)}};
  if (!document.atOrigin) {
    extras["cellX"] = origin.x >> lattice::kCellBits;
    extras["cellZ"] = origin.z >> lattice::kCellBits;
  }
  extras["latticeStep"] = lattice::kMetresPerStep;
  return extras;
}

gltf::Texture paint(const terrain::Terrain& terrain, const Made& made, std::uint32_t pixels, const Watch& watch) {
  const auto width = static_cast<double>(made.high.x - made.low.x), depth = static_cast<double>(made.high.z - made.low.z);
  const auto count = [&](double side) {
    return std::max(1u, static_cast<std::uint32_t>(std::ceil(pixels * side / std::max(width, depth))));
  };
  expects(width > 0 && depth > 0 && pixels > 0, "a texture lies on a box");
  map::Sheet sheet{.columns = count(width), .rows = count(depth)};
  sheet.pitchX = width / sheet.columns;
  sheet.pitchZ = depth / sheet.rows;
  sheet.x = static_cast<double>(made.low.x) + sheet.pitchX / 2;
  sheet.z = static_cast<double>(made.low.z) + sheet.pitchZ / 2;
  const auto rgb = map::colours(terrain, sheet, watch.stop);
  return {rgb.empty() ? std::string() : map::png(rgb, sheet.columns, sheet.rows), made.low, made.high};
}

Outcome<std::string> write(const gltf::Document& document, const Question& question, const std::stop_token& stop, scheduling::Pool& pool) {
  if (question.format == Format::kPly) return writePly(document, question.isZUp, stop);
  if (question.format == Format::kObj) return writeObj(document, question.isZUp, stop);
  return gltf::writeGlb(document, question.compression, stop, [&](std::size_t count, const auto& body) { pool.forEach(count, 8, body); });
}

constexpr std::array<const char*, 4> kEndings{".glb", ".ply", ".obj", ".tif"};  // by Format

Json describe(const map::Sheet& grid) {
  const auto metres = [](double steps) { return steps * lattice::kMetresPerStep; };
  return {{"of", "grid"},
          {"box",
           {{"x0", metres(grid.x)},
            {"z0", metres(grid.z)},
            {"x1", metres(grid.x + (grid.columns - 1) * grid.pitchX)},
            {"z1", metres(grid.z + (grid.rows - 1) * grid.pitchZ)}}},
          {"columns", grid.columns},
          {"rows", grid.rows},
          {"pitch", {{"x", metres(grid.pitchX)}, {"z", metres(grid.pitchZ)}}}};
}

Result<Snapshot> ofGrid(const session::Session& session, const editing::Ground& ground, const OfGrid& grid, scheduling::Pool& pool,
                        const Watch& watch, Progress* progress) {
  Json extras = describe(grid.sheet);
  describeWorld(session, ground, {std::llround(grid.sheet.x), std::llround(grid.sheet.z)}, extras);
  Snapshot out;
  out.name = "ridgecast-" + std::string(ground.terrain->name()) + "-grid.tif";
  if (progress) progress->stage = Progress::Stage::kSampling;
  auto file = writeGeoTiff(*ground.terrain, grid, session.resources().limits.sendsTerrain, extras.dump(), pool, watch, progress);
  if (!file) return file.error();
  out.file = std::move(*file);
  return out;
}

}  // namespace

std::string Progress::text() const {
  const std::uint32_t all = triangles, done = checked;
  const std::string count = std::to_string(all) + " triangles";
  switch (stage.load()) {
    case Stage::kMeshing:
      if (parts > 1)
        return "meshing part " + std::to_string(std::min(part + 1, parts.load())) + " of " + std::to_string(parts) + ", " + count;
      return done == 0 ? "meshing, " + count : "checking, " + std::to_string(std::min(99ul, 100ul * done / std::max(1u, all))) + " %";
    case Stage::kSampling:
      return "heights, part " + std::to_string(std::min(part + 1, parts.load())) + " of " + std::to_string(parts);
    case Stage::kColouring:
      return "normals and colours, " + count;
    case Stage::kPainting:
      return "painting the texture, " + count;
    case Stage::kWriting:
      break;
  }
  return all > 0 ? "writing, " + count : "writing";
}

Snapshots::Snapshots(const Limits& limits, unsigned threads, const scheduling::Executor* cameras)
    : limits_(limits), executor_(threads ? threads : std::max(1u, std::thread::hardware_concurrency() - 1), cameras, limits.share) {}

Result<Snapshot> Snapshots::take(const session::Session& session, editing::Ground ground, const Question& question, bool metadataOnly,
                                 std::stop_token stop, Progress* progress) {
  expects(question.format < Format::kTiles && !std::holds_alternative<OfMapTiles>(question.of), "a snapshot is one file");
  expects(std::holds_alternative<OfGrid>(question.of) == (question.format == Format::kTiff), "a GeoTIFF is of a grid, and no other file");
  const auto start = std::chrono::steady_clock::now();
  const Watch watch{stop,
                    start + std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(limits_.seconds)),
                    limits_.seconds, progress};
  const auto reaches = [progress](Progress::Stage stage) {
    if (progress) progress->stage = stage;
  };
  const auto pool = executor_.makePool(executor_.threads());
  if (const auto* grid = std::get_if<OfGrid>(&question.of)) return ofGrid(session, ground, *grid, *pool, watch, progress);
  Result<Made> made = Problem{};
  if (const auto* camera = std::get_if<OfCamera>(&question.of))
    made = ofCamera(session, *camera, watch);
  else if (const auto* pose = std::get_if<OfPose>(&question.of))
    made = ofPose(ground, *pose, limits_, pool, watch);
  else if (const auto* box = std::get_if<OfBox>(&question.of))
    made = ofBox(ground, *box, limits_, pool, watch, progress);
  else
    made = ofTile(ground, std::get<OfTile>(question.of), limits_, pool, watch);
  if (!made) return made.error();
  if (made->held) ground = made->held->ground;

  const terrain::Terrain& terrain = *ground.terrain;
  gltf::Document document;
  std::uint64_t triangles = 0, vertices = 0;
  for (const mesh::LeafMesh& leaf : made->leaves()) {
    triangles += leaf.triangles.size();
    vertices += leaf.vertices.size();
    document.leaves.push_back({.mesh = &leaf});
  }
  for (std::size_t k = 0; k < made->names.size(); ++k) document.leaves[k].name = made->names[k];
  if (triangles > limits_.triangles)
    return Problem{Problem::Kind::kTooMuch, "This camera holds " + std::to_string(triangles) + " triangles; a snapshot may have at most " +
                                                std::to_string(limits_.triangles) + "."};
  place(document, *made, question.origin);
  made->extras["leaves"] = document.leaves.size();
  made->extras["triangles"] = triangles;
  made->extras["vertices"] = vertices;
  describeWorld(session, ground, gltf::originOf(document), made->extras);
  const Json all = withOrigin(document, made->extras);
  Snapshot out;
  out.name = "ridgecast-" + std::string(terrain.name()) + "-" + all["of"].get<std::string>() +
             kEndings.at(static_cast<std::size_t>(question.format));
  out.metadata = all.dump(2) + "\n";
  out.tile = made->tile;
  if (metadataOnly) return out;
  watch.has(static_cast<std::uint32_t>(triangles));
  reaches(Progress::Stage::kColouring);
  std::optional<Sides> sides;
  if (const auto* box = std::get_if<OfBox>(&question.of)) sides = {made->low, made->high, box->error};
  if (const auto* tile = std::get_if<OfTile>(&question.of)) sides = {made->low, made->high, tile->box.error};
  if (!addAttributes(terrain, question.attributes, document, sides, *pool, watch)) return watch.problem();
  if (question.texture) {
    reaches(Progress::Stage::kPainting);
    document.texture = paint(terrain, *made, question.texture, watch);
    if (watch.over()) return watch.problem();
    if (document.texture->png.empty()) document.texture.reset();  // a terrain without colours
  }
  document.camera = made->camera;
  document.extras = question.format == Format::kGlb ? made->extras.dump() : all.dump();
  reaches(Progress::Stage::kWriting);
  auto file = write(document, question, stop, *pool);
  if (!file) {
    if (watch.over()) return watch.problem();
    return Problem{Problem::Kind::kTooMuch, "This snapshot cannot be such a file: " + file.error().message + "."};
  }
  out.file = std::move(*file);
  return out;
}

std::string Snapshots::etag(const session::Session& session, const editing::Ground& ground, const Question& question, bool metadataOnly) {
  if (std::holds_alternative<OfCamera>(question.of)) return {};
  std::uint64_t first = lattice::mix(session.hashOf(ground) ^ kVersion), second = lattice::mix(first);
  const std::string text = canonical(question);
  for (const std::string_view part : {std::string_view(session.name()), std::string_view(RIDGECAST_VERSION), std::string_view(text),
                                      std::string_view(metadataOnly ? "json" : "glb")}) {
    for (const char c : part) {
      first = lattice::mix(first ^ static_cast<unsigned char>(c));
      second = lattice::mix(second + first);
    }
    first = lattice::mix(first ^ part.size());
  }
  return text::hexadecimal(first) + text::hexadecimal(second);
}

}  // namespace ridgecast::snapshot
