#include "client/viewer/viewer.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <epoxy/gl.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/connection/resuming.h"
#include "client/render/context.h"
#include "client/render/difference_pass.h"
#include "client/render/height_texture.h"
#include "client/render/local_terrain.h"
#include "client/render/renderer.h"
#include "client/scene/exchange_tiles.h"
#include "client/scene/scene.h"
#include "client/viewer/controls.h"
#include "client/viewer/overlay.h"
#include "client/viewer/panes.h"
#include "client/viewer/path_recorder.h"

namespace ridgecast::viewer {
namespace {

using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr auto kPoseInterval = 33ms;    // poses a second at most 30
constexpr double kBoundsMargin = 4000;  // metres that the camera may fly before the highest ground is looked for again

int fail(int code, const std::string& message) {
  std::fprintf(stderr, "ridgecast-client: %s\n", message.c_str());
  return code;
}

double secondsSince(Clock::time_point began) { return std::chrono::duration<double>(Clock::now() - began).count(); }

// GLFW's own start and end, and the window.
class Window {
 public:
  static Outcome<std::unique_ptr<Window>> open(std::uint32_t width, std::uint32_t height) {
    glfwSetErrorCallback(nullptr);
    auto window = std::unique_ptr<Window>(new Window);
    if (!glfwInit())
      return Error{"no window can be opened here (" + reason() + "): set DISPLAY, or use `ridgecast-client fly`, which needs no display"};
    window->started_ = true;
    glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
    glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    glfwWindowHint(GLFW_OPENGL_FORWARD_COMPAT, GLFW_TRUE);
    glfwWindowHint(GLFW_VISIBLE, GLFW_FALSE);
    window->handle_ = glfwCreateWindow(static_cast<int>(width), static_cast<int>(height), "Ridgecast", nullptr, nullptr);
    if (!window->handle_)
      return Error{"this display offers no OpenGL 3.3 core (" + reason() +
                   "): install a newer graphics driver, or use `ridgecast-client fly`"};
    glfwMakeContextCurrent(window->handle_);
    glfwSwapInterval(1);
    return window;
  }
  ~Window() {
    if (handle_) glfwDestroyWindow(handle_);
    if (started_) glfwTerminate();
  }
  GLFWwindow* handle() const { return handle_; }

 private:
  Window() = default;
  static std::string reason() {
    const char* text = nullptr;
    glfwGetError(&text);
    return text ? text : "no reason given";
  }
  GLFWwindow* handle_ = nullptr;
  bool started_ = false;
};

class Viewer {
 public:
  Viewer(const ViewOptions& options, GLFWwindow* window, std::unique_ptr<connection::Resuming> connection, render::Drawing drawing,
         render::MeshPass mesh, render::MeshPass before, render::MorphPass morph, render::MarchPass march, render::ShadePass shade,
         render::DifferencePass difference)
      : options_(options),
        window_(window),
        connection_(std::move(connection)),
        terrain_(std::move(drawing.terrain)),
        heights_(std::move(drawing.window)),
        shade_(std::move(shade)),
        mesh_(std::move(mesh), std::move(before), std::move(morph), shade_),
        march_(std::move(march), shade_),
        difference_(std::move(difference)),
        controls_(startPose()) {
    glfwSetWindowUserPointer(window_, this);
    glfwSetKeyCallback(window_, [](GLFWwindow* w, int key, int, int action, int) { self(w).onKey(key, action); });
    glfwSetScrollCallback(window_, [](GLFWwindow* w, double, double notches) { self(w).input_.wheel += notches; });
    glfwSetCursorPosCallback(window_, [](GLFWwindow* w, double x, double y) { self(w).onMove(x, y); });
    glfwSetMouseButtonCallback(window_, [](GLFWwindow* w, int button, int action, int) { self(w).onButton(button, action); });
    overlay_.emplace(window_);
    const wire::World& world = connection_->world();
    if (heights_) texture_.emplace(heights_->shape());
    scene_.expectShades(world.shadedVertices);
    if (!terrain_) shown_.mode = Mode::kMesh;
    contentHash_ = world.contentHash;
    shown_.world = world.terrainName + ", seed " + std::to_string(world.seed) + ", from " + world.serverName;
  }

