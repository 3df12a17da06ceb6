#include "client/viewer/flight.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <epoxy/gl.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "client/scene/exchange_tiles.h"
#include "client/viewer/coordinates.h"

namespace ridgecast::viewer {
namespace {

constexpr double kBoundsMargin = 4000;  // metres that the camera may fly before the highest ground is computed again
constexpr double kHintSeconds = 2;
constexpr double kAgeInterval = 0.5;   // seconds between redraws while leaves only age
constexpr double kMarkerReach = 25;    // metres: the length of the other members' pyramids
constexpr double kFrozenReach = 2000;  // metres: of a frozen camera's

double secondsSince(std::chrono::steady_clock::time_point began) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
}
double nowInSeconds() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

bool sameView(const camera::Camera& a, const camera::Camera& b) {
  return a.pose.x == b.pose.x && a.pose.z == b.pose.z && a.pose.remainderX == b.pose.remainderX && a.pose.remainderZ == b.pose.remainderZ &&
         a.pose.y == b.pose.y && a.pose.yaw == b.pose.yaw && a.pose.pitch == b.pose.pitch && a.projection.width == b.projection.width &&
         a.projection.height == b.projection.height;
}

}  // namespace

Outcome<Passes> Passes::create(const render::TerrainText& text) {
  auto mesh = render::MeshPass::create(text.shaded);
  if (!mesh) return mesh.error();
  auto before = render::MeshPass::create(text.shaded);
  if (!before) return before.error();
  auto morph = render::MorphPass::create();
  if (!morph) return morph.error();
  auto structure = render::StructurePass::create();
  if (!structure) return structure.error();
  auto correction = render::CorrectionPass::create(text);
  if (!correction) return correction.error();
  auto march = render::MarchPass::create(text);
  if (!march) return march.error();
  auto shade = render::ShadePass::create(text);
  if (!shade) return shade.error();
  auto difference = render::DifferencePass::create();
  if (!difference) return difference.error();
  return Passes{std::move(*mesh),       std::move(*before), std::move(*morph), std::move(*structure),
                std::move(*correction), std::move(*march),  std::move(*shade), std::move(*difference)};
}

Flight::Flight(const ViewOptions& options, Window& window, Link link, render::Drawing drawing, Passes passes, Kept kept)
    : options_(options),
      window_(window),
      handle_(window.handle()),
      link_(std::move(link)),
      terrain_(std::move(drawing.terrain)),
      heights_(std::move(drawing.window)),
      scene_(link_.client->scene()),
      shade_(std::move(passes.shade)),
      mesh_(std::move(passes.mesh), std::move(passes.before), std::move(passes.morph), std::move(passes.structure),
            std::move(passes.correction), shade_),
      march_(std::move(passes.march), shade_),
      difference_(std::move(passes.difference)),
      controls_(startPose()),
      path_(options.path),
      shown_(std::move(kept.shown)) {
  overlay_.emplace(handle_, kept.started ? shown_.choices.textScale : options.textScale);
  listen();
  const wire::World& world = link_.client->world();
  if (heights_) texture_.emplace(heights_->shape());
  if (!kept.started) {
    shown_.smooth = !options.reducedMotion;
    shown_.choices.invertY = options.invertY;
    shown_.choices.vsync = window_.vsync();
    shown_.choices.textScale = options.textScale;
    if (path_) togglePath();
  }
  if (!terrain_) shown_.mode = Mode::kMesh;
  shown_.message.clear();
  shown_.problem.clear();
  shown_.panel = shown_.frozen = false;
  shown_.candidateCount = 0;
  shown_.history = {};
  smoothSet_ = shown_.smooth;
  mesh_.setSmooth(shown_.smooth);
  mesh_.setCorrected(shown_.corrected);
  shown_.world = world.terrainName + ", seed " + std::to_string(world.seed) + ", session " + world.session + ", from " + world.serverName;
  std::snprintf(shown_.choices.terrain.data(), shown_.choices.terrain.size(), "%s", world.terrainName.c_str());
  std::snprintf(shown_.choices.seed.data(), shown_.choices.seed.size(), "%u", world.seed);
  showSettings();
  restructure();
}

