// Joins a session, flies a kilometre and asks for the ground:  example [ws://HOST:PORT?session=NAME]
#include <cstdio>

#include "client/connection/connection.h"
#include "client/query/ground.h"
#include "client/query/mesh_ground.h"

using namespace ridgecast;

int fail(const Error& error) { return std::fprintf(stderr, "example: %s\n", error.message.c_str()), 1; }

int main(int argc, char** argv) {
  const auto url = connection::parseUrl(argc > 1 ? argv[1] : "");
  if (!url) return fail(url.error());
  wire::Hello hello;
  hello.clientName = "example";
  hello.role = wire::Role::kSensor;  // no pictures
  hello.members = hello.errors = true;
  auto opened = connection::Connection::open(*url, hello);
  if (!opened) return fail(opened.error());
  connection::Connection& server = **opened;
  query::Ground ground(server);  // here, where the terrain is built in; else the server is asked
  scene::Scene mesh;             // what the server streams
  for (std::uint64_t k = 1; k <= 20; ++k) {
    const double x = 50.0 * static_cast<double>(k), z = 0;
    const auto height = ground.height(x, z);
    if (!height) return fail(height.error());
    wire::PoseMessage pose{k, {}};
    pose.camera.pose.x = query::toSteps(x);
    pose.camera.pose.y = *height + 100;
    server.send(pose);
    const auto received = server.receive(std::chrono::seconds(10));
    if (!received) return fail(server.error().value_or(Error{"nothing came within 10 s"}));
    if (const auto applied = mesh.apply(received->iteration); !applied) return fail(applied.error());
    server.acknowledge({received->iteration.number, mesh.hash()});
    const auto held = query::heightOf(mesh, {query::toSteps(x), query::toSteps(z)});
    std::printf("%4.0f m: ground %.3f m, mesh %.3f m, good to %.3f m; %zu others here\n", x, *height, held ? held->height : 0,
                held ? held->bound : 0, server.others() ? server.others()->others().size() : 0);
  }
}
