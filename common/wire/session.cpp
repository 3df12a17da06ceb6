// Members, clock, queries, grounds and candidates <-> bytes.
#include <cstdlib>
#include <utility>

#include "common/wire/fields.h"
#include "common/wire/wire.h"

namespace ridgecast::wire {
namespace {

lattice::Point readPoint(std::int64_t x, std::int64_t z, const char* field, Check& check) {
  check.require(lattice::positionIsValid(x, z), field, "must be within +-2^50 steps (4.39e12 m)");
  return {x, z};
}

Role readRole(pb::Role in) { return in == pb::ROLE_SENSOR ? Role::kSensor : Role::kViewer; }

ClockMode readMode(int in, const char* field, Check& check) {
  check.require(in >= 0 && in <= 2, field, "must be 0 (real time), 1 (scaled) or 2 (stepped)");
  return static_cast<ClockMode>(in);
}

Moved readMoved(const pb::Moved& in, Check& check) {
  Moved out;
  out.camera = in.camera();
  check.require(in.has_pose(), "Moved.pose", "is missing");
  if (in.has_pose()) out.pose = read(in.pose(), check);
  check.require(in.time() <= kMaxTime, "Moved.time", "must be at most 2^53 microseconds");
  out.time = in.time();
  return out;
}

Member readMember(const pb::Member& in, Check& check) {
  Member out;
  out.camera = in.camera();
  out.role = readRole(in.role());
  check.text(in.name(), kMaxNameBytes, "Member.name");
  out.name = in.name();
  if (!in.has_moved()) return out;
  out.moved = readMoved(in.moved(), check);
  out.moved->camera = out.camera;
  return out;
}

void writeMoved(const Moved& in, pb::Moved& out) {
  out.set_camera(in.camera);
  write(in.pose, *out.mutable_pose());
  out.set_time(in.time);
}

void writePlaces(const Query& in, pb::Places& out) {
  out.mutable_x()->Add(in.x.begin(), in.x.end());
  out.mutable_z()->Add(in.z.begin(), in.z.end());
  out.set_spacing(in.spacing);
}

void readPlaces(const pb::Places& in, Query& out, Check& check) {
  check.count(static_cast<std::size_t>(in.x_size()), kMaxPlaces, "Places.x");
  check.require(in.x_size() == in.z_size(), "Places.z", "must have as many entries as Places.x");
  check.require(in.spacing() <= kMaxSpacing, "Places.spacing", "must be at most 65536 steps");
  if (check.error()) return;
  out.x.assign(in.x().begin(), in.x().end());
  out.z.assign(in.z().begin(), in.z().end());
  out.spacing = in.spacing();
  bool inside = true;
  for (std::size_t k = 0; k < out.x.size(); ++k) inside = inside && lattice::positionIsValid(out.x[k], out.z[k]);
  check.require(inside, "Places", "must be within +-2^50 steps (4.39e12 m)");
}

}  // namespace

AskClock read(const pb::AskClock& in) { return {in.echo()}; }

SetClock read(const pb::SetClock& in, Check& check) {
  SetClock out;
  out.own = in.own();
  out.mode = readMode(in.mode(), "SetClock.mode", check);
  check.finite(in.rate(), 0, kMaxRate, "SetClock.rate", "must be in [0, 1000]");
  out.rate = in.rate();
  return out;
}

Step read(const pb::Step& in, Check& check) {
  check.require(in.time() >= 1 && in.time() <= kMaxStepTime, "Step.time", "must be 1 to 3600000000 microseconds");
  return {in.time(), in.wait()};
}

Query read(const pb::Query& in, Check& check) {
  Query out;
  out.id = in.id();
  switch (in.kind_case()) {
    case pb::Query::kHeights:
      out.kind = QueryKind::kHeights;
      readPlaces(in.heights(), out, check);
      break;
    case pb::Query::kNormals:
      out.kind = QueryKind::kNormals;
      readPlaces(in.normals(), out, check);
      break;
    case pb::Query::kRays: {
      out.kind = QueryKind::kRays;
      const auto& rays = in.rays().rays();
      check.count(static_cast<std::size_t>(rays.size()), kMaxRays, "Rays.rays");
      if (check.error()) break;
      out.rays.reserve(static_cast<std::size_t>(rays.size()));
      for (const pb::Ray& ray : rays) {
        readPoint(ray.x(), ray.z(), "Ray", check);
        check.finite(ray.y(), -1e6, 1e6, "Ray.y", "must be finite and within +-1e6 m");
        check.finite(ray.reach(), 0, kMaxReach, "Ray.reach", "must be in [0, 1e5] m");
        for (const double d : {ray.direction_x(), ray.direction_y(), ray.direction_z()})
          check.finite(d, -1e6, 1e6, "Ray.direction", "must be finite and within +-1e6");
        const double most = std::max({std::abs(ray.direction_x()), std::abs(ray.direction_y()), std::abs(ray.direction_z())});
        check.require(most >= 1e-6, "Ray.direction", "must not be 0");
        out.rays.push_back({ray.x(), ray.z(), ray.y(), ray.direction_x(), ray.direction_y(), ray.direction_z(), ray.reach()});
      }
      break;
    }
    case pb::Query::KIND_NOT_SET:
      check.require(false, "Query", "asks for nothing: set heights, normals or rays");
  }
  return out;
}

AskGround read(const pb::AskGround& in, Check& check) {
  AskGround out;
  out.id = in.id();
  out.at = readPoint(in.x(), in.z(), "AskGround", check);
  check.finite(in.radius(), kLeastRadius, kMostRadius, "AskGround.radius", "must be in [1, 4096] m");
  check.finite(in.error(), kLeastError, kMostError, "AskGround.error", "must be in [0.02, 100] m");
  out.radius = in.radius();
  out.error = in.error();
  return out;
}

Members read(const pb::Members& in, Check& check) {
  Members out;
  for (const int n : {in.joined_size(), in.moved_size(), in.left_size()}) check.count(static_cast<std::size_t>(n), kMaxMembers, "Members");
  if (check.error()) return out;
  for (const pb::Member& m : in.joined()) out.joined.push_back(readMember(m, check));
  for (const pb::Moved& m : in.moved()) out.moved.push_back(readMoved(m, check));
  out.left.assign(in.left().begin(), in.left().end());
  return out;
}

Clock read(const pb::Clock& in, Check& check) {
  Clock out;
  out.mode = readMode(in.mode(), "Clock.mode", check);
  check.finite(in.rate(), 0, kMaxRate, "Clock.rate", "must be in [0, 1000]");
  check.require(in.time() <= kMaxTime, "Clock.time", "must be at most 2^53 microseconds");
  check.count(static_cast<std::size_t>(in.waits_for_size()), kMaxMembers, "Clock.waits_for");
  if (check.error()) return out;
  out.rate = in.rate();
  out.time = in.time();
  out.owner = in.owner();
  out.step = in.step();
  out.waitsFor.assign(in.waits_for().begin(), in.waits_for().end());
  out.echo = in.echo();
  return out;
}

Answer read(const pb::Answer& in, Check& check) {
  Answer out;
  out.id = in.id();
  check.count(static_cast<std::size_t>(in.heights_size()), kMaxPlaces, "Answer.heights");
  check.count(static_cast<std::size_t>(in.normals_size()), 3 * kMaxPlaces, "Answer.normals");
  check.count(static_cast<std::size_t>(in.distances_size()), kMaxRays, "Answer.distances");
  if (check.error()) return out;
  out.heights.assign(in.heights().begin(), in.heights().end());
  out.normals.assign(in.normals().begin(), in.normals().end());
  out.distances.assign(in.distances().begin(), in.distances().end());
  return out;
}

Ground read(pb::Ground& in, Check& check) {
  Ground out;
  out.id = in.id();
  check.finite(in.error(), 0, 1e6, "Ground.error", "must be finite and not negative");
  check.count(static_cast<std::size_t>(in.leaves_size()), kMaxIterationLeaves, "Ground.leaves");
  out.error = in.error();
  if (check.error()) return out;
  for (pb::LeafWhole& leaf : *in.mutable_leaves()) {
    if (check.error()) break;
    out.leaves.push_back(read(leaf, check));
  }
  return out;
}

void write(const AskClock& in, pb::ClientMessage& message) { message.mutable_ask_clock()->set_echo(in.echo); }

void write(const SetClock& in, pb::ClientMessage& message) {
  pb::SetClock& out = *message.mutable_set_clock();
  out.set_own(in.own);
  out.set_mode(static_cast<pb::ClockMode>(in.mode));
  out.set_rate(in.rate);
}

void write(const Step& in, pb::ClientMessage& message) {
  message.mutable_step()->set_time(in.time);
  message.mutable_step()->set_wait(in.wait);
}

void write(const StepDone& in, pb::ClientMessage& message) { message.mutable_step_done()->set_step(in.step); }

void write(const Query& in, pb::ClientMessage& message) {
  pb::Query& out = *message.mutable_query();
  out.set_id(in.id);
  if (in.kind == QueryKind::kHeights) return writePlaces(in, *out.mutable_heights());
  if (in.kind == QueryKind::kNormals) return writePlaces(in, *out.mutable_normals());
  for (const Ray& ray : in.rays) {
    pb::Ray& r = *out.mutable_rays()->add_rays();
    r.set_x(ray.x);
    r.set_z(ray.z);
    r.set_y(ray.y);
    r.set_direction_x(ray.directionX);
    r.set_direction_y(ray.directionY);
    r.set_direction_z(ray.directionZ);
    r.set_reach(ray.reach);
  }
  if (in.rays.empty()) out.mutable_rays();
}

void write(const AskGround& in, pb::ClientMessage& message) {
  pb::AskGround& out = *message.mutable_ask_ground();
  out.set_id(in.id);
  out.set_x(in.at.x);
  out.set_z(in.at.z);
  out.set_radius(in.radius);
  out.set_error(in.error);
}

void write(const Members& in, pb::ServerMessage& message) {
  pb::Members& out = *message.mutable_members();
  for (const Member& m : in.joined) {
    pb::Member& joined = *out.add_joined();
    joined.set_camera(m.camera);
    joined.set_role(static_cast<pb::Role>(m.role));
    joined.set_name(m.name);
    if (!m.moved) continue;
    writeMoved(*m.moved, *joined.mutable_moved());
    joined.mutable_moved()->clear_camera();
  }
  for (const Moved& m : in.moved) writeMoved(m, *out.add_moved());
  for (const std::uint64_t camera : in.left) out.add_left(camera);
}

void write(const Clock& in, pb::ServerMessage& message) {
  pb::Clock& out = *message.mutable_clock();
  out.set_mode(static_cast<pb::ClockMode>(in.mode));
  out.set_rate(in.rate);
  out.set_time(in.time);
  out.set_owner(in.owner);
  out.set_step(in.step);
  for (const std::uint64_t camera : in.waitsFor) out.add_waits_for(camera);
  out.set_echo(in.echo);
}

void write(const Answer& in, pb::ServerMessage& message) {
  pb::Answer& out = *message.mutable_answer();
  out.set_id(in.id);
  out.mutable_heights()->Add(in.heights.begin(), in.heights.end());
  out.mutable_normals()->Add(in.normals.begin(), in.normals.end());
  out.mutable_distances()->Add(in.distances.begin(), in.distances.end());
}

void write(const Ground& in, pb::ServerMessage& message) {
  pb::Ground& out = *message.mutable_ground();
  out.set_id(in.id);
  out.set_error(in.error);
  for (const LeafWhole& leaf : in.leaves) write(leaf, *out.add_leaves());
}

std::vector<Candidate> read(const pb::Candidates& in, Check& check) {
  std::vector<Candidate> out;
  const auto count = static_cast<std::size_t>(in.errors_size());
  check.count(count, kMaxCandidates, "Candidates.errors");
  check.require(static_cast<std::size_t>(in.points_size()) == 3 * count, "Candidates.points", "must have three numbers for each error");
  const lattice::Point from = readPoint(in.x(), in.z(), "Candidates.x, .z", check);
  if (check.error()) return out;
  out.reserve(count);
  for (int k = 0; k < in.errors_size() && !check.error(); ++k) {
    const std::int32_t x = in.points(3 * k), z = in.points(3 * k + 1), y = in.points(3 * k + 2);
    check.require(std::abs(std::int64_t{x}) <= kMaxCandidateReach && std::abs(std::int64_t{z}) <= kMaxCandidateReach, "Candidates.points",
                  "must lie within +-2^27 steps");
    const lattice::Point at = readPoint(from.x + x, from.z + z, "Candidates.points", check);
    check.require(y >= -lattice::kMaxHeight && y <= lattice::kMaxHeight, "Candidates.points", "must have heights within +-2^25 steps");
    check.finite(in.errors(k), 0, kMaxErrorPixels, "Candidates.errors", "must be in [0, 1e9] pixels");
    out.push_back({{at.x, at.z, y}, in.errors(k)});
  }
  return out;
}

// All of a camera's lie within twice the horizon of each other, far below kMaxCandidateReach.
void write(const std::vector<Candidate>& in, pb::Candidates& out) {
  if (in.empty()) return;
  const lattice::Vertex from = in.front().at;
  out.set_x(from.x);
  out.set_z(from.z);
  out.mutable_points()->Reserve(static_cast<int>(3 * in.size()));
  out.mutable_errors()->Reserve(static_cast<int>(in.size()));
  for (const Candidate& c : in) {
    out.add_points(static_cast<std::int32_t>(c.at.x - from.x));
    out.add_points(static_cast<std::int32_t>(c.at.z - from.z));
    out.add_points(c.at.y);
    out.add_errors(c.pixels);
  }
}

}  // namespace ridgecast::wire
