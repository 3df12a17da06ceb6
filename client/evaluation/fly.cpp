#include "client/evaluation/fly.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/evaluation/popping.h"
#include "client/exit/exit.h"
#include "client/link/client.h"
#include "client/render/context.h"
#include "client/render/edit_texture.h"
#include "client/render/height_texture.h"
#include "client/render/local_terrain.h"
#include "common/camera/path.h"
#include "common/edits/edited_terrain.h"
#include "common/settings/settings.h"

namespace ridgecast::evaluation {

using namespace std::chrono_literals;

namespace {

constexpr auto kTilesTimeout = 120s;          // for the heights around the camera
constexpr std::uint64_t kMaxMismatches = 20;  // then something is broken for good
constexpr std::size_t kMaxStates = 40;
constexpr double kSameTime = 1e-6;  // seconds

// Of the newest iteration.
std::string numberOf(const core::Scene& scene) {
  char text[32];
  std::snprintf(text, sizeof text, "%04llu", static_cast<unsigned long long>(scene.iteration()));
  return text;
}

// What the pictures of a world are drawn with.
struct Drawer {
  render::Drawing drawing;
  render::Renderer renderer;
  static Outcome<Drawer> create(const wire::World& world, bool remoteShaders) {
    if (render::compilesText(world, remoteShaders))
      std::fprintf(stderr, "the graphics driver compiles terrain %s; a software driver may take a minute\n", world.terrainName.c_str());
    auto drawing = render::drawingOf(world, remoteShaders);
    auto renderer = render::createOrNeutral(world, drawing, render::Renderer::create);
    if (!drawing.why.empty()) std::fprintf(stderr, "warning: %s\n", drawing.why.c_str());
    if (!renderer) return renderer.error();
    return Drawer{std::move(drawing), std::move(*renderer)};
  }
};

// What this client knows of the ground itself: the terrain, with the height map's tiles and the edits around the camera.
class KnownGround {
 public:
  KnownGround(link::Client& client, render::Drawing drawing)
      : client_(client),
        terrain_(std::move(drawing.terrain)),
        edited_(terrain_),
        window_(std::move(drawing.window)),
        edits_(client.world().horizon) {
    if (window_) texture_.emplace(window_->shape());
  }

  const terrain::Terrain* terrain() const { return edited_.get(); }  // null: unknown

  // Waits for a height map's tiles and for edits around the camera, so that the same flight gives the same pictures. True: edits changed
  // what is known. By the clock, a lost connection is not waited for.
  Outcome<bool> fetch(lattice::Point p, bool isRealtime) {
    if (!terrain_) return false;
    edits_.moveTo(p);
    if (window_) window_->moveTo(p);
    for (const auto until = std::chrono::steady_clock::now() + kTilesTimeout;;) {
      auto exchanged = client_.exchangeEdits(edits_);
      if (exchanged && window_) exchanged = client_.exchangeTiles(*window_);
      if (!exchanged) return exchanged.error();
      if (edits_.complete() && (!window_ || window_->complete())) break;
      const auto lost = client_.connection().error();
      if (lost && isRealtime) break;  // it comes back
      if (lost) return *lost;
      if (*exchanged) continue;
      if (!client_.connection().wait(std::chrono::ceil<std::chrono::milliseconds>(until - std::chrono::steady_clock::now()),
                                     [](const core::Reconnector& r) { return r.lost() || r.conversation().hasGround(); }))
        return Error{"the server has not sent the heights around the camera for " + std::to_string(kTilesTimeout / 1s) + " s"};
    }
    if (window_) texture_->update(*window_, static_cast<std::size_t>(render::HeightTexture::kTiles * render::HeightTexture::kTiles));
    editTexture_.update(edits_, p, core::HeldEdits::kMaxHeld);
    if (std::exchange(editsSeen_, edits_.version()) == edits_.version()) return false;
    edited_ = std::make_shared<edits::EditedTerrain>(terrain_, edits_.layer());
    return true;
  }
  std::optional<double> height(lattice::Point p) const {
    return terrain_ && (!window_ || window_->knows(p)) ? std::optional(edited_->height(p)) : std::nullopt;
  }
  void addTo(render::View& view) const {
    if (!terrain_) return;
    const render::HeightBounds bounds = render::boundsAround(*edited_, {view.camera.pose.x, view.camera.pose.z}, view.horizon);
    view.lowest = bounds.lowest;
    view.highest = bounds.highest;
    view.heights = texture_ ? &*texture_ : nullptr;
    view.edits = &editTexture_;
  }

