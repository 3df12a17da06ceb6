// Bytes from a server, one message after the other, as a client sees them: nothing crashes, and the scene holds only sound leaves whose
// hashes are right, all or nothing.
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "client/core/mesh/scene.h"
#include "common/wire/wire.h"

namespace {

using namespace ridgecast;

void require(bool ok) {
  if (!ok) std::abort();
}

void check(const core::Scene& scene) {
  std::uint64_t hash = 0, triangles = 0;
  for (const auto& [address, leaf] : scene.leaves()) {
    mesh::LeafMesh ordered = *leaf.mesh;
    mesh::canonicalize(ordered);
    require(ordered.address == address && mesh::isCanonical(ordered) && mesh::hashLeaf(ordered) == leaf.hash);
    hash += mesh::hashTerm(address, leaf.hash);
    triangles += leaf.mesh->triangles.size();
  }
  require(hash == scene.hash() && triangles == scene.triangles());
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static core::Scene scene = [] {  // made once: its triangulation takes a millisecond
    core::Scene made;
    made.follow({.points = true});
    return made;
  }();
  scene.clear();
  while (size >= 2) {
    const std::size_t length = std::min<std::size_t>(data[0] | std::size_t{data[1]} << 8, size - 2);
    const std::vector<std::uint8_t> bytes(data + 2, data + 2 + length);  // a fresh allocation
    data += 2 + length;
    size -= 2 + length;
    auto message = wire::decodeServer(bytes);
    if (!message) {
      require(!message.error().message.empty());
      continue;
    }
    if (std::holds_alternative<wire::UnknownKind>(*message)) continue;
    const std::string again = wire::encode(*message);
    require(wire::decodeServer({reinterpret_cast<const std::uint8_t*>(again.data()), again.size()}).has_value());
    if (auto* iteration = std::get_if<wire::Iteration>(&*message)) {
      const std::uint64_t before = scene.hash();
      iteration->number = scene.iteration() + 1;  // so that the order need not be guessed
      if (!scene.apply(*iteration)) require(scene.hash() == before);
      check(scene);
    }
  }
  return 0;
}
