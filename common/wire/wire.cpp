#include "common/wire/wire.h"

#include <algorithm>
#include <numbers>
#include <utility>

#include <google/protobuf/stubs/logging.h>

#include "common/wire/fields.h"
#include "common/wire/scan.h"

namespace ridgecast::wire {
namespace {

// Protobuf would print to stderr what a peer sends wrong; the errors returned here say it instead.
[[maybe_unused]] const auto previousLogHandler = google::protobuf::SetLogHandler(nullptr);

constexpr double kMaxPitch = std::numbers::pi / 2 + 1e-9;  // as camera::isValid

lattice::LeafAddress read(const pb::LeafAddress& in, const char* field, Check& check) {
  check.require(in.level() <= static_cast<std::uint32_t>(lattice::kMaxLevel), field,
                "has level " + std::to_string(in.level()) + "; levels are 0.." + std::to_string(lattice::kMaxLevel));
  if (check.error()) return {};
  const lattice::LeafAddress address{static_cast<std::int32_t>(in.level()), in.i(), in.j()};
  check.require(lattice::addressIsValid(address), field, "lies beyond the lattice (2^50 steps from the origin)");
  return address;
}

Settings read(const pb::Settings& in, Check& check) {
  check.require(in.metric() >= 0 && in.metric() <= 3, "Settings.metric", "must be 0 (default), 1 (pixels), 2 (thesis) or 3 (area)");
  check.finite(in.threshold(), 0, kMaxThreshold, "Settings.threshold", "must be finite and in [0, 1e12], 0 for the default");
  return {.metric = static_cast<Metric>(in.metric()),
          .threshold = in.threshold(),
          .triangleBudget = in.triangle_budget(),
          .bytesPerSecond = in.bytes_per_second(),
          .candidates = in.candidates()};
}

Hello read(const pb::Hello& in, Check& check) {
  Hello out;
  out.protocolVersion = in.protocol_version();
  check.text(in.client_name(), kMaxNameBytes, "Hello.client_name");
  out.clientName = in.client_name();
  if (out.protocolVersion != kProtocolVersion) return out;
  out.settings = read(in.settings(), check);
  check.require(in.pacing() == 0 || in.pacing() == 1, "Hello.pacing", "must be 0 (free) or 1 (lock-step)");
  out.pacing = static_cast<Pacing>(in.pacing());
  out.deltas = in.deltas();
  out.role = in.role() == pb::ROLE_SENSOR ? Role::kSensor : Role::kViewer;  // roles of a later revision are viewers
  out.members = in.members();
  out.clock = in.clock();
  out.errors = in.errors();
  return out;
}

}  // namespace

PoseMessage read(const pb::Pose& in, Check& check) {
  check.require(in.sequence() >= 1, "Pose.sequence", "must be at least 1");
  const auto inLattice = [](lattice::Step v) { return lattice::positionIsValid(v, 0); };
  check.require(inLattice(in.x()), "Pose.x", "must be within +-2^50 steps (4.39e12 m)");
  check.require(inLattice(in.z()), "Pose.z", "must be within +-2^50 steps (4.39e12 m)");
  check.finite(in.y(), -1e6, 1e6, "Pose.y", "must be finite and within +-1e6 m");
  check.finite(in.yaw(), -1e6, 1e6, "Pose.yaw", "must be finite and within +-1e6 radians");
  check.finite(in.pitch(), -kMaxPitch, kMaxPitch, "Pose.pitch", "must be within +-pi/2 radians");
  check.finite(in.vertical_fov(), 0.01, 3.0, "Pose.vertical_fov", "must be in [0.01, 3] radians");
  check.require(in.width() >= 1 && in.width() <= 32768, "Pose.width", "must be in 1..32768 pixels");
  check.require(in.height() >= 1 && in.height() <= 32768, "Pose.height", "must be in 1..32768 pixels");
  PoseMessage out;
  out.sequence = in.sequence();
  out.camera.pose = {.x = in.x(), .z = in.z(), .remainderX = 0, .remainderZ = 0, .y = in.y(), .yaw = in.yaw(), .pitch = in.pitch()};
  out.camera.projection = {.verticalFov = in.vertical_fov(), .width = in.width(), .height = in.height()};
  check.require(camera::isValid(out.camera), "Pose", "is out of range");
  return out;
}

namespace {

ResendLeaves read(const pb::ResendLeaves& in, Check& check) {
  ResendLeaves out;
  out.leaves.reserve(static_cast<std::size_t>(in.leaves_size()));
  for (const pb::LeafAddress& a : in.leaves()) out.leaves.push_back(read(a, "ResendLeaves.leaves", check));
  return out;
}

Resume read(const pb::Resume& in, Check& check) {
  Resume out;
  out.leaves.reserve(static_cast<std::size_t>(in.leaves_size()));
  for (const pb::HeldLeaf& leaf : in.leaves()) out.leaves.push_back({read(leaf.address(), "HeldLeaf.address", check), leaf.hash()});
  return out;
}

terrain::TileAddress read(const pb::TileAddress& in, Check& check) {
  constexpr std::int64_t kMost = 2 * lattice::kMaxPosition / (std::int64_t{terrain::kMinPitch} << terrain::kTileBits) + 1;
  check.require(in.i() >= -kMost && in.i() <= kMost && in.j() >= -kMost && in.j() <= kMost, "TileAddress",
                "lies beyond the lattice (2^50 steps from the origin)");
  return {in.i(), in.j()};
}

WantTiles read(const pb::WantTiles& in, Check& check) {
  WantTiles out;
  out.tiles.reserve(static_cast<std::size_t>(in.tiles_size()));
  for (const pb::TileAddress& a : in.tiles()) out.tiles.push_back(read(a, check));
  return out;
}

HeightTiles read(const pb::HeightTiles& in, Check& check) {
  HeightTiles out;
  for (const pb::HeightTile& tile : in.tiles()) {
    const terrain::TileAddress address = read(tile.address(), check);
    check.require(tile.samples().size() <= terrain::kMaxTileBytes, "HeightTile.samples", "has more bytes than a tile takes");
    if (check.error()) break;
    out.tiles.push_back({address, {tile.samples().begin(), tile.samples().end()}});
  }
  return out;
}

terrain::RasterShape read(const pb::HeightMap& in, Check& check) {
  const terrain::RasterShape out{.pitch = in.pitch(),
                                 .originX = in.origin_x(),
                                 .originZ = in.origin_z(),
                                 .width = in.width(),
                                 .height = in.height(),
                                 .lowest = in.lowest(),
                                 .highest = in.highest(),
                                 .content = in.content()};
  check.require(terrain::isValid(out), "World.height_map", "has a pitch, place, size or height that cannot be");
  return out;
}

World read(const pb::World& in, Check& check) {
  World out;
  out.protocolVersion = in.protocol_version();
  check.text(in.server_name(), kMaxNameBytes, "World.server_name");
  out.serverName = in.server_name();
  if (out.protocolVersion != kProtocolVersion) return out;
  check.require(sessionNameIsValid(in.session()), "World.session", "must be 1 to 64 letters, digits, '.', '_' or '-'");
  check.text(in.terrain_name(), kMaxNameBytes, "World.terrain_name");
  check.require(in.terrain_source().size() <= kMaxTerrainSourceBytes, "World.terrain_source", "must have at most 1 MiB");
  check.require(in.step_bits() == static_cast<std::uint32_t>(lattice::kStepBits), "World.step_bits", "must be 8");
  check.finite(in.horizon(), 1, kMaxHorizon, "World.horizon", "must be in [1, 1e7] m");
  check.require(in.window() >= 1 && in.window() <= kMaxWindow, "World.window", "must be in 1..64");
  out.session = in.session();
  out.terrainName = in.terrain_name();
  out.terrainSource = in.terrain_source();
  out.seed = in.seed();
  out.contentHash = in.content_hash();
  out.stepBits = in.step_bits();
  out.horizon = in.horizon();
  out.settings = read(in.settings(), check);
  out.window = in.window();
  out.camera = in.camera();
  out.revision = in.revision();
  if (in.has_height_map()) out.heightMap = read(in.height_map(), check);
  out.shadedVertices = in.shaded_vertices();
  return out;
}

}  // namespace

LeafWhole read(pb::LeafWhole& in, Check& check) {
  LeafWhole out;
  out.address = read(in.address(), "LeafWhole.address", check);
  out.vertices = in.vertices();
  out.triangles = in.triangles();
  check.require(out.triangles <= kMaxLeafTriangles, "LeafWhole.triangles", "must be at most 1048576");
  const bool consistent = out.triangles == 0 ? out.vertices == 0 : out.vertices >= 3 && out.vertices <= std::uint64_t{3} * out.triangles;
  check.require(consistent, "LeafWhole.vertices", "must be 3 to 3 times the triangles, and 0 without triangles");
  check.require(in.payload().size() <= kMaxPayloadBytes, "LeafWhole.payload", "must have at most 64 MiB");
  check.require(in.payload().empty() == (out.triangles == 0), "LeafWhole.payload", "must be absent exactly when the leaf is empty");
  out.error = in.error();
  check.finite(out.error, 0, 1e6, "LeafWhole.error", "must be finite and not negative");
  if (check.error()) return out;
  out.payload.assign(in.payload().begin(), in.payload().end());
  in.clear_payload();  // never twice in memory
  check.require(in.shades().size() <= kMaxShadeBytes, "LeafWhole.shades", "must have at most 16 MiB");
  if (!check.error()) out.shades.assign(in.shades().begin(), in.shades().end());
  return out;
}

namespace {

LeafDelta read(pb::LeafDelta& in, Check& check) {
  LeafDelta out;
  out.address = read(in.address(), "LeafDelta.address", check);
  check.require(in.payload().size() <= kMaxPayloadBytes, "LeafDelta.payload", "must have at most 64 MiB");
  out.error = in.error();
  check.finite(out.error, 0, 1e6, "LeafDelta.error", "must be finite and not negative");
  if (check.error()) return out;
  out.payload.assign(in.payload().begin(), in.payload().end());
  in.clear_payload();  // never twice in memory
  check.require(in.shades().size() <= kMaxShadeBytes, "LeafDelta.shades", "must have at most 16 MiB");
  if (!check.error()) out.shades.assign(in.shades().begin(), in.shades().end());
  return out;
}

Figures read(const pb::Figures& in, Check& check) {
  for (double v : {in.select_ms(), in.generate_ms(), in.refine_ms(), in.triangulate_ms(), in.encode_ms(), in.effective_threshold()})
    check.finite(v, 0, 1e15, "Figures", "must hold finite numbers that are not negative");
  return {.selectMs = in.select_ms(),
          .generateMs = in.generate_ms(),
          .refineMs = in.refine_ms(),
          .triangulateMs = in.triangulate_ms(),
          .encodeMs = in.encode_ms(),
          .leaves = in.leaves(),
          .validLeaves = in.valid_leaves(),
          .visibleLeaves = in.visible_leaves(),
          .generatedLeaves = in.generated_leaves(),
          .droppedLeaves = in.dropped_leaves(),
          .triangles = in.triangles(),
          .inserted = in.inserted(),
          .removed = in.removed(),
          .deferred = in.deferred(),
          .heights = in.heights(),
          .effectiveThreshold = in.effective_threshold()};
}

Iteration read(pb::Iteration& in, Check& check) {
  Iteration out;
  check.require(in.number() >= 1, "Iteration.number", "must be at least 1");
  out.number = in.number();
  out.poseSequence = in.pose_sequence();
  out.gone.reserve(static_cast<std::size_t>(in.gone_size()));
  for (const pb::LeafAddress& a : in.gone()) out.gone.push_back(read(a, "Iteration.gone", check));
  out.whole.reserve(static_cast<std::size_t>(in.whole_size()));
  for (pb::LeafWhole& leaf : *in.mutable_whole()) {
    if (check.error()) break;
    out.whole.push_back(read(leaf, check));
  }
  out.changed.reserve(static_cast<std::size_t>(in.changed_size()));
  for (pb::LeafDelta& leaf : *in.mutable_changed()) {
    if (check.error()) break;
    out.changed.push_back(read(leaf, check));
  }
  out.meshHash = in.mesh_hash();
  out.settled = in.settled();
  out.figures = read(in.figures(), check);
  if (in.has_candidates()) out.candidates = wire::read(in.candidates(), check);
  return out;
}

ErrorMessage read(const pb::Error& in, Check& check) {
  check.require(in.message().size() <= kMaxErrorBytes, "Error.message", "must have at most 4096 bytes");
  check.require(in.reconnect_url().size() <= kMaxErrorBytes, "Error.reconnect_url", "must have at most 4096 bytes");
  const bool known = in.code() >= 0 && in.code() <= static_cast<int>(ErrorCode::kGoingAway);
  return {.code = known ? static_cast<ErrorCode>(in.code()) : ErrorCode::kUnspecified,
          .message = in.message(),
          .reconnectUrl = in.reconnect_url()};
}

// ---- building ----

void write(const lattice::LeafAddress& in, pb::LeafAddress& out) {
  out.set_level(static_cast<std::uint32_t>(in.level));
  out.set_i(in.i);
  out.set_j(in.j);
}

void write(const Settings& in, pb::Settings& out) {
  out.set_metric(static_cast<pb::Metric>(in.metric));
  out.set_threshold(in.threshold);
  out.set_triangle_budget(in.triangleBudget);
  out.set_bytes_per_second(in.bytesPerSecond);
  if (in.candidates) out.set_candidates(in.candidates);
}

void write(const Hello& in, pb::ClientMessage& message) {
  pb::Hello& out = *message.mutable_hello();
  out.set_protocol_version(in.protocolVersion);
  out.set_client_name(in.clientName);
  write(in.settings, *out.mutable_settings());
  out.set_pacing(static_cast<pb::Pacing>(in.pacing));
  out.set_deltas(in.deltas);
  out.set_role(static_cast<pb::Role>(in.role));
  out.set_members(in.members);
  out.set_clock(in.clock);
  out.set_errors(in.errors);
}

}  // namespace

void write(const PoseMessage& in, pb::Pose& out) {
  const camera::Pose& pose = in.camera.pose;
  out.set_sequence(in.sequence);
  out.set_x(pose.x);
  out.set_z(pose.z);
  out.set_y(pose.y);
  out.set_yaw(pose.yaw);
  out.set_pitch(pose.pitch);
  out.set_vertical_fov(in.camera.projection.verticalFov);
  out.set_width(in.camera.projection.width);
  out.set_height(in.camera.projection.height);
}

void write(const LeafWhole& in, pb::LeafWhole& out) {
  write(in.address, *out.mutable_address());
  out.set_vertices(in.vertices);
  out.set_triangles(in.triangles);
  out.set_payload(in.payload.data(), in.payload.size());
  out.set_error(in.error);
  if (!in.shades.empty()) out.set_shades(in.shades.data(), in.shades.size());
}

namespace {

void write(const PoseMessage& in, pb::ClientMessage& message) { wire::write(in, *message.mutable_pose()); }

void write(const Acknowledge& in, pb::ClientMessage& message) {
  message.mutable_acknowledge()->set_iteration(in.iteration);
  message.mutable_acknowledge()->set_mesh_hash(in.meshHash);
}

void write(const ResendLeaves& in, pb::ClientMessage& message) {
  pb::ResendLeaves& out = *message.mutable_resend_leaves();
  for (const lattice::LeafAddress& a : in.leaves) write(a, *out.add_leaves());
}

void write(const Resume& in, pb::ClientMessage& message) {
  pb::Resume& out = *message.mutable_resume();
  for (const HeldLeaf& leaf : in.leaves) {
    pb::HeldLeaf& held = *out.add_leaves();
    write(leaf.address, *held.mutable_address());
    held.set_hash(leaf.hash);
  }
}

void write(terrain::TileAddress in, pb::TileAddress& out) {
  out.set_i(in.i);
  out.set_j(in.j);
}

void write(const WantTiles& in, pb::ClientMessage& message) {
  pb::WantTiles& out = *message.mutable_want_tiles();
  for (const terrain::TileAddress& a : in.tiles) write(a, *out.add_tiles());
}

void write(const ChangeSettings& in, pb::ClientMessage& message) { write(in.settings, *message.mutable_change_settings()); }

void write(const Granted& in, pb::ServerMessage& message) { write(in.settings, *message.mutable_granted()); }

void write(const HeightTiles& in, pb::ServerMessage& message) {
  pb::HeightTiles& out = *message.mutable_height_tiles();
  for (const HeightTile& tile : in.tiles) {
    pb::HeightTile& added = *out.add_tiles();
    write(tile.address, *added.mutable_address());
    added.set_samples(tile.samples.data(), tile.samples.size());
  }
}

void write(const World& in, pb::ServerMessage& message) {
  pb::World& out = *message.mutable_world();
  out.set_protocol_version(in.protocolVersion);
  out.set_server_name(in.serverName);
  out.set_session(in.session);
  out.set_terrain_name(in.terrainName);
  out.set_terrain_source(in.terrainSource);
  out.set_seed(in.seed);
  out.set_content_hash(in.contentHash);
  out.set_step_bits(in.stepBits);
  out.set_horizon(in.horizon);
  write(in.settings, *out.mutable_settings());
  out.set_window(in.window);
  out.set_camera(in.camera);
  out.set_revision(in.revision);
  out.set_shaded_vertices(in.shadedVertices);
  if (!in.heightMap) return;
  pb::HeightMap& map = *out.mutable_height_map();
  map.set_pitch(in.heightMap->pitch);
  map.set_origin_x(in.heightMap->originX);
  map.set_origin_z(in.heightMap->originZ);
  map.set_width(in.heightMap->width);
  map.set_height(in.heightMap->height);
  map.set_lowest(in.heightMap->lowest);
  map.set_highest(in.heightMap->highest);
  map.set_content(in.heightMap->content);
}

void write(const Figures& in, pb::Figures& out) {
  out.set_select_ms(in.selectMs);
  out.set_generate_ms(in.generateMs);
  out.set_refine_ms(in.refineMs);
  out.set_triangulate_ms(in.triangulateMs);
  out.set_encode_ms(in.encodeMs);
  out.set_leaves(in.leaves);
  out.set_valid_leaves(in.validLeaves);
  out.set_visible_leaves(in.visibleLeaves);
  out.set_generated_leaves(in.generatedLeaves);
  out.set_dropped_leaves(in.droppedLeaves);
  out.set_triangles(in.triangles);
  out.set_inserted(in.inserted);
  out.set_removed(in.removed);
  out.set_deferred(in.deferred);
  out.set_heights(in.heights);
  out.set_effective_threshold(in.effectiveThreshold);
}

void write(const Iteration& in, pb::ServerMessage& message) {
  pb::Iteration& out = *message.mutable_iteration();
  out.set_number(in.number);
  out.set_pose_sequence(in.poseSequence);
  for (const lattice::LeafAddress& a : in.gone) write(a, *out.add_gone());
  for (const LeafWhole& leaf : in.whole) wire::write(leaf, *out.add_whole());
  for (const LeafDelta& leaf : in.changed) {
    pb::LeafDelta& changed = *out.add_changed();
    write(leaf.address, *changed.mutable_address());
    changed.set_payload(leaf.payload.data(), leaf.payload.size());
    changed.set_error(leaf.error);
    if (!leaf.shades.empty()) changed.set_shades(leaf.shades.data(), leaf.shades.size());
  }
  out.set_mesh_hash(in.meshHash);
  out.set_settled(in.settled);
  write(in.figures, *out.mutable_figures());
  if (in.candidates) wire::write(*in.candidates, *out.mutable_candidates());
}

void write(const ErrorMessage& in, pb::ServerMessage& message) {
  message.mutable_error()->set_code(static_cast<pb::Error::Code>(in.code));
  message.mutable_error()->set_message(in.message.substr(0, kMaxErrorBytes));
  if (!in.reconnectUrl.empty()) message.mutable_error()->set_reconnect_url(in.reconnectUrl.substr(0, kMaxErrorBytes));
}

template <class Message>
Outcome<Message> finish(const Check& check, Message message) {
  if (check.error()) return *check.error();
  return message;
}

Error tooLong(std::size_t size, std::size_t most) {
  return {"the message has " + std::to_string(size) + " bytes, at most " + std::to_string(most) + " are allowed"};
}
const char* const kNoMessage = "the bytes are no message of protocol version 1 (see PROTOCOL.md)";

}  // namespace

bool sessionNameIsValid(std::string_view name) {
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' || c == '_' || c == '-';
  };
  return !name.empty() && name.size() <= kMaxSessionBytes && std::all_of(name.begin(), name.end(), allowed);
}

