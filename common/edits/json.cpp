#include "common/edits/json.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace ridgecast::edits {
namespace {

using Json = nlohmann::json;
using lattice::Step;

// Reads fields one after another; what is wrong first is kept, and all that follows is 0.
class Fields {
 public:
  Fields(const Json& object, const ToWorld& toWorld) : object_(object), toWorld_(toWorld) {
    if (!has("crs")) return;
    const Json& crs = *find("crs");
    if (!crs.is_string())
      fail("crs", "must be a text, such as \"lonlat\" or \"EPSG:2056\"");
    else if (!toWorld)
      fail("crs", "is taken over HTTP alone; here places are metres of the world");
    else
      crs_ = crs.get<std::string>();
  }

  double number(const char* name, std::optional<double> otherwise = {}) {
    const Json* value = find(name);
    if (!value) return otherwise ? *otherwise : fail(name, "is missing");
    return value->is_number() ? value->get<double>() : fail(name, "must be a number");
  }
  Step steps(const char* name, std::optional<double> otherwise = {}) { return inSteps(name, number(name, otherwise)); }
  std::int32_t height(const char* name) { return narrow<std::int32_t>(name, steps(name)); }
  std::uint32_t in256(const char* name, double otherwise) { return narrow<std::uint32_t>(name, inSteps(name, number(name, otherwise))); }
  std::uint64_t whole(const char* name, std::optional<double> otherwise = {}) {
    const double v = number(name, otherwise);
    if (v >= 0 && v <= 1e15 && v == std::floor(v)) return static_cast<std::uint64_t>(v);
    return static_cast<std::uint64_t>(fail(name, "must be a whole number"));
  }
  bool has(const char* name) const { return object_.contains(name); }

  lattice::Point place() {
    if (crs_ || has("at")) {
      const std::vector<Step> at =
          row("at", find("at"), 2, 2, "must be a place: [first, second], in metres of the world or as the crs has it");
      return at.empty() ? lattice::Point() : lattice::Point{at[0], at[1]};
    }
    const Step x = steps("x"), z = steps("z");
    return {x, z};
  }
  // [[a, b], ...], each of `least` to `most` numbers, the first two of which are a place.
  std::vector<std::vector<Step>> rows(const char* name, std::size_t least, std::size_t most, std::size_t mostRows) {
    const Json* value = find(name);
    std::vector<std::vector<Step>> out;
    if (!value || !value->is_array() || value->size() > mostRows)
      return fail(name, "must be a list of at most " + std::to_string(mostRows) + " places"), out;
    for (const Json& one : *value) {
      auto steps = row(name, &one, least, most, "must be a list of places, each [x, z]");
      if (steps.empty()) break;
      out.push_back(std::move(steps));
    }
    return out;
  }
  std::vector<std::int32_t> list(const char* name, std::size_t most) {
    const Json* value = find(name);
    std::vector<std::int32_t> out;
    if (!value || !value->is_array() || value->size() > most)
      return fail(name, "must be a list of at most " + std::to_string(most) + " numbers"), out;
    for (const Json& v : *value)
      out.push_back(v.is_number() ? narrow<std::int32_t>(name, inSteps(name, v.get<double>()))
                                  : static_cast<std::int32_t>(fail(name, "must be a list of numbers")));
    return out;
  }
  std::uint32_t material() {
    const Json* value = find("material");
    if (!value) return 0;
    if (const std::uint32_t number = value->is_string() ? terrain::materialNumber(value->get<std::string>()) : 0) return number;
    return static_cast<std::uint32_t>(fail("material", "must be earth, rock, gravel, sand, grass, asphalt, concrete or snow"));
  }
  template <class T>
  T narrow(const char* name, Step v) {
    if (v >= 0 && static_cast<std::uint64_t>(v) <= std::uint64_t{std::numeric_limits<T>::max()}) return static_cast<T>(v);
    if (std::is_signed_v<T> && v < 0 && v >= -Step{std::numeric_limits<std::int32_t>::max()}) return static_cast<T>(v);
    return static_cast<T>(fail(name, "is out of range"));
  }
  double fail(const char* name, const std::string& what) {
    if (wrong_.empty()) wrong_ = std::string("An edit's \"") + name + "\" " + what + ".";
    return 0;
  }
  // Also refuses what nobody asked for.
  const std::string& wrong() {
    for (const auto& [name, value] : object_.items())
      if (wrong_.empty() && name != "op" && std::ranges::find(known_, name) == known_.end())
        wrong_ = "An edit of this kind has no \"" + name.substr(0, 64) + "\".";
    return wrong_;
  }

