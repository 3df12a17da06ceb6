#include "common/camera/path.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <numbers>
#include <random>
#include <string>

namespace ridgecast::camera {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
double flat(lattice::Point) { return 100; }
double bumpy(lattice::Point p) { return 50 * std::sin(static_cast<double>(p.x % 100'000) / 3000) + static_cast<double>(p.z % 1000) / 100; }
double metres(lattice::Step whole, double remainder) { return (static_cast<double>(whole) + remainder) * lattice::kMetresPerStep; }

Path parsed(const std::string& json) {
  const auto path = parsePath(json);
  EXPECT_TRUE(path) << path.error().message;
  return path ? *path : Path{};
}

std::string tour(double x0 = 0, double z0 = 0) {
  const auto text = [](double v) {
    char out[64];
    std::snprintf(out, sizeof out, "%.17g", v);
    return std::string(out);
  };
  std::string json = R"({"terrain":"alpine","seed":7,"fov":45,"keyframes":[)";
  const double keys[5][6] = {{0, 0, 0, 120, 350, -10},
                             {10, 300, -50, 80, 20, 0},
                             {14, 420, -80, 80, 200, -30},
                             {30, 400, 700, 2, 190, 5},
                             {31, 0, 0, 900, -10, 90}};
  for (const auto& k : keys)
    json.append(k[0] > 0 ? "," : "")
        .append("{\"t\":" + text(k[0]) + ",\"x\":" + text(x0 + k[1]) + ",\"z\":" + text(z0 + k[2]) + ",\"altitude\":" + text(k[3]) +
                ",\"yaw\":" + text(k[4]) + ",\"pitch\":" + text(k[5]) + "}");
  return json + "]}";
}

TEST(Path, ReadsEveryField) {
  const Path path = parsed(tour());
  EXPECT_EQ(path.terrain, "alpine");
  EXPECT_EQ(path.seed, 7u);
  EXPECT_NEAR(path.verticalFov, 45 * kDegree, 1e-12);
  ASSERT_EQ(path.keyframes.size(), 5u);
  EXPECT_EQ(path.duration(), 31);
  EXPECT_EQ(path.keyframes[1].x, 300 * 256);
  EXPECT_EQ(path.keyframes[1].z, -50 * 256);
  EXPECT_TRUE(path.keyframes[1].aboveGround);
  EXPECT_NEAR(path.keyframes[2].pitch, -30 * kDegree, 1e-12);
}

TEST(Path, DefaultsWhereOptional) {
  const Path path = parsed(R"({"keyframes":[{"t":0,"x":1.5,"z":-0.001953125,"y":-3,"yaw":0,"pitch":0}],"name":"a","comment":["b"]})");
  EXPECT_EQ(path.terrain, "");
  EXPECT_EQ(path.seed, 1u);
  EXPECT_NEAR(path.verticalFov, 60 * kDegree, 1e-12);
  EXPECT_EQ(path.keyframes[0].x, 384);
  EXPECT_EQ(path.keyframes[0].z, -1);  // half a step rounds away from zero
  EXPECT_FALSE(path.keyframes[0].aboveGround);
  EXPECT_EQ(poseAt(path, 5, flat).y, -3);
}

TEST(Path, FarPositionsAreExact) {
  const Path path = parsed(R"({"keyframes":[{"t":0,"x":1000000000000.25,"z":-1e12,"altitude":1,"yaw":0,"pitch":0}]})");
  EXPECT_EQ(path.keyframes[0].x, 256'000'000'000'064);
  EXPECT_EQ(path.keyframes[0].z, -256'000'000'000'000);
}

TEST(Path, HitsItsKeyframes) {
  for (double far : {0.0, 1e12}) {
    const Path path = parsed(tour(far, -far));
    for (const Keyframe& key : path.keyframes) {
      const Pose pose = poseAt(path, key.t, bumpy);
      EXPECT_EQ(pose.x, key.x);
      EXPECT_EQ(pose.z, key.z);
      EXPECT_NEAR(pose.y, key.height + bumpy({key.x, key.z}), 1e-9);
      EXPECT_NEAR(std::remainder(pose.yaw - key.yaw, 2 * std::numbers::pi), 0, 1e-12);
      EXPECT_NEAR(pose.pitch, key.pitch, 1e-12);
    }
  }
}

TEST(Path, IsClampedToItsTimes) {
  const Path path = parsed(tour());
  for (double t : {-5.0, 0.0, std::numeric_limits<double>::quiet_NaN()}) EXPECT_EQ(poseAt(path, t, flat).x, path.keyframes.front().x);
  for (double t : {31.0, 32.0, 1e300}) EXPECT_EQ(poseAt(path, t, flat).z, path.keyframes.back().z);
}

TEST(Path, IsContinuousAlsoInItsVelocity) {
  const Path path = parsed(tour());
  const auto x = [&](double t) {
    const Pose pose = poseAt(path, t, flat);
    return metres(pose.x, pose.remainderX);
  };
  const double h = 1e-4;
  for (double t = h; t + h < path.duration(); t += 0.01) {
    EXPECT_LT(std::abs(x(t + h) - x(t)), 0.1);
    const double before = (x(t) - x(t - h)) / h, after = (x(t + h) - x(t)) / h;
    EXPECT_LT(std::abs(after - before), 0.5) << t;  // m/s
  }
}

TEST(Path, IsAsSmoothFarOutAsAtTheOrigin) {
  const Path near = parsed(tour()), far = parsed(tour(1e12, -1e12));
  const lattice::Step offset = 256'000'000'000'000;
  for (double t = 0; t <= 31; t += 0.037) {
    const Pose a = poseAt(near, t, flat), b = poseAt(far, t, flat);
    EXPECT_EQ(b.x - a.x, offset);
    EXPECT_EQ(b.z - a.z, -offset);
    EXPECT_EQ(a.remainderX, b.remainderX);
    EXPECT_EQ(a.remainderZ, b.remainderZ);
    EXPECT_TRUE(a.remainderX >= 0 && a.remainderX < 1 && a.remainderZ >= 0 && a.remainderZ < 1);
    EXPECT_EQ(a.y, b.y);
  }
}

TEST(Path, HeightsStayBetweenTheirKeyframes) {
  const Path path = parsed(tour());
  for (std::size_t k = 0; k + 1 < path.keyframes.size(); ++k) {
    const Keyframe &a = path.keyframes[k], &b = path.keyframes[k + 1];
    for (double s = 0; s <= 1; s += 0.01) {
      const Pose pose = poseAt(path, a.t + s * (b.t - a.t), bumpy);
      const double altitude = pose.y - bumpy({pose.x, pose.z});
      EXPECT_GE(altitude, std::min(a.height, b.height) - 1e-9);
      EXPECT_LE(altitude, std::max(a.height, b.height) + 1e-9);
    }
  }
}

TEST(Path, AltitudeFollowsTheGroundOnlyBetweenAltitudes) {
  const Path path = parsed(R"({"keyframes":[
    {"t":0,"x":0,"z":0,"altitude":10,"yaw":0,"pitch":0},{"t":1,"x":100,"z":0,"altitude":10,"yaw":0,"pitch":0},
    {"t":2,"x":200,"z":0,"y":500,"yaw":0,"pitch":0},{"t":3,"x":300,"z":0,"y":500,"yaw":0,"pitch":0}]})");
  const Pose low = poseAt(path, 0.37, bumpy);
  EXPECT_NEAR(low.y - bumpy({low.x, low.z}), 10, 1e-9);
  EXPECT_NEAR(poseAt(path, 2.5, bumpy).y, 500, 1e-9);
  double last = poseAt(path, 0.9999, flat).y;
  for (double t = 1; t <= 2; t += 0.001) {
    const double y = poseAt(path, t, flat).y;
    EXPECT_LT(std::abs(y - last), 2.5);  // 390 m in a second, without a jump
    last = y;
  }
}

TEST(Path, YawTurnsTheShortestWay) {
  const Path path = parsed(tour());
  // 350 to 20 degrees: up through 0.
  EXPECT_NEAR(poseAt(path, 5, flat).yaw, 365 * kDegree, 1e-9);
  // 20 to 200: exactly half a turn, either way but through the same pose every time.
  EXPECT_EQ(poseAt(path, 12, flat).yaw, poseAt(path, 12, flat).yaw);
  double last = poseAt(path, 0, flat).yaw;
  for (double t = 0; t <= 31; t += 0.01) {
    const double yaw = poseAt(path, t, flat).yaw;
    EXPECT_LT(std::abs(std::remainder(yaw - last, 2 * std::numbers::pi)), 3.0 * kDegree);
    last = yaw;
  }
}

TEST(Path, WildCurvesStayOnTheLattice) {
  const Path path = parsed(R"({"keyframes":[
    {"t":0,"x":-4.3e12,"z":0,"y":0,"yaw":0,"pitch":0},{"t":0.001,"x":4.3e12,"z":0,"y":0,"yaw":0,"pitch":0},
    {"t":86400,"x":4.3e12,"z":4.3e12,"y":0,"yaw":0,"pitch":0}]})");
  for (double t = 0; t < 86400; t += 311.3) EXPECT_TRUE(isValid({poseAt(path, t, flat), {}}));
}

