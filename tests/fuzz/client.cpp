// Bytes from a client, one message after the other, as a session sees them: nothing crashes, what is accepted survives its own encoding,
// and the replica keeps its word whatever is acknowledged, asked for again or claimed to be held.
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "common/mesh/leaf_mesh.h"
#include "common/wire/wire.h"
#include "server/replica/replica.h"

namespace {

using namespace ridgecast;

void require(bool ok) {
  if (!ok) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  replica::Replica replica(3, true);
  std::vector<ridgecast::mesh::LeafState> mesh;
  std::uint64_t expected = 0;
  bool posed = false;
  const auto world = [&](std::uint64_t n) {
    mesh.clear();
    expected = 0;
    for (int k = 0; k < 6; ++k)
      if ((n >> k) & 1) {
        const std::uint64_t hash = lattice::mix(n + static_cast<std::uint64_t>(k));
        mesh.push_back({{static_cast<std::int32_t>(k / 2), k, -k}, n * 7 + static_cast<std::uint64_t>(k) + 1, hash, 1});
        expected += mesh::hashTerm(mesh.back().address, hash);
      }
  };
  world(1);
  std::uint64_t n = 1;
  // Messages are cut by a length of two bytes each.
  while (size >= 2) {
    const std::size_t length = std::min<std::size_t>(data[0] | std::size_t{data[1]} << 8, size - 2);
    const std::vector<std::uint8_t> bytes(data + 2, data + 2 + length);  // a fresh allocation
    data += 2 + length;
    size -= 2 + length;
    const auto message = wire::decodeClient(bytes);
    if (!message) {
      require(!message.error().message.empty());
      continue;
    }
    const std::string again = wire::encode(*message);
    require(wire::decodeClient({reinterpret_cast<const std::uint8_t*>(again.data()), again.size()}).has_value());
    if (std::get_if<wire::PoseMessage>(&*message)) {
      posed = true;
      if (replica.hasRoom()) {
        world(++n);
        require(replica.send(mesh).meshHash == expected);
        require(!replica.differs(mesh));
      }
    } else if (const auto* acknowledge = std::get_if<wire::Acknowledge>(&*message)) {
      replica.acknowledge(acknowledge->iteration, acknowledge->meshHash);
    } else if (const auto* resend = std::get_if<wire::ResendLeaves>(&*message)) {
      replica.resend(resend->leaves);
    } else if (const auto* resume = std::get_if<wire::Resume>(&*message)) {
      if (!posed && resume->meshHash == 0) replica.resume(resume->leaves);
    }
    require(replica.unacknowledged() <= replica.window());
  }
  return 0;
}
