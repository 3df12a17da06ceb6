#include "client/evaluation/fly.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "client/evaluation/gltf_export.h"
#include "client/evaluation/popping.h"
#include "client/evaluation/recorder.h"
#include "client/render/context.h"
#include "client/render/height_texture.h"
#include "client/render/local_terrain.h"
#include "client/replica/client.h"
#include "client/scene/exchange_tiles.h"
#include "common/camera/path.h"

namespace ridgecast::evaluation {
namespace {

using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr auto kPatience = 120s;               // for one iteration in lock-step
constexpr auto kPoseInterval = 33ms;           // by the clock: poses a second at most 30
constexpr std::uint64_t kMostMismatches = 20;  // then something is broken for good

double secondsSince(Clock::time_point began) { return std::chrono::duration<double>(Clock::now() - began).count(); }

int fail(int code, const std::string& message) {
  std::fprintf(stderr, "ridgecast-client: %s\n", message.c_str());
  return code;
}

class Flight {
 public:
  Flight(const FlyOptions& options, camera::Path path, std::unique_ptr<replica::Client> client, render::Drawing drawing,
         render::Renderer renderer, Recorder recorder)
      : options_(options),
        path_(std::move(path)),
        client_(std::move(client)),
        scene_(client_->scene()),
        terrain_(std::move(drawing.terrain)),
        window_(std::move(drawing.window)),
        renderer_(std::move(renderer)),
        recorder_(std::move(recorder)),
        duration_(std::min(path_.duration(), options.seconds.value_or(path_.duration()))),
        pictureEvery_(options.framesEvery.value_or(std::max(duration_ / 6, 1 / options.rate))),
        nextPicture_(pictureEvery_),
        exportDue_(!options.exportFile.empty() && options.exportAt && *options.exportAt < duration_) {
    if (window_) texture_.emplace(window_->shape());
  }

  Outcome<void> fly() {
    // Drivers compile shaders when they are first used: not in the first picture's time.
    camera_ = cameraAt(0);
    if (broken_) return *broken_;
    render::View small = view();
    small.camera.projection.width = small.camera.projection.height = 16;
    if (auto drawn = renderer_.drawMarch(small); !drawn) return drawn.error();
    if (auto drawn = renderer_.drawMesh(scene_, small); !drawn) return drawn.error();
    if (options_.corrected)
      if (auto drawn = renderer_.drawCorrected(scene_.leaves(), small); !drawn) return drawn.error();

    auto flown = options_.realtime ? flyByTheClock() : flyInLockStep();
    if (!flown) return flown.error();
    if (pictures_ == 0 && drawsPictures())
      if (auto drawn = takePicture(number(scene_.iteration()), false); !drawn) return drawn.error();
    std::fprintf(stderr, "at the end of the path: waiting until nothing more is refined\n");
    const auto began = Clock::now();
    if (auto rested = options_.realtime ? restByTheClock() : restInLockStep(); !rested) return rested.error();
    totals_.settleSeconds = secondsSince(began);
    if (!totals_.settled)
      std::fprintf(stderr, "warning: still refining after %.0f s (--settle-limit); the settled pictures show the mesh as it is\n",
                   options_.settleLimit);
    return conclude();
  }

 private:
  // A height map's tiles around the camera are waited for, so that the same flight gives the same pictures.
  Outcome<void> fetchTiles(lattice::Point p) {
    window_->moveTo(p);
    if (client_->connection().reconnections() != reconnections_) {
      reconnections_ = client_->connection().reconnections();
      window_->forgetAsked();
    }
    for (const auto began = Clock::now(); !window_->complete();) {
      auto exchanged = scene::exchangeTiles(*client_->connection(), *window_);
      if (!exchanged) return exchanged.error();
      if (const auto why = client_->connection()->error()) {
        if (options_.realtime) break;  // it comes back
        return *why;
      }
      if (*exchanged) continue;
      if (Clock::now() - began > kPatience)
        return Error{"the server has not sent the heights around the camera for " + std::to_string(kPatience / 1s) + " s"};
      std::this_thread::sleep_for(1ms);
    }
    texture_->update(*window_, static_cast<std::size_t>(render::HeightTexture::kTiles * render::HeightTexture::kTiles));
    return {};
  }

  double ground(lattice::Point p) {
    if (window_)
      if (auto fetched = fetchTiles(p); !fetched) {
        if (!broken_) broken_ = fetched.error();
        return 0;
      }
    return terrain_ && (!window_ || window_->knows(p)) ? terrain_->height(p) : scene_.height(p).value_or(0);
  }