std::string errorOf(const std::string& json) {
  const auto path = parsePath(json);
  EXPECT_FALSE(path) << json;
  return path ? "" : path.error().message;
}

TEST(Path, SaysWhatIsWrong) {
  const auto key = [](const std::string& fields) {
    return R"({"keyframes":[{"t":0,"x":0,"z":0,"y":0,"yaw":0,"pitch":0},)" + fields + "]}";
  };
  const std::vector<std::pair<std::string, std::vector<std::string>>> cases{
      {"", {"not JSON"}},
      {"nonsense", {"not JSON", "byte"}},
      {"{\"keyframes\":[{\"t\":NaN}]}", {"not JSON"}},
      {"[]", {"object"}},
      {"7", {"object"}},
      {"{}", {"keyframes", "missing"}},
      {R"({"keyframes":[]})", {"keyframes", "at least one"}},
      {R"({"keyframes":{}})", {"keyframes", "list"}},
      {R"({"keyframes":null})", {"keyframes", "list"}},
      {R"({"keyframes":[1]})", {"keyframe 1", "object"}},
      {R"({"terrain":5,"keyframes":[1]})", {"terrain", "name"}},
      {R"({"terrain":"","keyframes":[1]})", {"terrain", "name"}},
      {R"({"seed":-1,"keyframes":[1]})", {"seed", "whole number"}},
      {R"({"seed":1.5,"keyframes":[1]})", {"seed", "whole number"}},
      {R"({"seed":4294967296,"keyframes":[1]})", {"seed", "4294967295"}},
      {R"({"fov":0,"keyframes":[1]})", {"fov", "degrees"}},
      {R"({"fov":"60","keyframes":[1]})", {"fov", "string"}},
      {R"({"speed":3,"keyframes":[1]})", {"speed", "not known"}},
      {R"({"keyframes":[{"t":1,"x":0,"z":0,"y":0,"yaw":0,"pitch":0}]})", {"keyframe 1", "\"t\"", "0"}},
      {key(R"({"t":0,"x":0,"z":0,"y":0,"yaw":0,"pitch":0})"), {"keyframe 2", "\"t\"", "later"}},
      {key(R"({"t":1e-9,"x":0,"z":0,"y":0,"yaw":0,"pitch":0})"), {"keyframe 2", "\"t\"", "later"}},
      {key(R"({"t":-1,"x":0,"z":0,"y":0,"yaw":0,"pitch":0})"), {"keyframe 2", "\"t\"", "seconds"}},
      {key(R"({"t":90000,"x":0,"z":0,"y":0,"yaw":0,"pitch":0})"), {"keyframe 2", "\"t\"", "86400"}},
      {key(R"({"x":0,"z":0,"y":0,"yaw":0,"pitch":0})"), {"keyframe 2", "\"t\"", "missing"}},
      {key(R"({"t":1,"z":0,"y":0,"yaw":0,"pitch":0})"), {"keyframe 2", "\"x\"", "missing"}},
      {key(R"({"t":1,"x":5e12,"z":0,"y":0,"yaw":0,"pitch":0})"), {"keyframe 2", "\"x\"", "4.3e+12"}},
      {key(R"({"t":1,"x":1e308,"z":0,"y":0,"yaw":0,"pitch":0})"), {"keyframe 2", "\"x\"", "metres"}},
      {key(R"({"t":1,"x":1e400,"z":0,"y":0,"yaw":0,"pitch":0})"), {"too large"}},
      {key(R"({"t":1,"x":"0","z":0,"y":0,"yaw":0,"pitch":0})"), {"keyframe 2", "\"x\"", "string"}},
      {key(R"({"t":1,"x":null,"z":0,"y":0,"yaw":0,"pitch":0})"), {"keyframe 2", "\"x\"", "null"}},
      {key(R"({"t":1,"x":0,"z":[0],"y":0,"yaw":0,"pitch":0})"), {"keyframe 2", "\"z\"", "array"}},
      {key(R"({"t":1,"x":0,"z":0,"yaw":0,"pitch":0})"), {"keyframe 2", "altitude", "\"y\""}},
      {key(R"({"t":1,"x":0,"z":0,"y":0,"altitude":1,"yaw":0,"pitch":0})"), {"keyframe 2", "\"y\"", "both"}},
      {key(R"({"t":1,"x":0,"z":0,"altitude":-1,"yaw":0,"pitch":0})"), {"keyframe 2", "altitude", "metres"}},
      {key(R"({"t":1,"x":0,"z":0,"y":1e7,"yaw":0,"pitch":0})"), {"keyframe 2", "\"y\"", "metres"}},
      {key(R"({"t":1,"x":0,"z":0,"y":0,"pitch":0})"), {"keyframe 2", "yaw", "missing"}},
      {key(R"({"t":1,"x":0,"z":0,"y":0,"yaw":0,"pitch":91})"), {"keyframe 2", "pitch", "90"}},
      {key(R"({"t":1,"x":0,"z":0,"y":0,"yaw":0,"pitch":0,"roll":1})"), {"keyframe 2", "roll", "not known"}},
  };
  for (const auto& [json, parts] : cases) {
    const std::string message = errorOf(json);
    for (const std::string& part : parts) EXPECT_NE(message.find(part), std::string::npos) << json << " -> " << message;
  }
}

