#include "server/http/query_body.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <utility>

#include "common/text/text.h"
#include "common/wire/wire.h"
#include "server/access/host.h"
#include "server/http/queries.h"
#include "server/http/routes.h"

namespace ridgecast::http {

namespace {

static_assert(std::endian::native == std::endian::little, "bodies are sent and read as they lie in memory");

constexpr char kPlace[] = "A place is X,Z: two numbers in metres, within 4.398e12 of the origin (with crs, its two coordinates)";
constexpr char kRay[] =
    "A ray is X,Y,Z,DX,DY,DZ: six numbers, a place in metres within 4.398e12 (Y within 1e6) and a direction that is not 0 (with crs, the "
    "place's two coordinates, its height, and the direction's metres east, north and up)";
constexpr char kSpacing[] = "spacing is the distance to each side for the slope, 0.004 to 256 metres.";
constexpr char kReach[] = "reach is the length of the rays, 0 to 100000 metres.";

using wire::QueryKind;
constexpr std::size_t kValuesATime = 256;  // of JSON
constexpr std::array<QueryForm, 4> kForms{{
    {QueryKind::kHeights, "/v1/heights", "at", "at", 2, kMaxHttpPlaces, kPlace, "spacing", kSpacing},
    {QueryKind::kNormals, "/v1/normals", "at", "at", 2, kMaxHttpPlaces, kPlace, "spacing", kSpacing},
    {QueryKind::kMaterials, "/v1/materials", "at", "at", 2, kMaxHttpPlaces, kPlace, "spacing", kSpacing},
    {QueryKind::kRays, "/v1/rays", "ray", "rays", 6, kMaxHttpRays, kRay, "reach", kReach},
}};

constexpr double kFarthest = static_cast<double>(lattice::kMaxPosition) * lattice::kMetresPerStep;
bool inLattice(double metres) { return std::abs(metres) <= kFarthest; }
lattice::Step steps(double metres) { return static_cast<lattice::Step>(std::floor(metres * lattice::kStepsPerMetre + 0.5)); }

Error countError(const QueryForm& form) {
  return Error{"A body has 1 to " + std::to_string(kMaxPosted) + (form.kind == QueryKind::kRays ? " rays." : " places.")};
}
Error wrongOne(const QueryForm& form, std::size_t index) {
  return Error{std::string(form.isOne) + "; number " + std::to_string(index + 1) + " is not."};
}

}  // namespace

Outcome<wire::Query> queryOf(const QueryForm& form, std::span<const double> all, std::optional<double> option) {
  wire::Query out;
  out.kind = form.kind;
  const bool rays = form.kind == QueryKind::kRays;
  const double reach = option.value_or(10'000);
  if (rays && !(reach >= 0 && reach <= wire::kMaxReach)) return Error{form.isOption};
  if (!rays && option && !(*option > 0 && *option <= 300 && steps(*option) >= 1 && steps(*option) <= wire::kMaxSpacing))
    return Error{form.isOption};
  if (!rays && option) out.spacing = static_cast<std::uint32_t>(steps(*option));
  const std::size_t count = all.size() / form.numbers;
  (rays ? out.rays.reserve(count) : (out.x.reserve(count), out.z.reserve(count)));
  for (std::size_t k = 0; k < count; ++k) {
    const auto n = all.subspan(k * form.numbers, form.numbers);
    if (!rays) {
      if (!inLattice(n[0]) || !inLattice(n[1])) return wrongOne(form, k);
      out.x.push_back(steps(n[0]));
      out.z.push_back(steps(n[1]));
      continue;
    }
    // Compared so that no NaN passes.
    const bool hasPlace = inLattice(n[0]) && inLattice(n[2]) && std::abs(n[1]) <= 1e6;
    const bool isDirection = std::all_of(n.begin() + 3, n.end(), [](double d) { return std::abs(d) <= 1e6; }) &&
                             std::any_of(n.begin() + 3, n.end(), [](double d) { return std::abs(d) >= 1e-6; });
    if (!hasPlace || !isDirection) return wrongOne(form, k);
    out.rays.push_back({steps(n[0]), steps(n[2]), n[1], n[3], n[4], n[5], reach});
  }
  return out;
}

const QueryForm* queryFormOf(std::string_view path) {
  const auto* form = std::ranges::find(kForms, path, &QueryForm::path);
  return form == kForms.end() ? nullptr : form;
}

std::optional<BodyType> bodyTypeOf(std::string_view contentType) {
  const std::string_view type = text::trimmed(text::takePart(contentType, ';'));
  if (access::sameIgnoringCase(type, "application/json")) return BodyType::kJson;
  if (access::sameIgnoringCase(type, "application/octet-stream")) return BodyType::kDoubles;
  return std::nullopt;
}

std::size_t mostBytes(const QueryForm& form, BodyType type) {
  return kMaxPosted * form.numbers * (type == BodyType::kJson ? 32 : sizeof(double));
}

Outcome<std::optional<double>> optionOf(const QueryForm& form, std::string_view query) {
  const auto given = queryParameter(query, form.option);
  if (!given) return given.error();
  const auto value = text::number<double>(*given);
  if (!given->empty() && !value) return Error{form.isOption};
  return value;
}

Outcome<std::vector<double>> numbersOfUrl(const QueryForm& form, std::string_view query) {
  const auto ones = queryParameters(query, form.parameter);
  if (!ones) return ones.error();
  if (ones->empty() || ones->size() > form.mostInUrl)
    return Error{"Name 1 to " + std::to_string(form.mostInUrl) +
                 (form.kind == QueryKind::kRays ? " rays as ray=X,Y,Z,DX,DY,DZ: where they begin, in metres, and their direction."
                                                : " places as at=X,Z, in metres.")};
  std::vector<double> numbers;
  for (std::size_t k = 0; k < ones->size(); ++k) {
    std::string_view rest = (*ones)[k];
    if (std::ranges::count(rest, ',') + 1 != static_cast<std::ptrdiff_t>(form.numbers)) return wrongOne(form, k);
    for (std::size_t n = 0; n < form.numbers; ++n) {
      const auto number = text::number<double>(text::takePart(rest, ','));
      if (!number) return wrongOne(form, k);
      numbers.push_back(*number);
    }
  }
  return {boost::system::in_place_value, std::move(numbers)};
}

std::optional<Outcome<wire::Query>> BodyReader::place() {
  const std::size_t end = std::min(numbers_.size(), placed_ + kValuesATime);
  for (; toWorld_ && placed_ < end; placed_ += form_.numbers)
    if (!toWorld_(std::span(numbers_).subspan(placed_, form_.numbers)))
      return Error{"The CRS of the map does not reach " + std::string(form_.kind == QueryKind::kRays ? "ray" : "place") + " number " +
                   std::to_string(placed_ / form_.numbers + 1) + "."};
  if (toWorld_ && placed_ < numbers_.size()) return std::nullopt;
  return queryOf(form_, numbers_, option_);
}

std::optional<Outcome<wire::Query>> BodyReader::read() {
  if (in_ == In::kPlacing) return place();
  const bool rays = form_.kind == QueryKind::kRays;
  if (type_ == BodyType::kDoubles) {
    const std::size_t each = form_.numbers * sizeof(double);
    if (body_.empty() || body_.size() % each != 0)
      return Error{std::string("The body is ") + (rays ? "rays, six doubles each" : "places, two doubles each") + ": a multiple of " +
                   std::to_string(each) + " bytes, not " + std::to_string(body_.size()) + "."};
    numbers_.resize(body_.size() / sizeof(double));
    std::memcpy(numbers_.data(), body_.data(), body_.size());
    in_ = In::kPlacing;
    return place();
  }
  for (std::size_t k = 0; k < kValuesATime; ++k) {
    const bool right = in_ == In::kStart ? (in_ = In::kObject, take("{")) : in_ == In::kObject ? member() : one();
    if (numbers_.size() > kMaxPosted * form_.numbers) return countError(form_);
    if (!right)
      return Error{rays ? R"(The body must be {"rays": [[x, y, z, dx, dy, dz], ...], "reach": metres}, of which reach may be absent.)"
                        : R"(The body must be {"at": [[x, z], ...], "spacing": metres}, of which spacing may be absent.)"};
    if (in_ == In::kPlacing) return numbers_.empty() ? countError(form_) : place();
  }
  return std::nullopt;
}

bool BodyReader::take(std::string_view text) {
  const std::string_view rest = std::string_view(body_).substr(at_);
  at_ += std::min(rest.find_first_not_of(" \t\r\n"), rest.size());
  if (!std::string_view(body_).substr(at_).starts_with(text)) return false;
  at_ += text.size();
  return true;
}

std::optional<double> BodyReader::number() {
  take("");
  const std::string_view rest = std::string_view(body_).substr(at_);
  const std::string_view unsignedPart = rest.substr(rest.starts_with('-') ? 1 : 0);
  const auto isDigit = [](char c) { return c >= '0' && c <= '9'; };
  double value = 0;
  const auto [end, failed] = std::from_chars(rest.data(), rest.data() + rest.size(), value);
  if (unsignedPart.empty() || !isDigit(unsignedPart.front()) || failed != std::errc() || !isDigit(end[-1])) return std::nullopt;
  at_ += static_cast<std::size_t>(end - rest.data());
  return value;
}

bool BodyReader::member() {
  if (take("\"" + std::string(form_.list) + "\"")) {
    in_ = In::kList;
    return !std::exchange(sawList_, true) && take(":") && take("[");
  }
  if (!take("\"" + std::string(form_.option) + "\"") || std::exchange(sawOption_, true) || !take(":")) return false;
  option_ = number();
  return option_ && memberEnds();
}

bool BodyReader::one() {
  for (std::size_t k = 0; k < form_.numbers; ++k) {
    if (!take(k == 0 ? "[" : ",")) return false;
    const auto value = number();
    if (!value) return false;
    numbers_.push_back(*value);
  }
  return take("]") && (take(",") || (take("]") && memberEnds()));
}

bool BodyReader::memberEnds() {
  in_ = take(",") ? In::kObject : In::kPlacing;
  return in_ == In::kObject || (take("}") && (take(""), at_ == body_.size()));
}

}  // namespace ridgecast::http