 private:
  link::Client& client_;
  std::shared_ptr<const terrain::Terrain> terrain_, edited_;  // edited_: with edits_
  std::shared_ptr<core::HeightWindow> window_;                // of a height map; otherwise null
  std::optional<render::HeightTexture> texture_;
  core::HeldEdits edits_;
  std::uint64_t editsSeen_ = 0;
  render::EditTexture editTexture_;
};

class Measurer final : flight::Observer {
 public:
  Measurer(const FlyOptions& options, camera::Path path, link::Client& client, Drawer drawer, Recorder recorder)
      : options_(options),
        client_(client),
        scene_(client.scene()),
        ground_(std::in_place, client, std::move(drawer.drawing)),
        renderer_(std::move(drawer.renderer)),
        recorder_(std::move(recorder)),
        flight_(
            options, std::move(path), client, [this](lattice::Point p) { return ground(p); }, *this),
        pictureEvery_(options.framesEvery.value_or(std::max(flight_.duration() / 6, 1 / options.rate))),
        nextPicture_(pictureEvery_) {}

  Outcome<void> run() {
    if (auto warm = warmUp(); !warm) return warm;
    if (auto flown = flight_.fly(); !flown) return flown;
    if (pictures_ == 0 && drawsPictures())
      if (auto drawn = takePicture(numberOf(scene_), false); !drawn) return drawn;
    std::fprintf(stderr, "at the end of the path: waiting until nothing more is refined\n");
    const auto began = Clock::now();
    resting_ = true;
    if (options_.measurePopping) states_.push_back(scene_.leaves());
    auto settled = flight_.settle();
    while (!settled && client_.connection().otherWorld()) {
      if (auto entered = enterOtherWorld(); !entered) return entered;
      settled = flight_.settle();
    }
    if (!settled) return settled.error();
    FlightSummary& summary = recorder_.summary();
    summary.isSettled = *settled;
    summary.settleSeconds = std::chrono::duration<double>(Clock::now() - began).count();
    if (!summary.isSettled)
      std::fprintf(stderr, "warning: still refining after %.0f s (--settle-limit); the settled pictures show the mesh as it is\n",
                   options_.settleLimit);
    return conclude();
  }

 private:
  using Clock = std::chrono::steady_clock;

  // Drivers compile shaders at their first use, which must not count for the first picture.
  Outcome<void> warmUp() {
    if (auto placed = flight_.place(0); !placed) return placed;
    if (!options_.warm) return {};
    const render::View small = view(16, 16);
    if (auto drawn = renderer_.drawMarch(small); !drawn) return drawn.error();
    if (auto drawn = renderer_.drawMesh(scene_.leaves(), small); !drawn) return drawn.error();
    if (options_.corrected)
      if (auto drawn = renderer_.drawCorrected(scene_.leaves(), small); !drawn) return drawn.error();
    return {};
  }

  Outcome<void> fetchGround(lattice::Point p) {
    const auto changed = ground_->fetch(p, options_.realtime);
    if (!changed) return changed.error();
    if (*changed) lastMarch_.clear();
    return {};
  }

  Outcome<void> fetchGroundHere() {
    const camera::Pose& pose = flight_.camera().pose;
    return fetchGround({pose.x, pose.z});
  }

  Outcome<double> ground(lattice::Point p) {
    if (auto fetched = fetchGround(p); !fetched) return fetched.error();
    if (const auto known = ground_->height(p)) return *known;
    return scene_.height(p).value_or(0);
  }

  render::View view(std::uint32_t width = 0, std::uint32_t height = 0) const {
    render::View view;
    view.camera = flight_.camera();
    if (width > 0) view.camera.projection.width = width;
    if (height > 0) view.camera.projection.height = height;
    view.horizon = client_.world().horizon;
    ground_->addTo(view);
    return view;
  }

  Outcome<void> iterated(const link::Update& update, double t, double latencyMs) override {
    const wire::Iteration& i = update.iteration;
    IterationResult result{
        i.number,      i.poseSequence, t,         i.figures,    update.milliseconds, latencyMs, scene_.triangles(), i.whole.size(),
        i.gone.size(), update.bytes,   i.settled, !update.wrong};
    if (options_.measureFrames && !options_.realtime)
      if (auto measured = measureFrame(result); !measured) return measured;
    if (auto added = recorder_.add(result); !added) return added;
    if (update.wrong) {
      std::fprintf(stderr, "warning: %s; requesting leaves again\n", update.wrong->message.c_str());
      if (recorder_.summary().hashMismatches > kMaxMismatches)
        return Error{"the mesh held differed from the server's in more than " + std::to_string(kMaxMismatches) +
                     " iterations: the last time " + update.wrong->message};
    }
    if (resting_ && options_.measurePopping && states_.size() < kMaxStates) states_.push_back(scene_.leaves());
    tellProgress();
    return {};
  }

