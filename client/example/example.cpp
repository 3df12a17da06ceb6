// Joins a session, flies a kilometre and asks for the ground:  example [ws://HOST:PORT?session=NAME]
#include <cstdio>

#include <ridgecast/ridgecast.h>

using namespace ridgecast;

int main(int argc, char** argv) try {
  const auto world = world::World::join(argc > 1 ? argv[1] : "", {.name = "example"}).value();
  for (double x = 50; x <= 1000; x += 50) {
    const double height = world->terrain().height(x, 0).value();  // here, where the terrain is built in; otherwise the server is asked
    const lattice::Point at{query::toSteps(x).value(), 0};
    world->fly({.pose = {.x = at.x, .y = height + 100}}, std::chrono::seconds(10)).value();
    const auto held = core::heightOf(world->scene(), at).value_or(core::MeshHeight{});
    const std::size_t others = world->others().size();
    std::printf("%4.0f m: ground %.3f m, mesh %.3f m, good to %.3f m; %zu others here\n", x, height, held.height, held.bound, others);
  }
} catch (const std::exception& e) {  // a Result's value() throws what went wrong
  return std::fprintf(stderr, "example: %s\n", e.what()), 1;
}
