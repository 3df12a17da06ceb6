#include "server/http/queries.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <string>
#include <utility>

#include "common/ground/ground.h"
#include "common/text/text.h"
#include "common/wire/wire.h"
#include "server/query/query.h"

namespace ridgecast::http {

namespace {

constexpr double kFarthest = static_cast<double>(lattice::kMaxPosition) * lattice::kMetresPerStep;

// Reads exactly as many numbers as there are places, separated by commas.
bool parseNumbers(std::string_view text, std::span<double> numbers) {
  if (std::ranges::count(text, ',') + 1 != std::ssize(numbers)) return false;
  for (double& number : numbers) {
    const auto read = text::number<double>(text::takePart(text, ','));
    if (!read) return false;
    number = *read;
  }
  return true;
}

bool inLattice(double metres) { return std::abs(metres) <= kFarthest; }
lattice::Step steps(double metres) { return static_cast<lattice::Step>(std::floor(metres * lattice::kStepsPerMetre + 0.5)); }

std::string number(double value) { return text::rounded(value, 17); }
std::string number(float value) { return text::rounded(static_cast<double>(value), 9); }

Outcome<wire::Query> readPlaces(std::string_view query, bool normals) {
  wire::Query out;
  const auto places = queryParameters(query, "at");
  if (!places) return places.error();
  if (places->empty() || places->size() > kMaxHttpPlaces)
    return Error{"Name 1 to " + std::to_string(kMaxHttpPlaces) + " places as at=X,Z, in metres."};
  for (const std::string& place : *places) {
    std::array<double, 2> at{};
    if (!parseNumbers(place, at) || !inLattice(at[0]) || !inLattice(at[1]))
      return Error{"A place is at=X,Z: two numbers in metres, within 4.398e12 of the origin."};
    out.x.push_back(steps(at[0]));
    out.z.push_back(steps(at[1]));
  }
  if (!normals) return out;
  out.kind = wire::QueryKind::kNormals;
  const auto spacing = queryParameter(query, "spacing");
  if (!spacing) return spacing.error();
  if (spacing->empty()) return out;
  std::array<double, 1> metres{};
  if (!parseNumbers(*spacing, metres) || steps(metres[0]) < 1 || steps(metres[0]) > wire::kMaxSpacing)
    return Error{"spacing is the distance to each side for the slope, 0.004 to 256 metres."};
  out.spacing = static_cast<std::uint32_t>(steps(metres[0]));
  return out;
}

Outcome<wire::Query> readRays(std::string_view query) {
  wire::Query out;
  out.kind = wire::QueryKind::kRays;
  const auto rays = queryParameters(query, "ray");
  if (!rays) return rays.error();
  if (rays->empty() || rays->size() > kMaxHttpRays)
    return Error{"Name 1 to " + std::to_string(kMaxHttpRays) +
                 " rays as ray=X,Y,Z,DX,DY,DZ: where they begin, in metres, and their direction."};
  std::array<double, 1> reach{10'000};
  const auto requested = queryParameter(query, "reach");
  if (!requested) return requested.error();
  if (!requested->empty() && (!parseNumbers(*requested, reach) || reach[0] < 0 || reach[0] > wire::kMaxReach))
    return Error{"reach is the length of the rays, 0 to 100000 metres."};
  for (const std::string& text : *rays) {
    std::array<double, 6> n{};
    const bool numbers = parseNumbers(text, n);
    const double most = std::max({std::abs(n[3]), std::abs(n[4]), std::abs(n[5])});
    if (!numbers || !inLattice(n[0]) || !inLattice(n[2]) || std::abs(n[1]) > 1e6 || most < 1e-6 || most > 1e6)
      return Error{
          "A ray is ray=X,Y,Z,DX,DY,DZ: six numbers, a place in metres within 4.398e12 (Y within 1e6) and a direction that is not 0."};
    out.rays.push_back({steps(n[0]), steps(n[2]), n[1], n[3], n[4], n[5], reach[0]});
  }
  return out;
}

std::string answerText(const wire::Query& query, const wire::Answer& answer) {
  const auto list = [](const std::string& name, std::size_t count, const auto& entry) {
    std::string out = "{\"" + name + "\": [";
    for (std::size_t k = 0; k < count; ++k) out += (k > 0 ? ", " : "") + entry(k);
    return out + "]}\n";
  };
  if (query.kind == wire::QueryKind::kHeights)
    return list("heights", answer.heights.size(), [&](std::size_t k) { return number(answer.heights[k]); });
  if (query.kind == wire::QueryKind::kNormals)
    return list("normals", answer.normals.size() / 3, [&](std::size_t k) {
      const auto n = std::span(answer.normals).subspan(3 * k, 3);
      return "[" + number(n[0]) + ", " + number(n[1]) + ", " + number(n[2]) + "]";
    });
  return list("rays", answer.distances.size(), [&](std::size_t k) -> std::string {
    if (answer.distances[k] < 0) return "null";
    const wire::Ray& ray = query.rays[k];
    const double t = answer.distances[k] / std::hypot(ray.directionX, ray.directionY, ray.directionZ);
    return "{\"distance\": " + number(answer.distances[k]) + ", \"at\": [" +
           number(static_cast<double>(ray.x) * lattice::kMetresPerStep + t * ray.directionX) + ", " + number(ray.y + t * ray.directionY) +
           ", " + number(static_cast<double>(ray.z) * lattice::kMetresPerStep + t * ray.directionZ) + "]}";
  });
}

std::optional<Answer> respond(const Request& request, const session::Directory& directory) {
  const std::string_view path = request.path(), query = request.query();
  const bool heights = path == "/v1/heights", normals = path == "/v1/normals", rays = path == "/v1/rays";
  if (!heights && !normals && !rays) return std::nullopt;
  if (!request.reads()) return wrongMethod();
  const auto name = queryParameter(query, "session");
  if (!name) return plain(400, name.error().message);
  const auto session = directory.find(name->empty() ? session::kDefaultName : std::string_view(*name));
  if (!session) return plain(404, "There is no session of that name here; /v1/sessions lists the sessions.");
  session->use();
  auto places = rays ? readRays(query) : readPlaces(query, normals);
  if (!places) return plain(400, places.error().message);
  return madeBy({.work = [terrain = session->terrain(), places = std::move(*places)](const std::stop_token& stop) {
    query::Answering answering(terrain, places);
    while (!answering.isDone() && !stop.stop_requested()) answering.work();
    return json(answerText(places, answering.take()));
  }});
}

}  // namespace

Route queryRoute(std::shared_ptr<session::Directory> directory) {
  return [directory = std::move(directory)](const Request& request) { return respond(request, *directory); };
}

}  // namespace ridgecast::http