Flight::~Flight() {
  glfwSetWindowUserPointer(handle_, nullptr);
  glfwSetKeyCallback(handle_, nullptr);
  glfwSetCharCallback(handle_, nullptr);
  glfwSetWindowFocusCallback(handle_, nullptr);
  glfwSetScrollCallback(handle_, nullptr);
  glfwSetCursorPosCallback(handle_, nullptr);
  glfwSetMouseButtonCallback(handle_, nullptr);
}

Flight::Ending Flight::run(Clock::time_point began) {
  Ending ending;
  auto last = Clock::now();
  window_.show();
  for (;;) {
    // At rest there is nothing to draw: wait for input, but check the connection at intervals.
    if (idle_)
      glfwWaitEventsTimeout(0.02);
    else
      glfwPollEvents();
    const bool ends = glfwWindowShouldClose(handle_) || (options_.seconds && secondsSince(began) >= *options_.seconds);
    const double whole = secondsSince(std::exchange(last, Clock::now()));
    fly(std::min(whole, 0.25));
    converse();
    if (auto drawn = draw(ends); !drawn) {
      std::fprintf(stderr, "ridgecast-client: %s\n", drawn.error().message.c_str());
      ending.code = 3;
      return ending;
    }
    if (ends) break;
    lookForWorld();
    if (arrived_) {
      ending.next = std::move(arrived_);
      break;
    }
  }
  ending.pose = controls_.pose();
  ending.aboveGround = ending.pose.y - ground({ending.pose.x, ending.pose.z}).value_or(0);
  if (!ending.next && lost_) {
    std::fprintf(stderr, "ridgecast-client: closed without a connection to the server\n");
    ending.code = 1;
  }
  freeMouse(true);
  ending.kept = {shown_, true};
  return ending;
}

camera::Pose Flight::startPose() const {
  camera::Pose pose;
  if (options_.at) {
    pose.x = options_.at->x;
    pose.z = options_.at->z;
  } else {
    pose.x = std::llround(options_.x * lattice::kStepsPerMetre);
    pose.z = std::llround(options_.z * lattice::kStepsPerMetre);
  }
  pose.y = ground({pose.x, pose.z}).value_or(0) + options_.altitude;
  pose.yaw = options_.yaw * std::numbers::pi / 180;
  pose.pitch = options_.pitch * std::numbers::pi / 180;
  return pose;
}

std::optional<double> Flight::ground(lattice::Point p) const {
  return terrain_ && (!heights_ || heights_->knows(p)) ? terrain_->height(p) : scene_.height(p);
}

// Whether the height samples used for drawing have changed.
bool Flight::exchangeHeights() {
  if (!heights_) return false;
  if (reconnections_ != link_.client->connection().reconnections()) {
    reconnections_ = link_.client->connection().reconnections();
    heights_->forgetAsked();
  }
  heights_->moveTo({controls_.pose().x, controls_.pose().z});
  if (auto exchanged = scene::exchangeTiles(*link_.client->connection(), *heights_); !exchanged)
    std::fprintf(stderr, "warning: %s\n", exchanged.error().message.c_str());
  const std::uint64_t before = texture_->version();
  texture_->update(*heights_, 16);
  shown_.knownReach = heights_->knownReach();
  return texture_->version() != before;
}

camera::Projection Flight::projection() const {
  int width = 0, height = 0;
  glfwGetFramebufferSize(handle_, &width, &height);
  camera::Projection out;
  out.width = static_cast<std::uint32_t>(std::max(width, 1));
  out.height = static_cast<std::uint32_t>(std::max(height, 1));
  return out;
}

render::View Flight::currentView() {
  render::View view;
  view.camera = {controls_.pose(), projection()};
  view.horizon = link_.client->world().horizon;
  view.heights = texture_ ? &*texture_ : nullptr;
  if (terrain_) {
    const camera::Pose& pose = view.camera.pose;
    const double moved = boundsAt_ ? std::hypot(static_cast<double>(pose.x - boundsAt_->x), static_cast<double>(pose.z - boundsAt_->z)) : 0;
    if (!boundsAt_ || moved * lattice::kMetresPerStep > kBoundsMargin) {
      boundsAt_ = lattice::Point{pose.x, pose.z};
      bounds_ = render::boundsAround(*terrain_, *boundsAt_, view.horizon + kBoundsMargin);
    }
    view.lowest = bounds_.lowest;
    view.highest = bounds_.highest;
  }
  return view;
}