  // A new connection has begun: what is held of the last one. Another world than the one that is drawn is the end.
  std::vector<wire::HeldLeaf> resume(const wire::World& world) {
    if (world.contentHash != contentHash_) {
      otherWorld_ = true;
      return {};
    }
    scene_.reconnect();
    return scene_.held();
  }

  int run() {
    const auto began = Clock::now();
    auto last = began;
    glfwShowWindow(window_);
    for (;;) {
      // At rest there is nothing to draw: wait for input, but look at the connection now and then.
      if (idle_)
        glfwWaitEventsTimeout(0.02);
      else
        glfwPollEvents();
      const bool ends = glfwWindowShouldClose(window_) || (options_.seconds && secondsSince(began) >= *options_.seconds);
      const double elapsed = std::min(secondsSince(std::exchange(last, Clock::now())), 0.25);
      fly(elapsed);
      converse();
      if (auto drawn = draw(ends); !drawn) return fail(1, drawn.error().message);
      if (ends) break;
    }
    return 0;
  }

 private:
  static Viewer& self(GLFWwindow* w) { return *static_cast<Viewer*>(glfwGetWindowUserPointer(w)); }

  camera::Pose startPose() const {
    camera::Pose pose;
    pose.x = std::llround(options_.x * lattice::kStepsPerMetre);
    pose.z = std::llround(options_.z * lattice::kStepsPerMetre);
    pose.y = ground({pose.x, pose.z}).value_or(0) + options_.altitude;
    pose.yaw = options_.yaw * std::numbers::pi / 180;
    pose.pitch = options_.pitch * std::numbers::pi / 180;
    return pose;
  }

  std::optional<double> ground(lattice::Point p) const {
    return terrain_ && (!heights_ || heights_->knows(p)) ? terrain_->height(p) : scene_.height(p);
  }

  // Whether the samples that are drawn with have changed.
  bool exchangeHeights() {
    if (!heights_) return false;
    if (reconnections_ != connection_->reconnections()) {
      reconnections_ = connection_->reconnections();
      heights_->forgetAsked();
    }
    heights_->moveTo({controls_.pose().x, controls_.pose().z});
    if (auto exchanged = scene::exchangeTiles(*connection_, *heights_); !exchanged)
      std::fprintf(stderr, "warning: %s\n", exchanged.error().message.c_str());
    const std::uint64_t before = texture_->version();
    texture_->update(*heights_, 16);
    shown_.knownReach = heights_->knownReach();
    return texture_->version() != before;
  }

  // ---- input ----

  void freeMouse(bool free) {
    shown_.mouseFree = free;
    glfwSetInputMode(window_, GLFW_CURSOR, free ? GLFW_CURSOR_NORMAL : GLFW_CURSOR_DISABLED);
    lastCursor_.reset();
  }

  void onKey(int key, int action) {
    if (action != GLFW_PRESS) return;
    changed_ = true;
    switch (key) {
      case GLFW_KEY_1:
        shown_.mode = Mode::kMesh;
        break;
      case GLFW_KEY_2:
        shown_.mode = Mode::kMarch;
        break;
      case GLFW_KEY_3:
        shown_.mode = Mode::kSplit;
        break;
      case GLFW_KEY_F1:
        shown_.help = !shown_.help;
        break;
      case GLFW_KEY_4:
        shown_.mode = Mode::kDifference;
        break;
      case GLFW_KEY_M:
        mesh_.setSmooth(shown_.smooth = !shown_.smooth);
        break;
      case GLFW_KEY_R:
        record();
        break;
      case GLFW_KEY_F12:
        wantsScreenshot_ = true;
        break;
      case GLFW_KEY_F3:
        shown_.figures = !shown_.figures;
        break;
      case GLFW_KEY_ESCAPE:
        if (shown_.mouseFree)
          glfwSetWindowShouldClose(window_, GLFW_TRUE);
        else
          freeMouse(true);
        break;
      default:
        break;
    }
  }

  // Names that are not taken: ridgecast-1.json, ridgecast-2.json, ...
  static std::filesystem::path freeName(const std::string& ending) {
    for (int k = 1;; ++k) {
      std::filesystem::path file = "ridgecast-" + std::to_string(k) + ending;
      std::error_code ignored;
      if (!std::filesystem::exists(file, ignored)) return file;
    }
  }