  camera::Camera cameraAt(double t) {
    camera::Camera camera;
    camera.pose = camera::poseAt(path_, t, [this](lattice::Point p) { return ground(p); });
    ground({camera.pose.x, camera.pose.z});
    camera.projection = {path_.verticalFov, options_.width, options_.height};
    return camera;
  }

  render::View view() const {
    render::View view;
    view.camera = camera_;
    view.horizon = client_->world().horizon;
    if (!terrain_) return view;
    const render::HeightBounds bounds = render::boundsAround(*terrain_, {camera_.pose.x, camera_.pose.z}, view.horizon);
    view.lowest = bounds.lowest;
    view.highest = bounds.highest;
    view.heights = texture_ ? &*texture_ : nullptr;
    return view;
  }

  bool drawsPictures() const { return options_.pictures && !options_.atRest; }

  static std::string number(std::uint64_t n) {
    char text[32];
    std::snprintf(text, sizeof text, "%04llu", static_cast<unsigned long long>(n));
    return text;
  }

  void sendPose(double t) {
    t_ = t;
    camera_ = cameraAt(t);
    sequence_ = client_->send(camera_);
    sent_[sequence_] = {Clock::now(), t};
    if (sent_.size() > 4096) sent_.erase(sent_.begin());
  }

  // Measures and judges one iteration.
  Outcome<void> take(const replica::Update& update) {
    const wire::Iteration& iteration = update.iteration;
    const auto began = Clock::now();
    IterationRecord record;
    record.bytes = update.bytes;
    record.applyMs = update.milliseconds;
    if (const auto pose = sent_.find(iteration.poseSequence); pose != sent_.end()) {
      record.latencyMs = secondsSince(pose->second.first) * 1e3 - update.milliseconds;
      record.t = pose->second.second;
      sent_.erase(sent_.begin(), pose);
    }
    record.hashOk = !update.wrong;
    record.held = scene_.triangles();
    settled_ = iteration.settled && record.hashOk;
    if (options_.measureFrames && !options_.realtime) {
      record.uploadMs = renderer_.upload(scene_.leaves());
      render::View small = view();
      small.camera.projection.width = std::max(small.camera.projection.width / 4, 16u);
      small.camera.projection.height = std::max(small.camera.projection.height / 4, 16u);
      auto drawn = renderer_.drawMesh(scene_, small);
      if (!drawn) return drawn.error();
      record.drawMs = drawn->milliseconds;
      unmeasured_ += secondsSince(began);
    }
    if (auto added = recorder_.add(iteration, record); !added) return added.error();
    if (update.wrong) {
      std::fprintf(stderr, "warning: %s; asking for leaves again\n", update.wrong->message.c_str());
      if (recorder_.hashMismatches() > kMostMismatches)
        return Error{"the mesh held differed from the server's in more than " + std::to_string(kMostMismatches) +
                     " iterations: the last time " + update.wrong->message};
    }
    return {};
  }

  // One pose and its iteration.
  Outcome<void> lockStep(double t) {
    const auto began = Clock::now();
    sendPose(t);
    if (broken_) return *broken_;
    const auto update = client_->await(sequence_, kPatience);
    if (!update) return update.error();
    if (auto taken = take(*update); !taken) return taken.error();
    totals_.seconds += secondsSince(began) - std::exchange(unmeasured_, 0.0);
    progress();
    return {};
  }

  Outcome<void> flyInLockStep() {
    const auto steps = static_cast<std::uint64_t>(std::floor(duration_ * options_.rate + 1e-9));
    for (std::uint64_t k = 0; k <= steps; ++k) {
      if (auto stepped = lockStep(static_cast<double>(k) / options_.rate); !stepped) return stepped.error();
      if (auto kept = keepWhatIsDue(); !kept) return kept.error();
    }
    return {};
  }

  Outcome<void> restInLockStep() {
    const auto began = Clock::now();
    constexpr std::size_t kMostStates = 40;
    if (options_.measurePopping) states_.push_back(scene_.leaves());
    while (!settled_ && secondsSince(began) < options_.settleLimit) {
      if (auto stepped = lockStep(t_); !stepped) return stepped.error();
      if (options_.measurePopping && states_.size() < kMostStates) states_.push_back(scene_.leaves());
    }
    totals_.settled = settled_;
    return {};
  }