  // A quarter of the size.
  Outcome<void> measureFrame(IterationResult& result) {
    const auto began = Clock::now();
    const core::Leaves& leaves = scene_.leaves();  // makes what changed
    result.uploadMs = std::chrono::duration<double, std::milli>(Clock::now() - began).count() + renderer_.upload(leaves);
    auto drawn = renderer_.drawMesh(leaves, view(std::max(options_.width / 4, 16u), std::max(options_.height / 4, 16u)));
    if (!drawn) return drawn.error();
    result.drawMs = drawn->milliseconds;
    return {};
  }

  void tellProgress() {
    if (Clock::now() < nextProgress_) return;
    nextProgress_ = Clock::now() + 2s;
    std::fprintf(stderr, "%7.1f of %.1f s, iteration %llu, %llu triangles, %.1f MB received\n", flight_.t(), flight_.duration(),
                 static_cast<unsigned long long>(scene_.iteration()), static_cast<unsigned long long>(scene_.triangles()),
                 static_cast<double>(client_.connection().bytesReceived()) / 1e6);
  }

  // By the clock: the server has another world, such as the ground that its author has just saved.
  Outcome<void> enterOtherWorld() {
    std::fprintf(stderr, "ridgecast-client: the server has another world now; entering it\n");
    earlierBytes_ += client_.connection().bytesReceived();
    earlierReconnections_ += client_.connection().reconnections();
    if (auto entered = client_.enterOtherWorld(); !entered) return entered;
    auto drawer = Drawer::create(client_.world(), options_.remoteShaders);
    if (!drawer) return drawer.error();
    ground_.emplace(client_, std::move(drawer->drawing));  // before what it was drawn with goes
    renderer_ = std::move(drawer->renderer);
    lastMarch_.clear();
    states_.clear();
    lost_ = false;
    return {};
  }

  Outcome<void> reached() override {
    if (client_.connection().otherWorld() && options_.realtime) return enterOtherWorld();
    const auto why = client_.connection().error();
    if (std::exchange(lost_, why.has_value()) != why.has_value())
      std::fprintf(stderr, "ridgecast-client: %s\n", why ? (why->message + "; trying again").c_str() : "connected again");
    const double t = flight_.t() + kSameTime;
    if (t >= nextPicture_ && drawsPictures()) {
      nextPicture_ = (std::floor(t / pictureEvery_) + 1) * pictureEvery_;
      if (auto drawn = takePicture(numberOf(scene_), false); !drawn) return drawn;
    }
    if (!exported_ && !options_.exportFile.empty() && options_.exportAt.value_or(flight_.duration()) < flight_.duration() &&
        t >= *options_.exportAt)
      return exportMesh();
    return {};
  }

  Outcome<void> takePicture(const std::string& name, bool atRest) {
    ++pictures_;
    if (auto fetched = fetchGroundHere(); !fetched) return fetched.error();
    // Where the terrain is not known there is nothing to compare with.
    if (!ground_->terrain()) return recorder_.meshPicture(name, renderer_, scene_, view(), options_.supersample);
    auto compared = recorder_.picture(
        name, renderer_, scene_, view(),
        {options_.supersample, options_.corrected, options_.unfiltered, options_.references ? options_.references : &lastMarch_});
    if (!compared) return compared.error();
    const Likeness& likeness = compared->likeness;
    if (atRest) {
      recorder_.summary().settled = likeness;
      recorder_.summary().terrainShare = compared->terrainShare;
    } else {
      recorder_.addFrame(name, flight_.t(), likeness);
    }
    const std::string terrain = cell(", terrain alone %.4f", likeness.terrain) + cell(", corrected %.4f", likeness.corrected);
    std::fprintf(stderr, "%s-mesh.png, %s-raymarch.png: SSIM %.4f%s (%.0f %% of the picture), %llu triangles\n", name.c_str(), name.c_str(),
                 likeness.ssim, terrain.c_str(), compared->terrainShare * 100, static_cast<unsigned long long>(scene_.triangles()));
    return {};
  }

  Outcome<void> exportMesh() {
    const wire::World& world = client_.world();
    if (auto written = writeGlb(scene_.leaves(), flight_.camera().pose, world.terrainName, world.seed, options_.exportFile); !written)
      return written.error();
    exported_ = true;
    std::fprintf(stderr, "%s: the %llu triangles held at %.2f s\n", options_.exportFile.c_str(),
                 static_cast<unsigned long long>(scene_.triangles()), flight_.t());
    return {};
  }

