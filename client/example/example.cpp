// Joins a session, flies a kilometre and asks for the ground:  example [ws://HOST:PORT?session=NAME]
#include <cstdio>

#include "client/query/ground.h"
#include "client/query/mesh_ground.h"
#include "client/replica/client.h"

using namespace ridgecast;

int main(int argc, char** argv) try {
  const wire::Hello hello{.clientName = "example", .role = wire::Role::kSensor, .members = true, .errors = true};  // no pictures
  const auto client = replica::Client::open(connection::parseUrl(argc > 1 ? argv[1] : "").value(), hello).value();
  query::Ground ground(client->connection());  // here, where the terrain is built in; otherwise the server is asked
  for (double x = 50; x <= 1000; x += 50) {
    const double height = ground.height(x, 0).value();
    const camera::Camera camera{.pose = {.x = query::toSteps(x).value(), .y = height + 100}};
    client->await(client->send(camera), std::chrono::seconds(10)).value();
    const auto held = query::heightOf(client->scene(), {query::toSteps(x).value(), 0}).value_or(query::MeshHeight{});
    const auto others = client->connection()->others().value_or(connection::Roster{}).others().size();
    std::printf("%4.0f m: ground %.3f m, mesh %.3f m, good to %.3f m; %zu others here\n", x, height, held.height, held.bound, others);
  }
} catch (const std::exception& e) {  // an Outcome's value() throws what went wrong
  return std::fprintf(stderr, "example: %s\n", e.what()), 1;
}
