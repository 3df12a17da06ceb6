#include "client/viewer/world_window.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <utility>

#include "client/viewer/coordinates.h"
#include "client/viewer/people.h"
#include "client/viewer/remembered.h"
#include "common/outcome/contract.h"

namespace ridgecast::viewer {
namespace {

constexpr double kMarkerReach = 25;    // metres: the length of the other members' pyramids
constexpr double kFrozenReach = 2000;  // metres: of a frozen camera's

// Unused names: ridgecast-1.json, ridgecast-2.json, ...
std::filesystem::path freeName(const std::string& ending) {
  for (int k = 1;; ++k) {
    std::filesystem::path file = "ridgecast-" + std::to_string(k) + ending;
    std::error_code ignored;
    if (!std::filesystem::exists(file, ignored)) return file;
  }
}

camera::Pose startPose(const Start& start, const Ground& ground) {
  constexpr double kRadians = std::numbers::pi / 180;
  return {.x = start.at.x,
          .z = start.at.z,
          .y = ground.height(start.at).value_or(0) + start.altitude,
          .yaw = start.yaw * kRadians,
          .pitch = start.pitch * kRadians};
}

}  // namespace

PathFlight::PathFlight(std::optional<camera::Path> path, Stream& stream, ViewerState& state)
    : stream_(stream), state_(state), path_(std::move(path)) {
  state.motion.following = path_.has_value();
}

void PathFlight::toggleFollowing() {
  if (!path_) return state_.tell("no path yet: R records one, or give one with --path FILE.json");
  state_.motion.following = !state_.motion.following;
  began_ = std::chrono::steady_clock::now();
}

void PathFlight::toggleRecording() {
  if (!recorder_) {
    recorder_.emplace(stream_.client().world().terrainName, stream_.client().world().seed);
    return state_.tell("recording");
  }
  const std::filesystem::path file = freeName(".json");
  const auto written = recorder_->write(file);
  const std::string said = written ? "the path flown is in " + file.string() + "; O follows it" : written.error().message;
  if (auto flown = camera::readPath(file); written && flown) path_ = std::move(*flown);
  std::fprintf(stderr, "%s\n", said.c_str());
  state_.tell(said);
  recorder_.reset();
}

void PathFlight::record(const camera::Pose& pose) {
  if (recorder_) recorder_->add(nowInSeconds(), pose);
}

void PathFlight::follow(const Input& input, Controls& controls, const Ground& ground) {
  if (!state_.motion.following) return;
  expects(path_.has_value(), "there is a path to follow");
  const double t = secondsSince(began_);
  if (!input.moves()) {
    controls.place(camera::poseAt(*path_, std::min(t, path_->duration()), [&](lattice::Point p) { return ground.height(p).value_or(0); }));
    if (t <= path_->duration()) return;
  }
  state_.motion.following = false;
  state_.changed = true;
}

void Frames::present(Plots& plots) {
  if (count_++ > 0) plots.frame.add(sincePresented() * 1e3);
  presentedAt_ = std::chrono::steady_clock::now();
}

std::optional<double> Frames::count(Drawn& drawn) {
  const double counted = secondsSince(countedSince_);
  if (counted < 0.5) return std::nullopt;
  drawn.framesPerSecond = static_cast<double>(std::exchange(count_, 0)) / counted;
  countedSince_ = std::chrono::steady_clock::now();
  return counted;
}

WorldWindow::WorldWindow(const ViewOptions& options, const Start& start, Window& window, Link link, const render::Drawing& drawing,
                         Passes passes, ViewerState& state, const Compiling* compiling)
    : options_(options),
      window_(window),
      state_(state),
      stream_(std::move(link), state),
      ground_(drawing, stream_.client()),
      pictures_(std::in_place, std::move(passes)),
      overlay_(window.handle(), state.panel.textScale),
      editor_(stream_.client(), stream_.url(), state),
      devices_(window.handle(), state, overlay_, actions(), brushHands()),
      controls_(startPose(start, ground_), start.speed),
      start_(start),
      placed_(ground_.height(start.at) ? std::nullopt : std::optional(controls_.pose())),
      compiling_(compiling),
      canMarch_(!drawing.text.neutral),
      wanted_(state.mode),
      path_(options.path, stream_, state) {
  if (!canMarch_) state.mode = Mode::kMesh;
}

WorldWindow::Ending WorldWindow::run(Clock::time_point began) {
  Ending ending;
  auto last = Clock::now();
  window_.show();
  for (;;) {
    // At rest there is nothing to draw: wait for input, but check the connection at intervals.
    if (idle_)
      glfwWaitEventsTimeout(0.02);
    else
      glfwPollEvents();
    const bool ends = glfwWindowShouldClose(window_.handle()) || (options_.seconds && secondsSince(began) >= *options_.seconds);
    const double whole = secondsSince(std::exchange(last, Clock::now()));
    fly(std::min(whole, 0.25));
    stream_.exchange(state_.lines.frozen ? *state_.lines.frozen : camera());
    auto drawn = watchCompiling();
    if (drawn) drawn = draw(ends);
    if (!drawn) {
      std::fprintf(stderr, "ridgecast-client: %s\n", drawn.error().message.c_str());
      ending.code = 3;
      return ending;
    }
    if (ends) break;
    ending.next = stream_.enteredWorld();
    if (ending.next) break;
  }
  ending.where = sessionAt(stream_.url());
  ending.place = place();
  state_.mode = wanted_;
  if (!ending.next && stream_.lost()) {
    std::fprintf(stderr, "ridgecast-client: closed without a connection to the server\n");
    ending.code = 1;
  }
  devices_.freeMouse(true);
  return ending;
}

std::vector<Action> WorldWindow::actions() {
  ViewerState& s = state_;
  const auto toggle = [](bool& what) { return [&what] { what = !what; }; };
  const auto show = [this](Mode mode) { return [this, mode] { this->show(mode); }; };
  const auto cycle = [](auto& what, int count) {
    return [&what, count] { what = static_cast<std::decay_t<decltype(what)>>((static_cast<int>(what) + 1) % count); };
  };
  // By keys only while the clock is shown: it is everybody's.
  const auto drive = [this](auto how) {
    return [this, how] {
      if (state_.clock.on) stream_.setClock(how(state_.clock));
    };
  };
  return {{"back", [this] { goBack(); }},
          {"quit", [this] { quit(); }},
          {"help", toggle(s.help), GLFW_GAMEPAD_BUTTON_START},
          {"settings", [this] { openPanel(Dialog::kSettings); }},
          {"worlds", [this] { openPanel(Dialog::kWorlds); }},
          {"people", [this] { openPanel(Dialog::kPeople); }},
          {"figures", toggle(s.figures)},
          {"plots", toggle(s.plots)},
          {"screen", [this] { window_.toggleFullScreen(); }},
          {"picture", [this] { wantsScreenshot_ = true; }},
          {"link", [this] { copyLink(); }},
          {"mesh", show(Mode::kMesh)},
          {"march", show(Mode::kMarch)},
          {"split", show(Mode::kSplit)},
          {"difference", show(Mode::kDifference)},
          {"", [this] { this->show(static_cast<Mode>((static_cast<int>(state_.mode) + 1) % 4)); }, GLFW_GAMEPAD_BUTTON_X},
          {"wireframe", toggle(s.lines.wireframe), GLFW_GAMEPAD_BUTTON_Y},
          {"leaves", cycle(s.lines.borders, 3), GLFW_GAMEPAD_BUTTON_BACK},
          {"frozen", [this] { toggleFrozen(); }, GLFW_GAMEPAD_BUTTON_LEFT_THUMB},
          {"candidates", [this] { stream_.requestCandidates(!state_.lines.candidates); }},
          {"edit", [this] { toggleEditing(); }},
          {"undo", [this] { editor_.undo(); }},
          {"road", [this] { editor_.endRoad(); }},
          {"clock", toggle(s.clock.on)},
          {"pause", drive([](const core::ClockBar& c) { return core::toggled(c); })},
          {"slower", drive([](const core::ClockBar& c) { return core::faster(c, false); })},
          {"faster", drive([](const core::ClockBar& c) { return core::faster(c, true); })},
          {"rewind", drive([](const core::ClockBar& c) { return core::movedBy(c, -core::kClockSkip); })},
          {"skip", drive([](const core::ClockBar& c) { return core::movedBy(c, core::kClockSkip); })},
          {"walk", [this] { toggleWalking(); }, GLFW_GAMEPAD_BUTTON_B},
          {"corrected", [this] { toggleCorrected(); }},
          {"record", [this] { path_.toggleRecording(); }},
          {"path", [this] { path_.toggleFollowing(); }}};
}

BrushHands WorldWindow::brushHands() {
  return {[this](double x, double y) {
            editor_.click(camera(), {x, y});
          },
          [this] { editor_.endRoad(); }, [this](double notches) { editor_.widen(notches); }};
}

void WorldWindow::show(Mode mode) {
  wanted_ = mode;
  if (canMarch_ || mode == Mode::kMesh)
    state_.mode = mode;
  else
    state_.tell(compiling_ ? "the ray march is shown once the driver has compiled it" : "there is no ray march of this terrain here");
}

void WorldWindow::toggleEditing() {
  devices_.freeMouse(true);
  editor_.toggle();
}

void WorldWindow::toggleWalking() {
  controls_.setWalking(!controls_.walking());
  state_.tell(controls_.walking() ? "walking" : "flying");
}

void WorldWindow::toggleCorrected() {
  state_.corrected = !state_.corrected;
  state_.tell(!ground_.hasFunction() ? "this terrain's function is not known here"
              : state_.corrected     ? "the mesh, corrected onto the true surface"
                                     : "the mesh as it is");
}

// First ends what is waiting or open, then frees the mouse, then closes the window if pressed again.
void WorldWindow::goBack() {
  if (stream_.entering())
    stream_.giveUpWorld();
  else if (state_.panel.open())
    state_.panel.dialog = Dialog::kNone;
  else if (!state_.mouseFree)
    devices_.freeMouse(true);
  else if (state_.help)
    state_.help = false;
  else if (state_.edit.on)
    editor_.end();
  else if (Clock::now() < state_.mayQuitUntil)
    quit();
  else {
    state_.mayQuitUntil = Clock::now() + kHintTime;
    state_.tell("Press Esc again to quit, or Ctrl+Q");
  }
}

void WorldWindow::quit() { glfwSetWindowShouldClose(window_.handle(), GLFW_TRUE); }

void WorldWindow::toggleFrozen() {
  auto& frozen = state_.lines.frozen;
  frozen = frozen ? std::nullopt : std::optional(camera());
  state_.tell(frozen ? "the server keeps to this camera: fly on and look at it from outside" : "the server follows again");
}

// Closes it if it is open.
void WorldWindow::openPanel(Dialog dialog) {
  Panel& panel = state_.panel;
  panel.dialog = panel.dialog == dialog ? Dialog::kNone : dialog;
  if (!panel.open()) return;
  devices_.freeMouse(true);
  panel.typed = dialog == Dialog::kWorlds;
  if (panel.typed) {
    overlay_.awaitTyping();
    stream_.requestWorlds();
  }
  if (!stream_.entering()) panel.problem.clear();
  std::snprintf(panel.x.data(), panel.x.size(), "%s", formatMetres(controls_.pose().x).c_str());
  std::snprintf(panel.z.data(), panel.z.size(), "%s", formatMetres(controls_.pose().z).c_str());
  std::snprintf(panel.altitude.data(), panel.altitude.size(), "%.0f", std::max(2.0, aboveGround()));
}

void WorldWindow::grant(const Requests& requests) {
  if (requests.vsync) window_.setVsync(state_.panel.vsync);
  if (requests.settings) stream_.requestSettings();
  if (requests.jump) jump();
  if (requests.world) stream_.enterWorld();
  if (requests.session) stream_.enterSession(*requests.session);
  if (requests.clock) stream_.setClock(*requests.clock);
  if (requests.flyTo) flyTo(*requests.flyTo);
  if (state_.edit.on) editor_.grant(requests.edit, camera());
}

void WorldWindow::jump() {
  Panel& panel = state_.panel;
  const auto x = parseMetres(panel.x.data()), z = parseMetres(panel.z.data());
  char* end = nullptr;
  const double altitude = std::strtod(panel.altitude.data(), &end);
  panel.problem = !x                                                                              ? x.error().message
                  : !z                                                                            ? z.error().message
                  : end == panel.altitude.data() || *end || !(altitude >= 1 && altitude <= 30000) ? "above ground: give 1 to 30000 metres"
                                                                                                  : "";
  state_.changed = true;
  if (!panel.problem.empty()) return;
  camera::Pose pose = controls_.pose();
  pose.x = *x;
  pose.z = *z;
  pose.remainderX = pose.remainderZ = 0;
  // While the ground is unknown, above all ground that there may be nearby; the true height arrives soon.
  pose.y = ground_.height({pose.x, pose.z}).value_or(std::max(0.0, pose.y)) + altitude;
  controls_.place(pose);
  state_.motion.following = false;
  panel.dialog = Dialog::kNone;
}

void WorldWindow::flyTo(std::uint64_t member) {
  const core::Roster* others = stream_.others();
  const auto found = others ? others->others().find(member) : std::map<std::uint64_t, core::Other>::const_iterator{};
  if (!others || found == others->others().end() || !found->second.member.moved) return;
  controls_.place(beside(controls_.pose(), found->second.member.moved->pose.camera.pose));
  state_.motion.following = false;
  state_.panel.dialog = Dialog::kNone;
}

// As the page writes it, without the token.
void WorldWindow::copyLink() {
  const core::Url& url = stream_.url();
  const camera::Pose& pose = controls_.pose();
  const bool bracketed = url.host.find(':') != std::string::npos;
  char place[160];
  std::snprintf(place, sizeof place, "#x=%s&z=%s&y=%.3f&yaw=%.3f&pitch=%.3f", formatMetres(pose.x).c_str(), formatMetres(pose.z).c_str(),
                pose.y, pose.yaw * 180 / std::numbers::pi, pose.pitch * 180 / std::numbers::pi);
  std::string link = std::string(url.secure ? "https://" : "http://") + (bracketed ? "[" + url.host + "]" : url.host) + ":" + url.port +
                     "/?session=" + url.session + (url.world.empty() ? "" : "&" + url.world) + place;
  if (state_.mode != Mode::kMesh && state_.mode != Mode::kDifference) link += state_.mode == Mode::kSplit ? "&mode=split" : "&mode=march";
  glfwSetClipboardString(window_.handle(), link.c_str());
  std::fprintf(stderr, "%s\n", link.c_str());
  state_.tell("The link to this place is copied.");
}

camera::Camera WorldWindow::camera() const {
  int width = 0, height = 0;
  glfwGetFramebufferSize(window_.handle(), &width, &height);
  camera::Camera out{controls_.pose(), {}};
  out.projection.width = static_cast<std::uint32_t>(std::max(width, 1));
  out.projection.height = static_cast<std::uint32_t>(std::max(height, 1));
  return out;
}

Start WorldWindow::place() const {
  constexpr double kDegrees = 180 / std::numbers::pi;
  const camera::Pose& pose = controls_.pose();
  return {{pose.x, pose.z}, std::clamp(aboveGround(), 2.0, 100000.0), pose.yaw * kDegrees, pose.pitch * kDegrees, controls_.flyingSpeed()};
}

double WorldWindow::aboveGround() const {
  const camera::Pose& pose = controls_.pose();
  return pose.y - ground_.height({pose.x, pose.z}).value_or(0);
}

// Once its height is known, unless the camera was moved.
void WorldWindow::placeAboveGround() {
  if (!placed_ || !ground_.height(start_.at)) return;
  if (controls_.pose() == *placed_) controls_.place(startPose(start_, ground_));
  placed_.reset();
}

// Says so while the driver compiles the terrain; once it has, draws with it.
Outcome<void> WorldWindow::watchCompiling() {
  if (!compiling_) return {};
  if (!compiling_->done()) {
    const std::string now = compiling_->describe();
    const bool isOurs = state_.hint.starts_with("compiling ");
    if (state_.hint.empty() || (isOurs && state_.hint != now)) state_.tell(now);
    return {};
  }
  compiling_ = nullptr;
  const wire::World& world = stream_.client().world();
  auto drawing = render::drawingOf(world, options_.remoteShaders);
  auto passes = render::createOrNeutral(world, drawing, Passes::create);
  if (!drawing.why.empty()) std::fprintf(stderr, "warning: %s\n", drawing.why.c_str());
  if (!passes) return passes.error();
  ground_.know(drawing);
  pictures_.emplace(std::move(*passes));
  canMarch_ = !drawing.text.neutral;
  if (!canMarch_) return {};
  state_.mode = wanted_;
  state_.tell("drawn with " + world.terrainName + "'s own colours");
  std::fprintf(stderr, "%s\n", state_.hint.c_str());
  return {};
}

void WorldWindow::fly(double seconds) {
  placeAboveGround();
  const Input input = devices_.read(seconds);
  controls_.setInvertY(state_.panel.invertY);
  path_.follow(input, controls_, ground_);
  controls_.step(input, seconds, [this](lattice::Point p) { return ground_.height(p); });
}

Outcome<void> WorldWindow::draw(bool last) {
  const camera::Camera seen = camera();
  path_.record(seen.pose);
  const bool newHeights = ground_.follow({seen.pose.x, seen.pose.z});
  editor_.update(seen, devices_.pointer(), stream_.sceneVersion());
  if (!state_.hint.empty() && Clock::now() > state_.hintEnds) {
    state_.hint.clear();
    state_.changed = true;
  }
  const auto updated = pictures_->update(ground_.view(seen), stream_, state_, newHeights);
  if (!updated) return updated.error();
  const bool drew = std::exchange(state_.changed, false) || *updated || state_.panel.open();
  idle_ = !drew && !pictures_->refining(state_.mode);
  state_.statistics.drawn.atRest = idle_ && state_.statistics.settled;
  if (drew || last || frames_.sincePresented() >= 0.5) present(seen, last);
  return {};
}

void WorldWindow::present(const camera::Camera& camera, bool last) {
  measure();
  outline(camera);
  pictures_->present(static_cast<int>(camera.projection.width), static_cast<int>(camera.projection.height), state_);
  if (wantsScreenshot_) state_.hint.clear();
  const Requests requests = overlay_.draw(state_);
  if (last && !options_.screenshot.empty()) screenshot(camera.projection, options_.screenshot);
  if (std::exchange(wantsScreenshot_, false)) {
    const std::filesystem::path file = freeName(".png");
    screenshot(camera.projection, file);
    state_.tell("The picture is saved in " + file.string() + ".");
  }
  glfwSwapBuffers(window_.handle());
  frames_.present(state_.statistics.plots);
  grant(requests);
}

void WorldWindow::measure() {
  if (const auto counted = frames_.count(state_.statistics.drawn)) stream_.measure(*counted);
  state_.statistics.knownReach = ground_.knownReach();
  Motion& m = state_.motion;
  m.keyframes = path_.keyframes();
  m.x = formatMetres(controls_.pose().x);
  m.z = formatMetres(controls_.pose().z);
  m.y = controls_.pose().y;
  m.aboveGround = aboveGround();
  m.speed = controls_.speed();
  m.walking = controls_.walking();
}

void WorldWindow::outline(const camera::Camera& camera) {
  const auto lines = [&camera](const camera::Camera& seen, double reach) {
    std::vector<Segment> out;
    for (const auto& [a, b] : frustumEdges(seen, camera.pose, reach))
      if (const auto line = segmentOf(camera, a, b)) out.push_back(*line);
    return out;
  };
  Outlines& out = state_.outlines;
  out = {};
  if (state_.lines.frozen) out.frozen = lines(*state_.lines.frozen, kFrozenReach);
  const core::Roster* others = stream_.others();
  if (!others) return;
  out.others = others->count();
  for (const auto& [id, other] : others->others()) {
    Outlines::Member member;
    member.camera = id;
    member.text = core::nameOf(other.member);
    member.colour = memberColour(id);
    if (other.member.moved) {
      const camera::Camera& seen = other.member.moved->pose.camera;
      const camera::Vec3 at = between(camera.pose, seen.pose);
      const double away = std::sqrt(at.x * at.x + at.y * at.y + at.z * at.z);
      member.away = away;
      member.text += ", " + distanceText(away);
      if (state_.panel.members && away <= 4 * stream_.client().world().horizon) member.at = spotOf(camera, at);
      if (member.at) member.lines = lines(seen, std::max(kMarkerReach, away / 20));
    }
    out.members.push_back(std::move(member));
  }
  std::ranges::stable_sort(out.members, {}, [](const Outlines::Member& m) { return m.away.value_or(HUGE_VAL); });
}

void WorldWindow::screenshot(const camera::Projection& size, const std::filesystem::path& file) const {
  const auto written = saveWindow(static_cast<int>(size.width), static_cast<int>(size.height), file);
  std::fprintf(stderr, "%s\n",
               written ? ("the picture is in " + file.string() + (pictures_->finished(state_) ? "" : ", and was still being built")).c_str()
                       : ("ridgecast-client: " + written.error().message).c_str());
}

}  // namespace ridgecast::viewer