TEST(Path, LimitsItsSize) {
  EXPECT_NE(errorOf(std::string(2 << 20, ' ')).find("1 MiB"), std::string::npos);
  std::string many = R"({"keyframes":[0)";
  for (int k = 0; k < 10'000; ++k) many += ",0";
  EXPECT_NE(errorOf(many + "]}").find("10000"), std::string::npos);
  errorOf(std::string(1 << 20, '['));  // deep nesting must not overflow a stack
  std::string deep = "{\"comment\":" + std::string(400'000, '[') + std::string(400'000, ']') + ",\"keyframes\":[1]}";
  EXPECT_NE(errorOf(deep).find("keyframe 1"), std::string::npos);
}

TEST(Path, EveryTruncatedPrefixIsAnError) {
  const std::string json = tour();
  for (std::size_t length = 0; length < json.size(); ++length) EXPECT_FALSE(parsePath(json.substr(0, length)));
}

TEST(Path, DamagedTextNeverCrashes) {
  std::mt19937 random(3);
  for (int round = 0; round < 3000; ++round) {
    std::string json = tour();
    for (int k = 0; k < 3; ++k) json[random() % json.size()] = static_cast<char>(random());
    const auto path = parsePath(json);
    if (!path) continue;
    for (double t : {0.0, 7.7, 1000.0}) EXPECT_TRUE(isValid({poseAt(*path, t, flat), {}}));
  }
}

TEST(Path, FilesThatCannotBeRead) {
  const auto missing = readPath("/nonexistent/tour.json");
  ASSERT_FALSE(missing);
  EXPECT_NE(missing.error().message.find("/nonexistent/tour.json"), std::string::npos);
  const auto directory = readPath("/");
  ASSERT_FALSE(directory);
  EXPECT_NE(directory.error().message.find("directory"), std::string::npos);
  const auto file = std::filesystem::path(testing::TempDir()) / "ridgecast-path-test.json";
  std::ofstream(file) << tour();
  EXPECT_TRUE(readPath(file));
  std::ofstream(file) << "{";
  const auto broken = readPath(file);
  ASSERT_FALSE(broken);
  EXPECT_NE(broken.error().message.find("ridgecast-path-test.json"), std::string::npos);
  std::ofstream(file) << std::string(3 << 20, ' ');
  EXPECT_FALSE(readPath(file));
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace ridgecast::camera