  void record() {
    if (!recorder_) {
      recorder_.emplace(connection_->world().terrainName, connection_->world().seed);
      return;
    }
    const std::filesystem::path file = freeName(".json");
    const auto written = recorder_->write(file);
    std::fprintf(stderr, "%s\n", written ? ("the path flown is in " + file.string()).c_str() : written.error().message.c_str());
    recorder_.reset();
  }

  double windowWidth() const {
    int width = 0, height = 0;
    glfwGetWindowSize(window_, &width, &height);
    return std::max(width, 1);
  }

  void moveDivider(double to) {
    shown_.divider = std::clamp(to, 0.02, 0.98);
    changed_ = true;
  }

  void onMove(double x, double y) {
    if (dragging_) moveDivider(x / windowWidth());
    if (!shown_.mouseFree && lastCursor_) {
      input_.turnX += x - lastCursor_->first;
      input_.turnY += y - lastCursor_->second;
    }
    lastCursor_ = {x, y};
  }

  void onButton(int button, int action) {
    if (button != GLFW_MOUSE_BUTTON_LEFT) return;
    if (action == GLFW_RELEASE) {
      dragging_ = false;
      return;
    }
    if (!shown_.mouseFree) return;
    double x = 0, y = 0;
    glfwGetCursorPos(window_, &x, &y);
    if (shown_.mode == Mode::kSplit && std::abs(x - shown_.divider * windowWidth()) < 10)
      dragging_ = true;
    else
      freeMouse(false);
  }

  bool held(int key) const { return glfwGetKey(window_, key) == GLFW_PRESS; }

  void fly(double seconds) {
    input_.forward = held(GLFW_KEY_W) - held(GLFW_KEY_S);
    input_.right = held(GLFW_KEY_D) - held(GLFW_KEY_A);
    input_.up =
        (held(GLFW_KEY_E) || held(GLFW_KEY_SPACE)) - (held(GLFW_KEY_Q) || held(GLFW_KEY_LEFT_CONTROL) || held(GLFW_KEY_RIGHT_CONTROL));
    input_.sprint = held(GLFW_KEY_LEFT_SHIFT) || held(GLFW_KEY_RIGHT_SHIFT);
    if (const int arrows = held(GLFW_KEY_RIGHT) - held(GLFW_KEY_LEFT)) moveDivider(shown_.divider + arrows * 0.5 * seconds);
    if (input_.wheel != 0) changed_ = true;
    controls_.step(input_, seconds, [this](lattice::Point p) { return ground(p); });
    input_ = {};
  }

  // ---- the server ----

  void converse() {
    if (otherWorld_) return;
    for (int k = 0; k < 4; ++k) {  // a few at a time: the window goes first
      const auto received = connection_->receive(0ms);
      if (!received) break;
      take(*received);
    }
    const auto why = connection_->error();
    if (otherWorld_) {
      shown_.message = "The server has another world now: start the viewer anew to see it.\nThe picture shows what had arrived. Esc quits.";
      changed_ = true;
    } else if (why && !lost_) {
      shown_.message =
          "The connection to the server is lost: " + why->message + "\nThe picture shows what had arrived; trying again. Esc quits.";
      std::fprintf(stderr, "ridgecast-client: %s; trying again\n", why->message.c_str());
      changed_ = true;
    } else if (!why && lost_) {
      shown_.message.clear();
      std::fprintf(stderr, "ridgecast-client: connected again\n");
      changed_ = true;
    }
    lost_ = why.has_value();
    sendPose();
  }

  void take(const connection::Received& received) {
    const wire::Iteration& iteration = received.iteration;
    const auto applied = scene_.apply(iteration);
    const bool same = applied && scene_.hash() == iteration.meshHash;
    if (applied && scene_.damaged()) {
      if (const auto damaged = scene_.takeDamaged(); !damaged.empty()) connection_->resend({damaged});
    } else if (!same) {
      std::fprintf(stderr, "warning: the mesh held after iteration %llu is not the server's%s; asking for all leaves again\n",
                   static_cast<unsigned long long>(iteration.number), applied ? "" : (" (" + applied.error().message + ")").c_str());
      if (!applied) scene_.clear();
      connection_->resend({});
    }
    connection_->acknowledge({iteration.number, scene_.hash()});
    ++sceneVersion_;
    ++iterationsCounted_;
    shown_.hashOk = same;
    shown_.settled = iteration.settled && same;
    shown_.iteration = iteration.number;
    shown_.triangles = scene_.triangles();
    shown_.leaves = scene_.leaves().size();
    if (const auto pose = sent_.find(iteration.poseSequence); pose != sent_.end()) {
      shown_.latencyMs = secondsSince(pose->second) * 1e3;
      sent_.erase(sent_.begin(), std::next(pose));
    }
    changed_ = true;
  }

