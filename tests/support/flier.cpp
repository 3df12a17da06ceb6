#include "tests/support/flier.h"

#include <cmath>
#include <stdexcept>
#include <utility>

#include "tests/support/waiting.h"

namespace ridgecast::testing_support {

using namespace std::chrono_literals;

namespace {

template <class T>
T orThrow(Outcome<T> outcome) {
  if (!outcome) throw std::runtime_error(outcome.error().message);
  return std::move(*outcome);
}

std::unique_ptr<link::Client> connect(const std::string& url, const wire::Settings& settings, wire::Pacing pacing) {
  wire::Hello hello;
  hello.clientName = "ridgecast tests";
  hello.settings = settings;
  hello.pacing = pacing;
  return orThrow(link::Client::open(orThrow(core::parseUrl(url)), hello, {.reconnects = false, .timeout = kTimeout}));
}

wire::Iteration agreed(link::Update&& update) {
  if (update.wrong) throw std::runtime_error(update.wrong->message);
  return std::move(update.iteration);
}

}  // namespace

Flier::Flier(const std::string& url, const wire::Settings& settings, wire::Pacing pacing) : client_(connect(url, settings, pacing)) {}

std::optional<wire::Iteration> Flier::take(std::chrono::milliseconds timeout) {
  auto update = client_->receive(timeout);
  if (!update) return {};
  return agreed(std::move(*update));
}

wire::Iteration Flier::step(const camera::Camera& camera) {
  const std::uint64_t sequence = send(camera);
  wire::Iteration iteration = agreed(orThrow(client_->await(sequence, kTimeout)));
  if (iteration.poseSequence != sequence)
    throw std::runtime_error("pose " + std::to_string(sequence) + " was answered as " + std::to_string(iteration.poseSequence));
  return iteration;
}

int Flier::settle(const camera::Camera& camera, int most) {
  for (int n = 1; n <= most; ++n)
    if (step(camera).settled) return n;
  throw std::runtime_error("not at rest after " + std::to_string(most) + " iterations");
}

MeshReport Flier::check() const {
  std::vector<mesh::LeafMesh> leaves;
  for (const auto& [address, held] : scene().leaves()) leaves.push_back(*held.mesh);
  return checkMesh(leaves);
}

PathCamera::PathCamera(const std::string& file, const wire::World& world)
    : path_(orThrow(camera::readPath(file))), terrain_(orThrow(terrain::create(world.terrainName, world.seed))) {}

camera::Camera PathCamera::at(double t) const {
  camera::Camera camera;
  camera.pose = camera::poseAt(path_, t, [this](lattice::Point p) { return terrain_->height(p); });
  camera.projection.verticalFov = path_.verticalFov;
  return camera;
}

camera::Camera PathCamera::looped(double t) const { return at(std::fmod(t, duration())); }

}  // namespace ridgecast::testing_support