 private:
  const Json* find(const char* name) {
    known_.push_back(name);
    const auto it = object_.find(name);
    return it == object_.end() ? nullptr : &*it;
  }
  // Empty: there is something wrong.
  std::vector<Step> row(const char* name, const Json* value, std::size_t least, std::size_t most, const char* what) {
    const auto isNumber = [](const Json& v) { return v.is_number(); };
    if (!value || !value->is_array() || value->size() < least || value->size() > most || !std::ranges::all_of(*value, isNumber))
      return fail(name, what), std::vector<Step>();
    auto numbers = value->get<std::vector<double>>();
    if (crs_ && wrong_.empty()) {
      const auto world = toWorld_(*crs_, numbers[0], numbers[1]);
      if (!world) return wrong_ = world.error().message, std::vector<Step>();
      std::ranges::copy(*world, numbers.begin());
    }
    std::vector<Step> out;
    for (const double v : numbers) out.push_back(inSteps(name, v));
    return out;
  }
  Step inSteps(const char* name, double v) {
    if (!(std::abs(v) <= 1e13)) return static_cast<Step>(fail(name, "is beyond all there is"));
    return static_cast<Step>(std::floor(v * lattice::kStepsPerMetre + 0.5));
  }

  const Json& object_;
  const ToWorld& toWorld_;
  std::optional<std::string> crs_;  // none: metres of the world
  std::vector<std::string> known_;
  std::string wrong_;
};

Raise raise(Fields& f, int sign) {
  Raise o{f.place(), f.steps("radius"), f.steps("core", 0.0), f.height("by")};
  o.amount *= sign;
  return o;
}

Level level(Fields& f) {
  Level o;
  if (f.has("polygon")) {
    for (const auto& corner : f.rows("polygon", 2, 2, kMaxCorners)) o.corners.push_back({corner[0], corner[1]});
  } else {
    o.corners = {f.place()};
    o.radius = f.steps("radius");
  }
  o.height = f.height("height");
  o.slope = f.in256("slope", 1);
  return o;
}

Road road(Fields& f) {
  Road o;
  const auto line = f.rows("line", 2, 3, kMaxStations);
  o.surveyed = !line.empty() && line.front().size() == 3;
  for (const auto& station : line) {
    if ((station.size() == 3) != o.surveyed) f.fail("line", "must have a height at every place or at none");
    const Step y = station.size() == 3 ? std::clamp<Step>(station[2], -2 * lattice::kMaxHeight, 2 * lattice::kMaxHeight) : 0;
    o.line.push_back({station[0], station[1], static_cast<std::int32_t>(y)});
  }
  o.width = f.steps("width");
  o.grade = f.in256("grade", 0.1);
  o.slope = f.in256("slope", 171.0 / 256);
  return o;
}

Stamp stamp(Fields& f) {
  Stamp o{f.place(), 0, 0, 1, f.list("samples", std::size_t{kMaxStampSide} * kMaxStampSide)};
  const std::uint64_t columns = f.whole("columns");
  const Step spacing = f.steps("spacing", 0.5);
  if (columns < 2 || columns > kMaxStampSide || o.samples.size() % columns != 0)
    f.fail("columns", "must be 2 to 256 and divide the number of samples");
  if (spacing % kPostSteps != 0) f.fail("spacing", "must be a multiple of 0.5 m");
  o.width = static_cast<std::uint32_t>(columns);
  o.height = columns == 0 ? 0 : static_cast<std::uint32_t>(o.samples.size() / columns);
  o.spacing = f.narrow<std::uint32_t>("spacing", spacing / kPostSteps);
  return o;
}

}  // namespace

Outcome<Operation> fromJson(std::string_view text, const ToWorld& toWorld) {
  const Json in = Json::parse(text, nullptr, false);
  if (!in.is_object() || !in.contains("op") || !in["op"].is_string())
    return Error{R"(An edit is a JSON object with an "op": raise, lower, crater, level, smooth, road, stamp or undo.)"};
  const std::string op = in["op"];
  Fields fields(in, toWorld);
  Operation out;
  if (op == "raise" || op == "lower") {
    out.what = raise(fields, op == "raise" ? 1 : -1);
  } else if (op == "crater") {
    out.what = Crater{fields.place(), fields.steps("radius"), fields.height("depth")};
  } else if (op == "level") {
    out.what = level(fields);
  } else if (op == "smooth") {
    out.what = Smooth{fields.place(), fields.steps("radius"),
                      static_cast<std::uint32_t>(std::min<std::uint64_t>(fields.whole("passes", 4), 1000))};
  } else if (op == "road") {
    out.what = road(fields);
  } else if (op == "stamp") {
    out.what = stamp(fields);
  } else if (op == "undo") {
    out.what = Undo{fields.whole("edit")};
  } else {
    return Error{"There is no edit \"" + op.substr(0, 64) + "\"; there is raise, lower, crater, level, smooth, road, stamp and undo."};
  }
  if (op != "undo") out.material = fields.material();
  if (!fields.wrong().empty()) return Error{fields.wrong()};
  if (auto checked = check(out); !checked) return checked.error();
  return out;
}

}  // namespace ridgecast::edits