// Tells the mesh's pane what to draw over it. The difference view compares pictures, not lines.
void Flight::restructure() {
  restructuredAt_ = Clock::now();
  render::Structure structure;
  if (shown_.mode != Mode::kDifference) {
    structure.wireframe = shown_.wireframe;
    if (shown_.borders == Borders::kLevel) structure.leafColour = [](const lattice::LeafAddress& a) { return levelColour(a.level); };
    if (shown_.borders == Borders::kAge)
      structure.leafColour = [this, now = nowInSeconds()](const lattice::LeafAddress& a) { return ageColour(ages_.age(a, now)); };
    structure.frozen = frozen_;
    if (shown_.candidates) {
      structure.candidates = candidates_;
      structure.candidateColour = [unit = candidateUnit()](float pixels) { return errorColour(static_cast<double>(pixels), unit); };
    }
  }
  mesh_.setStructure(std::move(structure));
  changed_ = true;
}

Outcome<void> Flight::draw(bool last) {
  if (recorder_) recorder_->add(nowInSeconds(), controls_.pose());
  const bool newHeights = exchangeHeights();
  if (smoothSet_ != shown_.smooth) mesh_.setSmooth(smoothSet_ = shown_.smooth);
  if (shown_.borders == Borders::kAge && ages_.moving(nowInSeconds()) && secondsSince(restructuredAt_) > kAgeInterval) restructure();
  if (!shown_.hint.empty() && secondsSince(hintedAt_) > kHintSeconds) {
    shown_.hint.clear();
    changed_ = true;
  }
  const render::View view = currentView();
  const bool moving = newHeights || !drawnCamera_ || !sameView(*drawnCamera_, view.camera);
  drawnCamera_ = view.camera;
  bool drew = std::exchange(changed_, false) || moving || shown_.panel;
  if (shown_.mode != Mode::kMarch) {
    auto updated = mesh_.update(view, scene_, sceneVersion_, moving || meshStale_);
    if (!updated) return updated.error();
    drew |= *updated;
  }
  meshStale_ = shown_.mode == Mode::kMarch && (moving || meshStale_);
  if (shown_.mode != Mode::kMesh) {
    auto updated = march_.update(view, moving || marchStale_);
    if (!updated) return updated.error();
    drew |= *updated;
  }
  marchStale_ = shown_.mode == Mode::kMesh && (moving || marchStale_);
  const bool refining = shown_.mode != Mode::kMesh && !march_.isFinest();
  idle_ = !drew && !refining;
  if (!drew && !last && secondsSince(presentedAt_) < 0.5) return {};
  present(view, last);
  return {};
}

void Flight::present(const render::View& view, bool last) {
  const int width = static_cast<int>(view.camera.projection.width), height = static_cast<int>(view.camera.projection.height);
  const int divider = shown_.mode == Mode::kSplit  ? static_cast<int>(std::lround(shown_.divider * width))
                      : shown_.mode == Mode::kMesh ? width
                                                   : 0;
  const render::Rectangle whole{0, 0, width, height};
  if (shown_.mode == Mode::kDifference) {
    if (mesh_.canvas() && march_.canvas()) difference_.present(*mesh_.canvas(), *march_.canvas(), width, height);
  } else {
    if (divider > 0 && mesh_.canvas()) render::present(*mesh_.canvas(), whole, {0, 0, divider, height});
    if (divider < width && march_.canvas()) render::present(*march_.canvas(), whole, {divider, 0, width - divider, height});
  }
  tellFigures();
  project(view.camera);
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
  glViewport(0, 0, width, height);
  if (wantsScreenshot_) shown_.hint.clear();
  const Wishes wishes = overlay_->draw(shown_);
  if (last && !options_.screenshot.empty()) screenshot(width, height, options_.screenshot);
  if (std::exchange(wantsScreenshot_, false)) {
    const std::filesystem::path file = freeName(".png");
    screenshot(width, height, file);
    hint("screenshot: " + file.string());
  }
  glfwSwapBuffers(handle_);
  if (framesCounted_++ > 0) shown_.history.frame.add(secondsSince(presentedAt_) * 1e3);
  presentedAt_ = Clock::now();
  grant(wishes);
}

