#include "common/camera/path.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numbers>
#include <optional>
#include <sstream>
#include <utility>

#include <nlohmann/json.hpp>

#include "common/outcome/contract.h"
#include "common/text/file.h"

namespace ridgecast::camera {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxText = std::size_t{1} << 20;
constexpr std::size_t kMaxKeyframes = 10'000;
constexpr std::size_t kMaxTerrainName = 128;
constexpr double kMaxMetres = 4.3e12;
constexpr double kMaxSeconds = 24 * 3600;
constexpr double kMinSpacing = 0.001;  // seconds between keyframes
constexpr double kMaxHeight = 5e5;
constexpr double kMaxYaw = 1e6;
constexpr double kRadiansPerDegree = std::numbers::pi / 180;

// ---- reading: one object at a time; the first mistake is the error ----

class Fields {
 public:
  Fields(const Json& object, std::string name) : object_(object), name_(std::move(name)) {}

  bool has(const char* key) const { return object_.contains(key); }

  double number(const char* key, double low, double high, const char* unit) {
    if (error_) return 0;
    const std::string range = std::string("must be a number of ") + unit + " in [" + shortest(low) + ", " + shortest(high) + "]";
    if (!has(key)) return fail(key, "is missing; it " + range);
    const Json& value = object_[key];
    if (!value.is_number()) return fail(key, range + ", not " + value.type_name());
    const double v = value.get<double>();
    if (!std::isfinite(v) || v < low || v > high) return fail(key, range + ", not " + value.dump());
    return v;
  }

  void onlyKnows(std::initializer_list<const char*> known) {
    for (const auto& item : object_.items()) {
      if (error_ || std::find(known.begin(), known.end(), item.key()) != known.end()) continue;
      std::string list;
      for (const char* k : known) list += (list.empty() ? "" : ", ") + std::string(k);
      fail(item.key().substr(0, 40), "is not known; known are " + list);
    }
  }

  double fail(const std::string& key, const std::string& why) {
    if (!error_) error_ = Error{name_ + ": " + Json(key).dump(-1, ' ', true, Json::error_handler_t::replace) + " " + why};
    return 0;
  }
  const std::optional<Error>& error() const { return error_; }
  const Json& operator[](const char* key) const { return object_[key]; }

 private:
  static std::string shortest(double v) {
    std::ostringstream out;
    out << v;
    return out.str();
  }

  const Json& object_;
  std::string name_;
  std::optional<Error> error_;
};

Outcome<Keyframe> parseKeyframe(const Json& json, std::size_t number, const std::vector<Keyframe>& before) {
  const std::string name = "keyframe " + std::to_string(number);
  if (!json.is_object())
    return Error{name + " must be an object like {\"t\": 0, \"x\": 0, \"z\": 0, \"altitude\": 120, \"yaw\": 0, \"pitch\": -10}"};
  Fields fields(json, name);
  fields.onlyKnows({"t", "x", "z", "altitude", "y", "yaw", "pitch"});
  Keyframe key;
  key.t = fields.number("t", 0, kMaxSeconds, "seconds");
  // A power of two times a double is exact. Only rounding to whole steps loses anything, at most half a step.
  key.x = std::llround(fields.number("x", -kMaxMetres, kMaxMetres, "metres") * lattice::kStepsPerMetre);
  key.z = std::llround(fields.number("z", -kMaxMetres, kMaxMetres, "metres") * lattice::kStepsPerMetre);
  key.aboveGround = fields.has("altitude");
  if (key.aboveGround && fields.has("y")) fields.fail("y", "and \"altitude\" cannot both be given; keep one");
  if (!key.aboveGround && !fields.has("y")) fields.fail("altitude", "or \"y\" is missing: metres above the ground, or absolute");
  key.height = key.aboveGround ? fields.number("altitude", 0, kMaxHeight, "metres") : fields.number("y", -kMaxHeight, kMaxHeight, "metres");
  key.yaw = fields.number("yaw", -kMaxYaw, kMaxYaw, "degrees") * kRadiansPerDegree;
  key.pitch = fields.number("pitch", -90, 90, "degrees") * kRadiansPerDegree;
  if (fields.error()) return *fields.error();
  if (before.empty() && key.t != 0) fields.fail("t", "must be 0 in the first keyframe");
  if (!before.empty() && key.t < before.back().t + kMinSpacing)
    fields.fail("t", "must be later than in the keyframe before, by a millisecond at least");
  if (fields.error()) return *fields.error();
  return key;
}

// ---- interpolation ----

// A cubic over [0, span] from `from` to `to` with these slopes.
double hermite(double from, double to, double slopeFrom, double slopeTo, double span, double at) {
  const double s = at / span, r = 1 - s;
  return from * (1 + 2 * s) * r * r + to * s * s * (3 - 2 * s) + span * s * r * (slopeFrom * r - slopeTo * s);
}

// Values at four times around a segment. At the path's ends the outer ones repeat the end.
struct Around {
  std::array<double, 4> t, v;

