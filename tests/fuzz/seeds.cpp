// Writes seed corpora for the fuzzers below a folder: FOLDER/client, FOLDER/server, FOLDER/payload.
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "common/codec/codec.h"
#include "common/codec/delta.h"
#include "common/mesh/leaf_mesh.h"
#include "common/wire/wire.h"
#include "tests/support/leaf_meshes.h"

namespace {

using namespace ridgecast;

std::filesystem::path root;
int written = 0;

void write(const std::string& fuzzer, const std::string& bytes) {
  std::filesystem::create_directories(root / fuzzer);
  std::ofstream(root / fuzzer / ("seed-" + std::to_string(++written)), std::ios::binary) << bytes;
}

// Messages as the fuzzers read them: two bytes of length before each.
template <class Message>
std::string framed(const std::vector<Message>& messages) {
  std::string out;
  for (const Message& m : messages) {
    const std::string bytes = wire::encode(m);
    out += static_cast<char>(bytes.size() & 255);
    out += static_cast<char>(bytes.size() >> 8);
    out += bytes;
  }
  return out;
}

wire::LeafWhole wholeOf(const mesh::LeafMesh& leaf) {
  return {leaf.address, static_cast<std::uint32_t>(leaf.vertices.size()), static_cast<std::uint32_t>(leaf.triangles.size()),
          codec::encodeLeaf(leaf)};
}

wire::LeafDelta deltaOf(const mesh::LeafMesh& base, const mesh::LeafMesh& target) {
  return {target.address, codec::encodeDelta(base, target, mesh::hashLeaf(target)).value()};
}

void clientSeeds() {
  wire::Hello hello;
  hello.clientName = "seed";
  hello.settings = {wire::Metric::kPixels, 1, 100'000, 64'000, 900};
  wire::PoseMessage pose{1, {}};
  pose.camera.pose = {.x = -5, .z = 1 << 20, .remainderX = 0, .remainderZ = 0, .y = 100, .yaw = 1, .pitch = -0.2};
  wire::PoseMessage second = pose;
  second.sequence = 2;
  using M = wire::ClientMessage;
  const wire::Resume resume{{{{0, 1, 2}, 3}, {{1, 2, -2}, 9}}};
  for (const M& m :
       {M(hello), M(pose), M(wire::Acknowledge{1, 7}), M(wire::ResendLeaves{{{0, 0, 0}, {3, -4, 5}}}), M(wire::ResendLeaves{}), M(resume)})
    write("client", framed<M>({m}));
  hello.role = wire::Role::kSensor;
  hello.members = hello.clock = hello.errors = true;
  const wire::Query heights{1, wire::QueryKind::kHeights, {5, -6}, {7, 1 << 20}, 0, {}},
      normals{2, wire::QueryKind::kNormals, {5}, {7}, 32, {}}, rays{3, wire::QueryKind::kRays, {}, {}, 0, {{1, 2, 3, 0, -1, 0.5, 100}}};
  for (const M& m : {M(hello), M(wire::AskClock{9}), M(wire::SetClock{true, wire::ClockMode::kScaled, 2}), M(wire::ClockStep{20'000, true}),
                     M(wire::StepDone{1}), M(heights), M(normals), M(rays), M(wire::AskGround{4, {5, 6}, 20, 0.5}),
                     M(wire::ChangeSettings{{wire::Metric::kArea, 2, 50'000, 0}})})
    write("client", framed<M>({m}));
  write("client", framed<M>({hello, resume, pose, wire::Acknowledge{1, 0}, second, wire::ResendLeaves{}, wire::Acknowledge{2, 5}}));
}

void serverSeeds() {
  support::Random random(3);
  using M = wire::ServerMessage;
  wire::World world;
  world.serverName = "seed";
  world.session = "default";
  world.terrainName = "alpine";
  world.terrainSource = "// source";
  world.horizon = 32'000;
  world.window = 4;
  write("server", framed<M>({world}));
  write("server", framed<M>({wire::ErrorMessage{wire::ErrorCode::kLimit, "too much"}}));
  const wire::Moved moved{7, {1, {}}, 5};
  write("server", framed<M>({wire::Members{{{7, wire::Role::kSensor, "seed", moved}, {8, wire::Role::kViewer, "", {}}}, {moved}, {9}}}));
  write("server", framed<M>({wire::Clock{wire::ClockMode::kStepped, 0, 5, 7, 1, {7, 8}, 2}}));
  write("server", framed<M>({wire::Answer{1, {1.5f}, {0, 1, 0}, {-1, 2}}}));
  write("server", framed<M>({wire::Ground{1, 0.5, {wholeOf(support::terrainLike(random, 2, 1))}}}));
  for (int n : {1, 2, 5}) {
    const lattice::LeafAddress parent{1, 3, -2};
    mesh::LeafMesh first = support::terrainLike(random, n, 1);
    first.address = parent;
    const mesh::LeafMesh* source = &first;
    first = mesh::gather(parent, {&source, 1});
    const mesh::LeafMesh second = support::torn(random, first, 0.3);
    wire::Iteration a, b, c, d;
    a.number = 1, b.number = 2, c.number = 3, d.number = 4;
    a.whole = {wholeOf(first), wholeOf({.address = {0, 0, 0}, .vertices = {}, .triangles = {}})};
    b.changed = {deltaOf(first, second)};
    c.gone = {parent};
    source = &second;
    for (int q = 0; q < 4; ++q) c.changed.push_back({parent.child(q), {}});
    d.gone = {parent.child(0), parent.child(1), parent.child(2), parent.child(3)};
    d.changed = {deltaOf(second, first)};
    write("server", framed<M>({a}));
    b.candidates = {{{{1 << 20, -5, 300}, 2.5f}, {{1 << 20, 700, -300}, 0.25f}}};
    write("server", framed<M>({a, b}));
    write("server", framed<M>({a, b, c, d}));
  }
}

void payloadSeeds() {
  // The bases of payload.cpp, in its order.
  support::Random random(1);
  std::vector<mesh::LeafMesh> bases{{.address = {2, 1, 1}, .vertices = {}, .triangles = {}}};
  for (int n : {1, 2, 4, 8}) bases.push_back(support::terrainLike(random, n, n % 3));
  bases.push_back(support::torn(random, support::terrainLike(random, 6, 1), 0.4));
  bases.push_back(support::randomTin(random, 30));
  for (std::size_t k = 0; k < bases.size(); ++k) {
    const mesh::LeafMesh& leaf = bases[k];
    const auto whole = codec::encodeLeaf(leaf);
    if (leaf.vertices.size() < 256 && leaf.triangles.size() < 256)
      write("payload", std::string{0, static_cast<char>(leaf.vertices.size()), static_cast<char>(leaf.triangles.size())} +
                           std::string(whole.begin(), whole.end()));
    for (double share : {0.05, 0.5}) {
      mesh::LeafMesh target = share < 0.1 ? support::torn(random, leaf, share) : support::randomTin(random, 20);
      target.address = leaf.address;
      for (mesh::LocalVertex& v : target.vertices) v.x %= 1 << 26, v.z %= 1 << 26;
      mesh::canonicalize(target);
      if (!mesh::isCanonical(target)) continue;
      const auto delta = codec::encodeDelta(leaf, target, mesh::hashLeaf(target));
      if (delta && !delta->empty())
        write("payload", std::string{static_cast<char>(2 * k + 1), 0, 0} + std::string(delta->begin(), delta->end()));
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: fuzz_seeds FOLDER\n");
    return 2;
  }
  root = argv[1];
  clientSeeds();
  serverSeeds();
  payloadSeeds();
  std::printf("%d seeds in %s\n", written, argv[1]);
  return 0;
}