  // Takes iterations until `until`; waits no longer than that.
  Outcome<void> takeUntil(Clock::time_point until) {
    do {
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now());
      if (const auto update = client_->receive(std::max(left, 0ms))) {
        if (auto taken = take(*update); !taken) return taken.error();
        settledPose_ = settled_ ? update->iteration.poseSequence : 0;
      }
    } while (Clock::now() < until);
    progress();
    return {};
  }

  // The clock stands still while pictures are drawn.
  Outcome<void> flyByTheClock() {
    for (double t = 0; t < duration_; t = totals_.seconds) {
      sendPose(t);
      if (broken_) return *broken_;
      const auto stepped = Clock::now();
      if (auto taken = takeUntil(stepped + kPoseInterval); !taken) return taken.error();
      totals_.seconds += secondsSince(stepped);
      if (auto kept = keepWhatIsDue(); !kept) return kept.error();
    }
    return {};
  }

  Outcome<void> restByTheClock() {
    const auto began = Clock::now();
    sendPose(duration_);
    while (settledPose_ < sequence_ && secondsSince(began) < options_.settleLimit) {
      const auto stepped = Clock::now();
      if (auto taken = takeUntil(stepped + 50ms); !taken) return taken.error();
      totals_.seconds += secondsSince(stepped);
    }
    if (const auto why = client_->connection().error()) return *why;
    totals_.settled = settledPose_ >= sequence_;
    return {};
  }

  Outcome<void> keepWhatIsDue() {
    if (t_ + 1e-6 >= nextPicture_ && drawsPictures()) {
      nextPicture_ = (std::floor((t_ + 1e-6) / pictureEvery_) + 1) * pictureEvery_;
      if (auto drawn = takePicture(number(scene_.iteration()), false); !drawn) return drawn.error();
    }
    if (exportDue_ && t_ + 1e-6 >= *options_.exportAt) {
      exportDue_ = false;
      if (auto written = exportMesh(); !written) return written.error();
      exported_ = true;
    }
    return {};
  }

  Outcome<void> takePicture(const std::string& name, bool atRest) {
    if (!terrain_) {  // nothing to compare with
      ++pictures_;
      return recorder_.meshPicture(name, renderer_, scene_, view(), options_.supersample);
    }
    auto compared = recorder_.picture(
        name, renderer_, scene_, view(),
        {options_.supersample, options_.corrected, options_.unfiltered, options_.references ? options_.references : &lastMarch_});
    if (!compared) return compared.error();
    atRest ? recorder_.setSettled(*compared) : recorder_.addFrame(*compared, t_);
    ++pictures_;
    const Similarity& similarity = compared->mesh;
    std::string terrain;
    if (similarity.terrain) terrain = ", terrain alone " + std::to_string(*similarity.terrain).substr(0, 6);
    if (compared->corrected) terrain += ", corrected " + std::to_string(compared->corrected->mean).substr(0, 6);
    std::fprintf(stderr, "%s-mesh.png, %s-raymarch.png: SSIM %.4f%s (%.0f %% of the picture), %llu triangles\n", name.c_str(), name.c_str(),
                 similarity.mean, terrain.c_str(), similarity.terrainShare * 100, static_cast<unsigned long long>(scene_.triangles()));
    return {};
  }

  Outcome<void> exportMesh() {
    const wire::World& world = client_->world();
    if (auto written = writeGlb(scene_.leaves(), camera_.pose, {world.terrainName, world.seed}, options_.exportFile); !written)
      return written.error();
    std::fprintf(stderr, "%s: the %llu triangles held at %.2f s\n", options_.exportFile.c_str(),
                 static_cast<unsigned long long>(scene_.triangles()), t_);
    return {};
  }

  void progress() {
    if (Clock::now() < nextProgress_) return;
    nextProgress_ = Clock::now() + 2s;
    std::fprintf(stderr, "%7.1f of %.1f s, iteration %llu, %llu triangles, %.1f MB received\n", t_, duration_,
                 static_cast<unsigned long long>(scene_.iteration()), static_cast<unsigned long long>(scene_.triangles()),
                 static_cast<double>(client_->connection().bytesReceived()) / 1e6);
  }

