// A member in C++ of the session that test_members.py steps:  member URL STEPS. Prints what it computes in each step.
#include <zlib.h>

#include <array>
#include <cstdio>
#include <cstdlib>

#include "client/world/world.h"

using namespace ridgecast;

int main(int argc, char** argv) try {
  const auto world = world::World::join(argc > 2 ? argv[1] : "", {.name = "C++", .camera = false, .follows = true}).value();
  std::puts("follows");
  std::fflush(stdout);
  for (int step = 0; step < std::atoi(argv[2]); ++step) {
    const std::uint64_t time = world->nextStep(std::chrono::seconds(120)).value();
    // A body that drives along x at 16 m/s and swerves.
    const auto x = static_cast<lattice::Step>(time / 20'000 * 82), z = static_cast<lattice::Step>(time / 20'000 % 50) * 17;
    std::array<lattice::Step, 4> atX{x, x + 256, x - 256, x}, atZ{z, z, z, z + 300};
    std::array<float, 4> heights{};
    world->heights(atX, atZ, heights).value();
    const world::Mesh ground = world->ground({x, z}, 16, 0.25, std::chrono::seconds(120)).value();
    auto sum = crc32(0, reinterpret_cast<const Bytef*>(heights.data()), sizeof heights);
    sum = crc32(sum, reinterpret_cast<const Bytef*>(ground.positions.data()), static_cast<uInt>(12 * ground.positions.size()));
    sum = crc32(sum, reinterpret_cast<const Bytef*>(ground.triangles.data()), static_cast<uInt>(12 * ground.triangles.size()));
    std::printf("%llu %08lx\n", static_cast<unsigned long long>(time), static_cast<unsigned long>(sum));
    std::fflush(stdout);
  }
  world->nextStep(std::chrono::seconds(1));  // says that the last is done
} catch (const std::exception& e) {
  return std::fprintf(stderr, "member: %s\n", e.what()), 1;
}
