#include "server/terrain/probe.h"

#include <poll.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <bit>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <thread>

#include "common/text/text.h"
#include "server/terrain/translate.h"

namespace ridgecast::user_terrain {
namespace {

constexpr std::array<double, 10> kPlaces = {0, 5e3, 1e6, -1e6, 3e7, 1e8, -1e9, 1e12, -1e12, 4.39e12};  // metres, x; z is its mirror
constexpr std::size_t kBatch = 256, kBatches = 16;                                                     // points a place: 4,096

// The child's report, in shared memory.
struct Report {
  lattice::Step x, z;  // the current place, finally that of the fault
  float height;
  bool colours, faulty, done;  // colours: those were tried last, not heights
};

struct Program {
  terrain::HeightsFunction heights;
  terrain::ColoursFunction colours;  // may be null
};

void tryAll(const Program& program, std::uint32_t seed, volatile Report& report) {
  std::array<lattice::Step, kBatch> x, z;
  std::array<float, kBatch> out;
  std::array<float, 3 * kBatch> normals{}, colours;
  for (std::size_t i = 0; i < kBatch; ++i) normals[3 * i + 1] = 1;
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
      report.x = x[0];
      report.z = z[0];
      report.colours = false;
      program.heights(x.data(), z.data(), out.data(), kBatch, seed);
      for (std::size_t i = 0; i < kBatch; ++i) {
        if (faultOf(out[i]).empty()) continue;
        report.x = x[i];
        report.z = z[i];
        report.height = out[i];
        report.faulty = true;
        return;
      }
      if (!program.colours) continue;
      report.colours = true;
      program.colours(x.data(), z.data(), out.data(), normals.data(), 0, colours.data(), kBatch, seed);
    }
  }
  report.done = true;
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
constexpr std::uint64_t kRoom = 16 << 20;  // bytes in addition to the server's

[[noreturn]] void child(const Program& program, std::uint32_t seed, volatile Report& report, long seconds, std::uint64_t memory) {
  close_range(3, ~0u, 0);  // the server's sockets, see child.cpp
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const rlimit stack{kStack, kStack}, space{memory, memory};
  setrlimit(RLIMIT_STACK, &stack);
  if (memory) setrlimit(RLIMIT_AS, &space);
  const rlimit cpu{static_cast<rlim_t>(seconds), static_cast<rlim_t>(seconds)}, none{0, 0};
  setrlimit(RLIMIT_CPU, &cpu);
  setrlimit(RLIMIT_CORE, &none);
  setrlimit(RLIMIT_FSIZE, &none);
  for (const int signal : {SIGSEGV, SIGFPE, SIGILL, SIGBUS, SIGABRT, SIGXCPU}) std::signal(signal, SIG_DFL);
  tryAll(program, seed, report);
  _exit(0);
}

}  // namespace

std::string_view faultOf(float height) {
  if (std::bit_cast<std::uint32_t>(height) == kOutOfSteps) return "takes more than 10,000 steps of its loops; a loop there may never end";
  if (std::isnan(height)) return "is not a number";
  if (std::isinf(height)) return "is infinite";
  if (std::abs(height) > lattice::kMaxHeight * lattice::kMetresPerStep) return "is absurd: heights lie within 131,072 m of 0";
  return {};
}

std::string placeText(lattice::Step x, lattice::Step z) {
  const auto metres = [](lattice::Step steps) { return text::rounded(static_cast<double>(steps) * lattice::kMetresPerStep, 10); };
  return "x " + metres(x) + " m, z " + metres(z) + " m";
}

Outcome<void> probe(std::string_view file, terrain::HeightsFunction heights, terrain::ColoursFunction colours, std::uint32_t seed,
                    const std::stop_token& stop, std::chrono::milliseconds time) {
  void* shared = mmap(nullptr, sizeof(Report), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (shared == MAP_FAILED) return Error{"no memory to try the terrain with"};
  struct Unmap {
    void* memory;
    ~Unmap() { munmap(memory, sizeof(Report)); }
  } unmap{shared};
  auto& report = *new (shared) Report{};
  const std::uint64_t used = addressSpace();
  const pid_t pid = fork();
  if (pid < 0) return Error{std::string("no process to try the terrain in: ") + std::strerror(errno)};
  if (pid == 0) child({heights, colours}, seed, report, static_cast<long>(time.count() / 1000 + 1), used ? used + kRoom : 0);
  const auto until = std::chrono::steady_clock::now() + time;
  int status = 0;
  bool timedOut = false;
  while (waitpid(pid, &status, WNOHANG) == 0) {
    if (!timedOut && (stop.stop_requested() || std::chrono::steady_clock::now() >= until)) {
      timedOut = true;
      kill(pid, SIGKILL);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  if (stop.stop_requested()) return Error{std::string(file) + ": stopped while its heights were tried"};
  const std::string function = report.colours ? "terrainColor" : "terrainHeight";
  const std::string where = placeText(report.x, report.z);
  if (timedOut || (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU))
    return Error{std::string(file) + ": " + (report.colours ? "colours" : "heights") + " take too long: not done after " +
                 std::to_string(time.count() / 1000) + " s, the last at " + where};
  if (WIFSIGNALED(status) && WTERMSIG(status) == SIGSEGV)
    return Error{std::string(file) + ": " + function +
                 " crashes, most likely because its variables need more than the 1 MiB there is, near " + where};
  if (WIFSIGNALED(status))
    return Error{std::string(file) + ": " + function + " crashes (" + strsignal(WTERMSIG(status)) + ") near " + where};
  if (report.faulty) {
    const std::string height = std::isfinite(report.height) ? ", " + text::rounded(static_cast<double>(report.height), 6) + " m," : "";
    return Error{std::string(file) + ": the height at " + where + height + " " + std::string(faultOf(report.height))};
  }
  if (!report.done) return Error{std::string(file) + ": the process that tried its heights ended early"};
  return {};
}

}  // namespace ridgecast::user_terrain