  Outcome<void> conclude() {
    if (!options_.exportFile.empty() && !exported_)
      if (auto written = exportMesh(); !written) return written.error();
    if (options_.atRest) {
      if (auto measured = options_.atRest({renderer_, scene_, view(), terrain_.get(), totals_.settled}); !measured) return measured.error();
    } else if (options_.pictures) {
      if (auto drawn = takePicture("settled", true); !drawn) return drawn.error();
    }
    if (!states_.empty()) {
      std::fprintf(stderr, "drawing %zu iterations at 60 frames a second, with and without morphing\n", states_.size());
      render::View small = view();
      small.camera.projection.width = std::min(small.camera.projection.width, 320u);
      small.camera.projection.height = std::min(small.camera.projection.height, 180u);
      auto popping = measurePopping(renderer_, small, states_);
      if (!popping) return popping.error();
      std::fprintf(stderr, "popping: 1 - SSIM from frame to frame at most %.4f with morphing, %.4f without\n", popping->worstOn,
                   popping->worstOff);
      totals_.popping = std::move(*popping);
    }
    totals_.bytesReceived = client_->connection().bytesReceived();
    totals_.pacing = options_.realtime ? "realtime" : "lockstep";
    totals_.path = options_.path.filename().string();
    totals_.renderer = render::contextDescription();
    return recorder_.writeSummary(client_->world(), scene_, view(), options_.supersample, totals_);
  }

  const FlyOptions& options_;
  camera::Path path_;
  std::unique_ptr<replica::Client> client_;
  const scene::Scene& scene_;
  std::shared_ptr<const terrain::Terrain> terrain_;
  std::shared_ptr<scene::HeightWindow> window_;  // of a height map; else null
  std::optional<render::HeightTexture> texture_;
  std::optional<Error> broken_;  // its tiles did not come
  render::Renderer renderer_;
  Recorder recorder_;
  References lastMarch_{1};  // the picture at rest often is where the last one was
  camera::Camera camera_;

  std::vector<render::Morph::Leaves> states_;  // of the standing camera, when popping is measured
  double t_ = 0, duration_, pictureEvery_, nextPicture_;
  bool exportDue_, exported_ = false, settled_ = false;
  double unmeasured_ = 0;  // seconds of this step that went into frames
  std::uint64_t sequence_ = 0, settledPose_ = 0, pictures_ = 0, reconnections_ = 0;
  std::map<std::uint64_t, std::pair<Clock::time_point, double>> sent_;  // pose sequence -> when, path time; at most 4,096
  Clock::time_point nextProgress_ = Clock::now();
  Totals totals_;
};

}  // namespace

int fly(const FlyOptions& options) {
  auto path = camera::readPath(options.path);
  if (!path) return fail(kBadInput, path.error().message);
  auto recorder = Recorder::create(options.out);
  if (!recorder) return fail(kBadInput, recorder.error().message);
  auto context = render::HeadlessContext::create();
  if (!context) return fail(kNoGraphics, context.error().message);

  wire::Hello hello;
  hello.clientName = "ridgecast-client fly";
  hello.settings = options.settings;
  hello.pacing = options.realtime ? wire::Pacing::kFree : wire::Pacing::kLockstep;
  auto connected = replica::Client::open(options.url, hello, {.reconnects = options.realtime});
  if (!connected) return fail(kRuntimeFailure, connected.error().message);
  const wire::World& world = (*connected)->world();
  auto drawing = render::drawingOf(world, options.remoteShaders);
  auto renderer = render::createOrNeutral(world, drawing, render::Renderer::create);
  if (!drawing.why.empty()) std::fprintf(stderr, "warning: %s\n", drawing.why.c_str());
  if (!path->terrain.empty() && (path->terrain != world.terrainName || path->seed != world.seed))
    std::fprintf(stderr, "warning: the path was made for terrain %s, seed %u; the server has %s, seed %u\n", path->terrain.c_str(),
                 path->seed, world.terrainName.c_str(), world.seed);
  if (!renderer) return fail(kNoGraphics, renderer.error().message);
  std::fprintf(stderr, "flying %s over %s (seed %u, horizon %.0f m), %ux%u, %s\n", options.path.filename().c_str(),
               world.terrainName.c_str(), world.seed, world.horizon, options.width, options.height, render::contextDescription().c_str());

  Flight flight(options, std::move(*path), std::move(*connected), std::move(drawing), std::move(*renderer), std::move(*recorder));
  if (auto flown = flight.fly(); !flown) return fail(kRuntimeFailure, flown.error().message);
  std::fprintf(stderr, "figures in %s\n", (options.out / "summary.json").c_str());
  return kSuccess;
}

}  // namespace ridgecast::evaluation