  void sendPose() {
    const camera::Camera camera{controls_.pose(), projection()};
    const bool same = sentCamera_ && sameView(*sentCamera_, camera);
    if (same || Clock::now() - sentAt_ < kPoseInterval) return;
    sentCamera_ = camera;
    sentAt_ = Clock::now();
    sent_[++sequence_] = sentAt_;
    if (sent_.size() > 256) sent_.erase(sent_.begin());
    connection_->send({sequence_, camera});
  }

  static bool sameView(const camera::Camera& a, const camera::Camera& b) {
    return a.pose.x == b.pose.x && a.pose.z == b.pose.z && a.pose.remainderX == b.pose.remainderX &&
           a.pose.remainderZ == b.pose.remainderZ && a.pose.y == b.pose.y && a.pose.yaw == b.pose.yaw && a.pose.pitch == b.pose.pitch &&
           a.projection.width == b.projection.width && a.projection.height == b.projection.height;
  }

  // ---- pictures ----

  camera::Projection projection() const {
    int width = 0, height = 0;
    glfwGetFramebufferSize(window_, &width, &height);
    camera::Projection out;
    out.width = static_cast<std::uint32_t>(std::max(width, 1));
    out.height = static_cast<std::uint32_t>(std::max(height, 1));
    return out;
  }

  render::View currentView() {
    render::View view;
    view.camera = {controls_.pose(), projection()};
    view.horizon = connection_->world().horizon;
    view.heights = texture_ ? &*texture_ : nullptr;
    if (terrain_) {
      const camera::Pose& pose = view.camera.pose;
      const double moved =
          boundsAt_ ? std::hypot(static_cast<double>(pose.x - boundsAt_->x), static_cast<double>(pose.z - boundsAt_->z)) : 0;
      if (!boundsAt_ || moved * lattice::kMetresPerStep > kBoundsMargin) {
        boundsAt_ = lattice::Point{pose.x, pose.z};
        bounds_ = render::boundsAround(*terrain_, *boundsAt_, view.horizon + kBoundsMargin);
      }
      view.lowest = bounds_.lowest;
      view.highest = bounds_.highest;
    }
    return view;
  }

