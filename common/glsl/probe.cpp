#include "common/glsl/probe.h"

#include <sys/resource.h>
#include <unistd.h>

#include <array>
#include <bit>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <sstream>

#include "common/glsl/library.h"
#include "common/glsl/tokens.h"
#include "common/glsl/translate.h"
#include "common/process/child.h"
#include "common/text/text.h"

namespace ridgecast::glsl {
namespace {

constexpr std::array<double, 10> kPlaces = {0, 5e3, 1e6, -1e6, 3e7, 1e8, -1e9, 1e12, -1e12, 4.39e12};  // metres, x; z is its mirror
constexpr std::size_t kBatch = 256, kBatches = 16;                                                     // points a place: 4,096
constexpr std::string_view kFlag = "--probe-terrain";

constexpr float kTolerance = 1e-3f;  // of a colour's components, beyond 0 to 1

// What the child says last is what it was at: "heights X Z", "materials X Z", "colours X Z" (steps), "fault X Z BITS" (of a height; with a
// traced library also "LINE NAME"), "material X Z" (that there is not), "colour X Z BITS" (of one without a number), or "done", with
// " X Z BITS" of a colour that is too bright or dark.
void say(const std::string& text) {
  const std::string line = text + "\n";
  if (write(STDOUT_FILENO, line.data(), line.size()) < 0) _exit(1);  // nobody listens
}
std::string placed(std::string_view what, lattice::Step x, lattice::Step z) {
  return std::string(what) + " " + std::to_string(x) + " " + std::to_string(z);
}

std::string traced(const Library& library, lattice::Step x, lattice::Step z, float height, std::uint32_t seed) {
  if (!library.trace() || std::isfinite(height)) return "";
  library.trace()(false);
  library.heights()(&x, &z, &height, 1, seed);
  const Trace found = library.trace()(std::isinf(height));
  return found.name ? " " + std::to_string(found.line) + " " + found.name : "";
}

// The rewrite for what is undefined.
std::string rewrite(std::string_view name, float height) {
  if (name == "/" || name == "mod") return "; keep the divisor above 0, such as max(b, 1e-6)";
  if (name == "inversesqrt" || name.starts_with("log")) return "; it takes numbers above 0: write " + std::string(name) + "(max(a, 1e-6))";
  if (std::isinf(height)) return "";
  if (name == "pow") return "; a negative number has no power: write pow(abs(a), b) or pow(max(a, 0.0), b)";
  if (name == "sqrt") return "; a negative number has no root: write sqrt(max(a, 0.0))";
  if (name == "normalize") return "; the vector is 0 there: write v * inversesqrt(max(dot(v, v), 1e-12))";
  return "";
}

void tryAll(const Library& library, std::size_t mostMaterial, std::uint32_t seed) {
  std::array<lattice::Step, kBatch> x, z;
  std::array<float, kBatch> out;
  std::array<float, 3 * kBatch> normals{}, colours;
  for (std::size_t i = 0; i < kBatch; ++i) normals[3 * i + 1] = 1;
  std::string beyond;
  std::uint64_t random = 1;
  const auto next = [&] { return random = lattice::mix(random + 0x9e3779b97f4a7c15u); };
  for (std::size_t round = 0; round < kBatches; ++round) {
    for (const double place : kPlaces) {
      const auto centre = static_cast<lattice::Step>(place * lattice::kStepsPerMetre);
      // Within 128 m, 2 km, 32 km and 128 km in turn.
      const int bits = std::array{16, 20, 24, 26}[round % 4];
      const lattice::Step half = lattice::Step{1} << (bits - 1);
      for (std::size_t i = 0; i < kBatch; ++i) {
        x[i] = centre + static_cast<lattice::Step>(next() >> (64 - bits)) - half;
        z[i] = -centre + static_cast<lattice::Step>(next() >> (64 - bits)) - half;
      }
      say(placed("heights", x[0], z[0]));
      library.heights()(x.data(), z.data(), out.data(), kBatch, seed);
      for (std::size_t i = 0; i < kBatch; ++i)
        if (!faultOf(out[i]).empty())
          return say(placed("fault", x[i], z[i]) + " " + std::to_string(std::bit_cast<std::uint32_t>(out[i])) +
                     traced(library, x[i], z[i], out[i], seed));
      if (library.materials()) {
        std::array<std::uint8_t, kBatch> materials;
        say(placed("materials", x[0], z[0]));
        library.materials()(x.data(), z.data(), out.data(), normals.data(), materials.data(), kBatch, seed);
        for (std::size_t i = 0; i < kBatch; ++i)
          if (materials[i] > mostMaterial) return say(placed("material", x[i], z[i]));
      }
      if (!library.colours()) continue;
      say(placed("colours", x[0], z[0]));
      library.colours()(x.data(), z.data(), out.data(), normals.data(), 0, colours.data(), kBatch, seed);
      for (std::size_t k = 0; k < colours.size(); ++k) {
        if (colours[k] >= -kTolerance && colours[k] <= 1 + kTolerance) continue;
        const std::string where = placed("", x[k / 3], z[k / 3]) + " " + std::to_string(std::bit_cast<std::uint32_t>(colours[k]));
        if (!std::isfinite(colours[k])) return say("colour" + where);
        if (beyond.empty()) beyond = where;
      }
    }
  }
  say("done" + beyond);
}

// Bytes of address space in use by this process; 0: unknown.
std::uint64_t addressSpace() {
  std::uint64_t pages = 0;
  if (std::FILE* f = std::fopen("/proc/self/statm", "r")) {
    unsigned long long n = 0;
    if (std::fscanf(f, "%llu", &n) == 1) pages = n;
    std::fclose(f);
  }
  return pages * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

// A function can only use memory for its variables. Its stack here is smaller than on the threads that will call it later.
constexpr rlim_t kStack = 1 << 20;
constexpr std::uint64_t kRoom = 16 << 20;  // bytes in addition to the program's

}  // namespace

std::string_view faultOf(float height) {
  if (std::bit_cast<std::uint32_t>(height) == kOutOfSteps) return "takes more than 10,000 steps of its loops; a loop there may never end";
  if (std::isnan(height)) return "is not a number";
  if (std::isinf(height)) return "is infinite";
  if (std::abs(height) > lattice::kMaxHeight * lattice::kMetresPerStep) return "is absurd: heights lie within 131,072 m of 0";
  return {};
}

std::string materialFault(std::size_t most) {
  return "is no number of 0 to " + std::to_string(most) +
         "; names of more stand in a line such as //! materials: mud, moor"
         "; or a loop there takes more than " +
         std::to_string(kMaxSteps) + " steps";
}

std::string placeText(lattice::Step x, lattice::Step z) {
  const auto metres = [](lattice::Step steps) { return text::rounded(static_cast<double>(steps) * lattice::kMetresPerStep, 10); };
  return "x " + metres(x) + " m, z " + metres(z) + " m";
}

std::optional<int> asProbe(int argc, char** argv) {
  if (argc != 5 || argv[1] != kFlag) return std::nullopt;
  const auto library = Library::open(argv[2]);
  const auto seed = text::number<std::uint32_t>(argv[3]);
  const auto mostMaterial = text::number<std::size_t>(argv[4]);
  if (!library || !seed || !mostMaterial) return 1;
  const std::uint64_t used = addressSpace(), most = used + kRoom;
  const rlimit stack{kStack, kStack}, space{most, most}, none{0, 0};
  setrlimit(RLIMIT_STACK, &stack);
  setrlimit(RLIMIT_FSIZE, &none);  // not before this: a sanitizer writes a file as the process begins
  if (used) setrlimit(RLIMIT_AS, &space);
  for (const int signal : {SIGSEGV, SIGFPE, SIGILL, SIGBUS, SIGABRT, SIGXCPU}) std::signal(signal, SIG_DFL);  // not a sanitizer's
  tryAll(**library, *mostMaterial, *seed);
  return 0;
}

Outcome<std::string> probe(std::string_view file, const std::filesystem::path& library, std::size_t mostMaterial, std::uint32_t seed,
                           const std::filesystem::path& program, const std::stop_token& stop, std::chrono::seconds time) {
  const auto error = [&](const std::string& what) { return Error{std::string(file) + ": " + what}; };
  const auto end = process::runChild(program, {std::string(kFlag), library.string(), std::to_string(seed), std::to_string(mostMaterial)},
                                     {.time = time, .memory = ~std::uint64_t{0}}, stop);
  if (stop.stop_requested()) return error("stopped while its heights were tried");
  if (!end) return error("its heights cannot be tried: " + end.error().message);
  std::string_view said = end->output;
  said = said.substr(0, said.rfind('\n'));
  said.remove_prefix(said.rfind('\n') + 1);
  std::istringstream words{std::string(said)};
  std::string what;
  lattice::Step x = 0, z = 0;
  std::uint32_t bits = 0;
  std::size_t line = 0;
  std::string name;
  words >> what >> x >> z >> bits >> line >> name;
  const std::string function = what == "colours" ? "terrainColor" : what == "materials" ? "terrainMaterial" : "terrainHeight";
  const std::string where = placeText(x, z);
  if (end->timedOut)
    return error((what == "colours" || what == "materials" ? what : "heights") + std::string(" take too long: not done after ") +
                 std::to_string(time.count()) + " s, the last at " + where);
  if (end->signal == SIGSEGV)
    return error(function + " crashes, most likely because its variables need more than the 1 MiB there is, near " + where);
  if (end->signal) return error(function + " crashes (" + strsignal(end->signal) + ") near " + where);
  if (what == "colour") return error(std::string(kTheColour) + where + " " + std::string(faultOf(std::bit_cast<float>(bits))));
  if (what == "material") return error("the material at " + where + " " + materialFault(mostMaterial));
  if (what == "fault") {
    const float height = std::bit_cast<float>(bits);
    const std::string number = std::isfinite(height) ? ", " + text::rounded(static_cast<double>(height), 6) + " m," : "";
    const std::string fault = "the height at " + where + number + " " + std::string(faultOf(height));
    return line ? Error{at(file, line) + "'" + name + "': " + fault + rewrite(name, height)} : error(fault);
  }
  if (what != "done") return error("the process that tried its heights ended early");
  std::string advice;
  if (bits != 0)
    advice = std::string(file) + ": " + std::string(kTheColour) + where + " has " +
             text::rounded(static_cast<double>(std::bit_cast<float>(bits)), 6) + ": red, green and blue are shares of the light, 0 to 1";
  return {boost::system::in_place_value, std::move(advice)};
}

}  // namespace ridgecast::glsl