std::string encode(const ClientMessage& message) {
  pb::ClientMessage out;
  std::visit([&](const auto& m) { write(m, out); }, message);
  return out.SerializeAsString();
}

std::string encode(const ServerMessage& message) {
  pb::ServerMessage out;
  std::visit([&](const auto& m) { write(m, out); }, message);
  return out.SerializeAsString();
}

Outcome<ClientMessage> decodeClient(std::span<const std::uint8_t> bytes, const Limits& limits) {
  if (bytes.size() > limits.maxClientMessageBytes) return tooLong(bytes.size(), limits.maxClientMessageBytes);
  FieldCounts outer{}, resend{}, resume{}, rays{}, wanted{};
  const auto ignore = [](std::uint32_t, std::span<const std::uint8_t>) { return true; };
  const bool wellFormed = scanFields(bytes, outer, [&](std::uint32_t field, std::span<const std::uint8_t> content) {
    if (field == pb::ClientMessage::kResume) return scanFields(content, resume, ignore);
    if (field == pb::ClientMessage::kQuery) {
      FieldCounts query{};
      return scanFields(content, query, [&](std::uint32_t kind, std::span<const std::uint8_t> inside) {
        return kind != pb::Query::kRaysFieldNumber || scanFields(inside, rays, ignore);
      });
    }
    if (field == pb::ClientMessage::kWantTiles) return scanFields(content, wanted, ignore);
    return field != pb::ClientMessage::kResendLeaves || scanFields(content, resend, ignore);
  });
  if (!wellFormed) return Error{kNoMessage};
  Check check;
  check.count(resend[pb::ResendLeaves::kLeavesFieldNumber], kMaxResendLeaves, "ResendLeaves.leaves");
  check.count(resume[pb::Resume::kLeavesFieldNumber], kMaxResumeLeaves, "Resume.leaves");
  check.count(rays[pb::Rays::kRaysFieldNumber], kMaxRays, "Rays.rays");
  check.count(wanted[pb::WantTiles::kTilesFieldNumber], kMaxTiles, "WantTiles.tiles");
  if (check.error()) return *check.error();

  pb::ClientMessage message;
  if (!message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return Error{kNoMessage};
  switch (message.kind_case()) {
    case pb::ClientMessage::kHello: {
      ClientMessage out = read(message.hello(), check);
      return finish(check, std::move(out));
    }
    case pb::ClientMessage::kPose: {
      ClientMessage out = read(message.pose(), check);
      return finish(check, std::move(out));
    }
    case pb::ClientMessage::kAcknowledge:
      return ClientMessage(Acknowledge{.iteration = message.acknowledge().iteration(), .meshHash = message.acknowledge().mesh_hash()});
    case pb::ClientMessage::kResendLeaves: {
      ClientMessage out = read(message.resend_leaves(), check);
      return finish(check, std::move(out));
    }
    case pb::ClientMessage::kResume: {
      ClientMessage out = read(message.resume(), check);
      return finish(check, std::move(out));
    }
    case pb::ClientMessage::kAskClock:
      return ClientMessage(AskClock{message.ask_clock().echo()});
    case pb::ClientMessage::kSetClock: {
      ClientMessage out = wire::read(message.set_clock(), check);
      return finish(check, std::move(out));
    }
    case pb::ClientMessage::kStep: {
      ClientMessage out = wire::read(message.step(), check);
      return finish(check, std::move(out));
    }
    case pb::ClientMessage::kStepDone:
      return ClientMessage(StepDone{message.step_done().step()});
    case pb::ClientMessage::kQuery: {
      ClientMessage out = wire::read(message.query(), check);
      return finish(check, std::move(out));
    }
    case pb::ClientMessage::kAskGround: {
      ClientMessage out = wire::read(message.ask_ground(), check);
      return finish(check, std::move(out));
    }
    case pb::ClientMessage::kChangeSettings: {
      ClientMessage out = ChangeSettings{read(message.change_settings(), check)};
      return finish(check, std::move(out));
    }
    case pb::ClientMessage::kWantTiles: {
      ClientMessage out = read(message.want_tiles(), check);
      return finish(check, std::move(out));
    }
    case pb::ClientMessage::KIND_NOT_SET:
      break;
  }
  return Error{kNoMessage};
}

Outcome<ServerMessage> decodeServer(std::span<const std::uint8_t> bytes, const Limits& limits) {
  if (bytes.size() > limits.maxServerMessageBytes) return tooLong(bytes.size(), limits.maxServerMessageBytes);
  FieldCounts outer{}, iteration{}, members{}, ground{}, tiles{};
  std::size_t small = 0, candidates = 0;  // bytes of messages whose lists of numbers are not counted one by one
  const auto ignore = [](std::uint32_t, std::span<const std::uint8_t>) { return true; };
  const bool wellFormed = scanFields(bytes, outer, [&](std::uint32_t field, std::span<const std::uint8_t> content) {
    switch (field) {
      case pb::ServerMessage::kIteration:
        return scanFields(content, iteration, [&](std::uint32_t inner, std::span<const std::uint8_t> list) {
          if (inner == pb::Iteration::kCandidatesFieldNumber) candidates += list.size();
          return true;
        });
      case pb::ServerMessage::kHeightTiles:
        return scanFields(content, tiles, ignore);
      case pb::ServerMessage::kGround:
        return scanFields(content, ground, ignore);
      case pb::ServerMessage::kMembers:
        small += content.size();
        return scanFields(content, members, ignore);
      case pb::ServerMessage::kClock:
      case pb::ServerMessage::kAnswer:
        small += content.size();
        return true;
      default:
        return true;
    }
  });
  if (!wellFormed) return Error{kNoMessage};
  Check check;
  check.count(iteration[pb::Iteration::kGoneFieldNumber], kMaxIterationLeaves, "Iteration.gone");
  check.count(iteration[pb::Iteration::kWholeFieldNumber], kMaxIterationLeaves, "Iteration.whole");
  check.count(iteration[pb::Iteration::kChangedFieldNumber], kMaxIterationLeaves, "Iteration.changed");
  check.require(candidates <= kMaxCandidatesBytes, "Iteration.candidates", "must be at most 20000");
  check.count(ground[pb::Ground::kLeavesFieldNumber], kMaxIterationLeaves, "Ground.leaves");
  check.count(members[pb::Members::kJoinedFieldNumber], kMaxMembers, "Members.joined");
  check.count(members[pb::Members::kMovedFieldNumber], kMaxMembers, "Members.moved");
  check.require(small <= kMaxSmallMessageBytes, "Members, Clock or Answer", "must have at most 16 MiB");
  check.count(tiles[pb::HeightTiles::kTilesFieldNumber], kMaxTiles, "HeightTiles.tiles");
  if (check.error()) return *check.error();

  pb::ServerMessage message;
  if (!message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return Error{kNoMessage};
  switch (message.kind_case()) {
    case pb::ServerMessage::kGranted: {
      ServerMessage out = Granted{read(message.granted(), check)};
      return finish(check, std::move(out));
    }
    case pb::ServerMessage::kWorld: {
      ServerMessage out = read(message.world(), check);
      return finish(check, std::move(out));
    }
    case pb::ServerMessage::kIteration: {
      ServerMessage out = read(*message.mutable_iteration(), check);
      return finish(check, std::move(out));
    }
    case pb::ServerMessage::kHeightTiles: {
      ServerMessage out = read(message.height_tiles(), check);
      return finish(check, std::move(out));
    }
    case pb::ServerMessage::kError: {
      ServerMessage out = read(message.error(), check);
      return finish(check, std::move(out));
    }
    case pb::ServerMessage::kMembers: {
      ServerMessage out = wire::read(message.members(), check);
      return finish(check, std::move(out));
    }
    case pb::ServerMessage::kClock: {
      ServerMessage out = wire::read(message.clock(), check);
      return finish(check, std::move(out));
    }
    case pb::ServerMessage::kAnswer: {
      ServerMessage out = wire::read(message.answer(), check);
      return finish(check, std::move(out));
    }
    case pb::ServerMessage::kGround: {
      ServerMessage out = wire::read(*message.mutable_ground(), check);
      return finish(check, std::move(out));
    }
    case pb::ServerMessage::KIND_NOT_SET:
      break;
  }
  return Error{kNoMessage};
}

}  // namespace ridgecast::wire