  Outcome<void> draw(bool last) {
    if (recorder_) recorder_->add(std::chrono::duration<double>(Clock::now().time_since_epoch()).count(), controls_.pose());
    const bool newHeights = exchangeHeights();
    const render::View view = currentView();
    const bool moving = newHeights || !drawnCamera_ || !sameView(*drawnCamera_, view.camera);
    drawnCamera_ = view.camera;
    bool drew = std::exchange(changed_, false) || moving;
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

  void present(const render::View& view, bool last) {
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
    glBindFramebuffer(GL_FRAMEBUFFER, 0);
    glViewport(0, 0, width, height);
    overlay_->draw(shown_);
    if (last && !options_.screenshot.empty()) screenshot(width, height, options_.screenshot);
    if (std::exchange(wantsScreenshot_, false)) screenshot(width, height, freeName(".png"));
    glfwSwapBuffers(window_);
    presentedAt_ = Clock::now();
    ++framesCounted_;
  }

  void tellFigures() {
    const double counted = secondsSince(countedSince_);
    if (counted >= 0.5) {
      shown_.framesPerSecond = static_cast<double>(std::exchange(framesCounted_, 0)) / counted;
      shown_.iterationsPerSecond = static_cast<double>(std::exchange(iterationsCounted_, 0)) / counted;
      countedSince_ = Clock::now();
    }
    const camera::Pose& pose = controls_.pose();
    shown_.recording = recorder_.has_value();
    shown_.keyframes = recorder_ ? recorder_->keyframes() : 0;
    shown_.meshMs = mesh_.milliseconds();
    shown_.marchMs = march_.milliseconds();
    shown_.coarseness = march_.coarseness();
    shown_.progress = march_.progress();
    shown_.bytes = connection_->bytesReceived();
    shown_.x = static_cast<double>(pose.x) * lattice::kMetresPerStep;
    shown_.z = static_cast<double>(pose.z) * lattice::kMetresPerStep;
    shown_.y = pose.y;
    shown_.aboveGround = pose.y - ground({pose.x, pose.z}).value_or(0);
    shown_.speed = controls_.speed();
  }

  void screenshot(int width, int height, const std::filesystem::path& file) {
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
    if (auto written = render::writePng(picture, file); !written)
      std::fprintf(stderr, "ridgecast-client: %s\n", written.error().message.c_str());
  }

  const ViewOptions& options_;
  GLFWwindow* window_;
  std::unique_ptr<connection::Resuming> connection_;
  std::shared_ptr<const terrain::Terrain> terrain_;  // null: not known here
  std::shared_ptr<scene::HeightWindow> heights_;     // of a height map, the same terrain; else null
  std::optional<render::HeightTexture> texture_;
  std::uint64_t reconnections_ = 0;
  scene::Scene scene_;
  render::ShadePass shade_;
  MeshPane mesh_;
  MarchPane march_;
  render::DifferencePass difference_;
  Controls controls_;
  std::optional<PathRecorder> recorder_;
  bool wantsScreenshot_ = false;
  std::optional<Overlay> overlay_;
  Shown shown_;
  Input input_;

  std::optional<std::pair<double, double>> lastCursor_;
  bool dragging_ = false, changed_ = true, idle_ = false, lost_ = false, otherWorld_ = false, meshStale_ = false, marchStale_ = false;
  std::optional<camera::Camera> sentCamera_, drawnCamera_;
  std::map<std::uint64_t, Clock::time_point> sent_;  // pose sequence -> when; at most 256
  Clock::time_point sentAt_{}, presentedAt_{}, countedSince_ = Clock::now();
  std::uint64_t sequence_ = 0, sceneVersion_ = 0, contentHash_ = 0;
  int framesCounted_ = 0, iterationsCounted_ = 0;
  std::optional<lattice::Point> boundsAt_;
  render::HeightBounds bounds_;
};

}  // namespace

int view(const ViewOptions& options) {
  auto window = Window::open(options.width, options.height);
  if (!window) return fail(3, window.error().message);
  wire::Hello hello;
  hello.clientName = "ridgecast-client view";
  hello.settings = options.settings;
  Viewer* viewing = nullptr;
  auto connected = connection::Resuming::open(options.url, hello, [&viewing](const wire::World& world) { return viewing->resume(world); });
  if (!connected) return fail(1, connected.error().message);
  const wire::World& world = (*connected)->world();
  auto drawing = render::drawingOf(world, options.remoteShaders);
  if (!drawing.why.empty()) std::fprintf(stderr, "warning: %s\n", drawing.why.c_str());
  auto mesh = render::MeshPass::create(drawing.text.shaded);
  if (!mesh) return fail(3, mesh.error().message);
  auto before = render::MeshPass::create(drawing.text.shaded);
  if (!before) return fail(3, before.error().message);
  auto morph = render::MorphPass::create();
  if (!morph) return fail(3, morph.error().message);
  auto march = render::MarchPass::create(drawing.text);
  if (!march) return fail(3, march.error().message);
  auto shade = render::ShadePass::create(drawing.text);
  if (!shade) return fail(3, shade.error().message);
  auto difference = render::DifferencePass::create();
  if (!difference) return fail(3, difference.error().message);
  std::fprintf(stderr, "viewing %s, seed %u, %s; F1 help\n", world.terrainName.c_str(), world.seed, render::contextDescription().c_str());
  if (drawing.window) {  // the ground where the flight begins
    drawing.window->moveTo({std::llround(options.x * lattice::kStepsPerMetre), std::llround(options.z * lattice::kStepsPerMetre)});
    for (const auto began = Clock::now(); !drawing.window->complete() && secondsSince(began) < 5;) {
      if (auto exchanged = scene::exchangeTiles(**connected, *drawing.window); !exchanged) return fail(1, exchanged.error().message);
      std::this_thread::sleep_for(2ms);
    }
  }
  Viewer viewer(options, (*window)->handle(), std::move(*connected), std::move(drawing), std::move(*mesh), std::move(*before),
                std::move(*morph), std::move(*march), std::move(*shade), std::move(*difference));
  viewing = &viewer;
  return viewer.run();
}

}  // namespace ridgecast::viewer