void Flight::tellFigures() {
  const double counted = secondsSince(countedSince_);
  if (counted >= 0.5) {
    shown_.framesPerSecond = static_cast<double>(std::exchange(framesCounted_, 0)) / counted;
    shown_.iterationsPerSecond = static_cast<double>(std::exchange(iterationsCounted_, 0)) / counted;
    const std::uint64_t bytes = link_.client->connection().bytesReceived();
    shown_.history.bytes.add(static_cast<double>(bytes - std::exchange(bytesCounted_, bytes)) / counted / 1e3);
    shown_.history.triangles.add(static_cast<double>(shown_.triangles) / 1e3);
    countedSince_ = Clock::now();
  }
  const camera::Pose& pose = controls_.pose();
  shown_.recording = recorder_.has_value();
  shown_.keyframes = recorder_ ? recorder_->keyframes() : 0;
  shown_.meshMs = mesh_.milliseconds();
  shown_.marchMs = march_.milliseconds();
  shown_.coarseness = march_.coarseness();
  shown_.progress = march_.progress();
  shown_.bytes = link_.client->connection().bytesReceived();
  shown_.x = formatMetres(pose.x);
  shown_.z = formatMetres(pose.z);
  shown_.y = pose.y;
  shown_.aboveGround = pose.y - ground({pose.x, pose.z}).value_or(0);
  shown_.speed = controls_.speed();
  shown_.walking = controls_.walking();
  shown_.frozen = frozen_.has_value();
  shown_.building = building_.share();
}

// The other members and the frozen camera, as lines in the window.
void Flight::project(const camera::Camera& camera) {
  const auto lines = [&camera](const camera::Camera& seen, double reach) {
    std::vector<Line> out;
    for (const auto& [a, b] : frustumEdges(seen, camera.pose, reach))
      if (const auto line = lineOf(camera, a, b)) out.push_back(*line);
    return out;
  };
  shown_.frozenEdges = frozen_ ? lines(*frozen_, kFrozenReach) : std::vector<Line>();
  shown_.markers.clear();
  shown_.members = others_ ? others_->others().size() : 0;
  if (!others_ || !shown_.choices.members) return;
  for (const auto& [id, other] : others_->others()) {
    if (!other.member.moved) continue;
    const camera::Camera& seen = other.member.moved->pose.camera;
    const camera::Vec3 at = between(camera.pose, seen.pose);
    const double away = std::sqrt(at.x * at.x + at.y * at.y + at.z * at.z);
    const auto spot = spotOf(camera, at);
    if (!spot || away > 4 * link_.client->world().horizon) continue;
    char text[200];
    std::snprintf(text, sizeof text, "%.128s, %.0f m%s", other.member.name.empty() ? "somebody" : other.member.name.c_str(), away,
                  other.member.role == wire::Role::kSensor ? ", sensor" : "");
    shown_.markers.push_back({text, *spot, lines(seen, std::max(kMarkerReach, away / 20))});
  }
}

void Flight::screenshot(int width, int height, const std::filesystem::path& file) {
  render::Picture picture{static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height), {}, {}};
  const std::size_t row = static_cast<std::size_t>(width) * 3;
  picture.rgb.resize(row * static_cast<std::size_t>(height));
  glBindFramebuffer(GL_READ_FRAMEBUFFER, 0);
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glReadPixels(0, 0, width, height, GL_RGB, GL_UNSIGNED_BYTE, picture.rgb.data());
  for (std::size_t y = 0; y < static_cast<std::size_t>(height) / 2; ++y)
    std::swap_ranges(picture.rgb.begin() + static_cast<std::ptrdiff_t>(y * row),
                     picture.rgb.begin() + static_cast<std::ptrdiff_t>((y + 1) * row),
                     picture.rgb.end() - static_cast<std::ptrdiff_t>((y + 1) * row));
  const auto written = render::writePng(picture, file);
  const bool unfinished =
      (shown_.mode != Mode::kMesh && !march_.isFinest()) || (shown_.mode != Mode::kMarch && !(mesh_.isAtRest() && shown_.settled));
  std::fprintf(stderr, "%s\n",
               written ? ("the picture is in " + file.string() + (unfinished ? ", and was still being built" : "")).c_str()
                       : ("ridgecast-client: " + written.error().message).c_str());
}

}  // namespace ridgecast::viewer