  double slope(std::size_t at) const {  // 1 or 2
    const std::size_t low = at - 1, high = at + 1;
    return t[high] > t[low] ? (v[high] - v[low]) / (t[high] - t[low]) : 0;
  }
  double secant(std::size_t from) const { return t[from + 1] > t[from] ? (v[from + 1] - v[from]) / (t[from + 1] - t[from]) : 0; }
  // The slope, limited so that the curve between values 1 and 2 stays between them.
  double limitedSlope(std::size_t at) const {
    const double here = secant(1), there = secant(at == 1 ? 0 : 2);
    const bool isEnd = at == 1 ? t[0] == t[1] : t[2] == t[3];
    if (isEnd) return here;
    if (here * there <= 0) return 0;
    const double most = 3 * std::min(std::abs(here), std::abs(there)), plain = slope(at);
    return std::clamp(plain, -most, most);
  }
  double at(double time) const { return hermite(v[1], v[2], slope(1), slope(2), t[2] - t[1], time - t[1]); }
  double limitedAt(double time) const {
    const double y = hermite(v[1], v[2], limitedSlope(1), limitedSlope(2), t[2] - t[1], time - t[1]);
    return std::clamp(y, std::min(v[1], v[2]), std::max(v[1], v[2]));  // rounding
  }
};

double groundAt(const GroundHeight& ground, const Keyframe& key) {
  expects(static_cast<bool>(ground), "a path above the ground has one");
  return ground(lattice::Point{key.x, key.z});
}
double absoluteHeight(const GroundHeight& ground, const Keyframe& key) {
  return key.aboveGround ? key.height + groundAt(ground, key) : key.height;
}

void moveBy(lattice::Step from, double steps, lattice::Step& whole, double& remainder) {
  // A wild curve may leave the lattice between its keyframes. The camera then stops at the edge.
  steps = std::clamp(steps, static_cast<double>(-lattice::kMaxPosition - from), static_cast<double>(lattice::kMaxPosition - from));
  const double floor = std::floor(steps);
  whole = from + static_cast<lattice::Step>(floor);
  remainder = steps - floor;
  if (remainder < 1) return;  // a tiny negative number rounds up to 1
  whole += 1;
  remainder = 0;
}

}  // namespace