  Outcome<void> comparePopping() {
    std::fprintf(stderr, "drawing %zu iterations at 60 frames a second, with and without morphing\n", states_.size());
    auto popping = measurePopping(renderer_, view(std::min(options_.width, 320u), std::min(options_.height, 180u)), states_);
    if (!popping) return popping.error();
    std::fprintf(stderr, "popping: 1 - SSIM from frame to frame at most %.4f with morphing, %.4f without\n", popping->on, popping->off);
    recorder_.summary().popping = std::move(*popping);
    return {};
  }

  Outcome<void> conclude() {
    if (!options_.exportFile.empty() && !exported_)
      if (auto written = exportMesh(); !written) return written;
    if (options_.atRest) {
      if (auto fetched = fetchGroundHere(); !fetched) return fetched;
      if (auto measured = options_.atRest({renderer_, scene_, view(), ground_->terrain(), recorder_.summary().isSettled}); !measured)
        return measured;
    } else if (options_.pictures) {
      if (auto drawn = takePicture("settled", true); !drawn) return drawn;
    }
    if (!states_.empty())
      if (auto compared = comparePopping(); !compared) return compared;
    const wire::World& world = client_.world();
    FlightSummary& summary = recorder_.summary();
    summary.triangles = scene_.triangles();
    summary.leaves = scene_.index().size();
    summary.reconnections = earlierReconnections_ + client_.connection().reconnections();
    summary.bytesReceived = earlierBytes_ + client_.connection().bytesReceived();
    summary.settings = {std::string(settings::traits(world.settings.metric).name),
                        world.settings.threshold,
                        world.settings.triangleBudget,
                        options_.width,
                        options_.height,
                        options_.supersample * options_.supersample,
                        options_.realtime ? "realtime" : "lockstep",
                        options_.path.filename().string(),
                        world.terrainName,
                        world.seed,
                        world.horizon,
                        world.serverName,
                        render::contextDescription()};
    return recorder_.writeSummary(flight_.seconds());
  }

  bool drawsPictures() const { return options_.pictures && !options_.atRest; }

  const FlyOptions& options_;
  link::Client& client_;
  const core::Scene& scene_;
  std::optional<KnownGround> ground_;  // never empty
  render::Renderer renderer_;
  Recorder recorder_;
  References lastMarch_{1};  // the picture at rest often is where the last one was
  flight::Flight flight_;
  const double pictureEvery_;
  double nextPicture_;
  bool exported_ = false, resting_ = false, lost_ = false;
  std::uint64_t pictures_ = 0, earlierBytes_ = 0, earlierReconnections_ = 0;  // earlier: in worlds that were left
  std::vector<render::Morph::Leaves> states_;                                 // of the standing camera, when popping is measured
  Clock::time_point nextProgress_ = Clock::now();
};

}  // namespace

int fly(const FlyOptions& options) {
  auto path = camera::readPath(options.path);
  if (!path) return fail(kBadInput, path.error());
  return fly(options, [&](const wire::World& world) {
    if (!path->terrain.empty() && (path->terrain != world.terrainName || path->seed != world.seed))
      std::fprintf(stderr, "warning: the path was made for terrain %s, seed %u; the server has %s, seed %u\n", path->terrain.c_str(),
                   path->seed, world.terrainName.c_str(), world.seed);
    std::fprintf(stderr, "flying %s\n", options.path.filename().c_str());
    return std::move(*path);
  });
}

int fly(const FlyOptions& options, const std::function<camera::Path(const wire::World&)>& pathOver) {
  auto recorder = Recorder::create(options.out);
  if (!recorder) return fail(kBadInput, recorder.error());
  auto context = render::HeadlessContext::create();
  if (!context) return fail(kNoGraphics, context.error());

  wire::Hello hello;
  hello.clientName = "ridgecast-client fly";
  hello.settings = options.settings;
  hello.pacing = options.realtime ? wire::Pacing::kFree : wire::Pacing::kLockstep;
  auto client = link::Client::open(options.url, hello, {.reconnects = options.realtime});
  if (!client) return fail(kRuntimeFailure, client.error());
  const wire::World& world = (*client)->world();
  auto drawer = Drawer::create(world, options.remoteShaders);
  if (!drawer) return fail(kNoGraphics, drawer.error());
  std::fprintf(stderr, "%s (seed %u, horizon %.0f m), %ux%u, %s\n", world.terrainName.c_str(), world.seed, world.horizon, options.width,
               options.height, render::contextDescription().c_str());
  Measurer measurer(options, pathOver(world), **client, std::move(*drawer), std::move(*recorder));
  if (auto measured = measurer.run(); !measured) return fail(kRuntimeFailure, measured.error());
  if (!options.atRest) std::fprintf(stderr, "results in %s\n", (options.out / "summary.json").c_str());
  return kSuccess;
}

}  // namespace ridgecast::evaluation