Outcome<Path> parsePath(std::string_view text) {
  if (text.size() > kMaxText) return Error{"the path has " + std::to_string(text.size()) + " bytes, at most 1 MiB is read"};
  Json json;
  try {
    json = Json::parse(text);
  } catch (const Json::parse_error& e) {
    return Error{"the path is not JSON: byte " + std::to_string(e.byte) + " of " + std::to_string(text.size()) + " is unexpected"};
  } catch (const Json::out_of_range&) {
    return Error{"the path holds a number that is too large to be one"};
  }
  if (!json.is_object()) return Error{"the path must be an object {\"keyframes\": [...]}, not " + std::string(json.type_name())};

  Fields fields(json, "the path");
  fields.onlyKnows({"terrain", "seed", "fov", "keyframes", "name", "comment"});
  Path path;
  if (fields.has("terrain")) {
    const Json& terrain = fields["terrain"];
    if (!terrain.is_string() || terrain.get_ref<const std::string&>().empty() ||
        terrain.get_ref<const std::string&>().size() > kMaxTerrainName)
      fields.fail("terrain", "must be a terrain's name, 1 to 128 bytes");
    else
      path.terrain = terrain.get<std::string>();
  }
  if (fields.has("seed")) {
    const Json& seed = fields["seed"];
    if (!seed.is_number_unsigned() || seed.get<std::uint64_t>() > 0xffffffffu)
      fields.fail("seed", "must be a whole number in [0, 4294967295]");
    else
      path.seed = seed.get<std::uint32_t>();
  }
  if (fields.has("fov")) path.verticalFov = fields.number("fov", 1, 170, "degrees") * kRadiansPerDegree;
  if (!fields.has("keyframes")) fields.fail("keyframes", "is missing; it must be a list of at least one keyframe");
  if (fields.error()) return *fields.error();
  const Json& list = fields["keyframes"];
  if (!list.is_array() || list.empty()) fields.fail("keyframes", "must be a list of at least one keyframe");
  if (list.size() > kMaxKeyframes) fields.fail("keyframes", "has " + std::to_string(list.size()) + " entries, at most 10000 are read");
  if (fields.error()) return *fields.error();

  path.keyframes.reserve(list.size());
  for (const Json& item : list) {
    Outcome<Keyframe> key = parseKeyframe(item, path.keyframes.size() + 1, path.keyframes);
    if (!key) return key.error();
    path.keyframes.push_back(*key);
  }
  return path;
}

Outcome<Path> readPath(const std::filesystem::path& file) {
  const std::string name = "path file '" + file.string() + "'";
  std::error_code failed;
  if (std::filesystem::is_directory(file, failed)) return Error{name + " is a directory; a JSON file is needed"};
  const auto text = text::readFile(file, kMaxText);
  if (!text) return Error{name + " cannot be read; does it exist?"};
  if (text->size() > kMaxText) return Error{name + " is larger than 1 MiB; that is not a camera path"};
  Outcome<Path> path = parsePath(*text);
  if (!path) return Error{name + ": " + path.error().message};
  return path;
}

Pose poseAt(const Path& path, double t, const GroundHeight& ground) {
  const std::vector<Keyframe>& keys = path.keyframes;
  expects(!keys.empty(), "a path has a keyframe");
  if (!(t > keys.front().t) || t >= keys.back().t) {
    const Keyframe& key = t >= keys.back().t ? keys.back() : keys.front();
    return {.x = key.x, .z = key.z, .remainderX = 0, .remainderZ = 0, .y = absoluteHeight(ground, key), .yaw = key.yaw, .pitch = key.pitch};
  }
  const auto later = std::upper_bound(keys.begin(), keys.end(), t, [](double time, const Keyframe& k) { return time < k.t; });
  const std::size_t to = static_cast<std::size_t>(later - keys.begin()), from = to - 1;
  const std::array<const Keyframe*, 4> around{&keys[from == 0 ? 0 : from - 1], &keys[from], &keys[to],
                                              &keys[std::min(to + 1, keys.size() - 1)]};
  const Keyframe &a = keys[from], &b = keys[to];
  const bool aboveGround = a.aboveGround && b.aboveGround;

  Around x, z, y;
  for (std::size_t k = 0; k < 4; ++k) {
    const Keyframe& key = *around[k];
    x.t[k] = z.t[k] = y.t[k] = key.t;
    x.v[k] = static_cast<double>(key.x - a.x);
    z.v[k] = static_cast<double>(key.z - a.z);
    y.v[k] = aboveGround && !key.aboveGround ? key.height - groundAt(ground, key) : aboveGround ? key.height : absoluteHeight(ground, key);
  }
  Pose pose;
  moveBy(a.x, x.at(t), pose.x, pose.remainderX);
  moveBy(a.z, z.at(t), pose.z, pose.remainderZ);
  pose.y = y.limitedAt(t) + (aboveGround ? ground(lattice::Point{pose.x, pose.z}) : 0);

  const double s = (t - a.t) / (b.t - a.t);
  pose.yaw = a.yaw + s * std::remainder(b.yaw - a.yaw, 2 * std::numbers::pi);
  pose.pitch = a.pitch + s * (b.pitch - a.pitch);
  return pose;
}

}  // namespace ridgecast::camera
