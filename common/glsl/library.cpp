#include "common/glsl/library.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "common/glsl/embedded.h"
#include "common/outcome/contract.h"
#include "common/process/child.h"
#include "common/process/scratch.h"
#include "common/terrain/terrain.h"
#include "common/text/text.h"

namespace ridgecast::glsl {
namespace {

constexpr const char *kEntry = "ridgecast_heights", *kColours = "ridgecast_colours", *kMaterials = "ridgecast_materials",
                     *kTrace = "ridgecast_trace";

// The flags of the built-in terrains (common/terrain/CMakeLists.txt); never with fused multiply-add. What is too large for the stack hits
// its guard (-fstack-clash-protection) and never jumps over it.
const std::vector<std::string> kCommonFlags = {"-std=c++20",
                                               "-O3",
                                               "-fopenmp-simd",
                                               "-ffp-contract=off",
                                               "-fno-math-errno",
                                               "-fno-trapping-math",
                                               "-fwrapv",
                                               "-fPIC",
                                               "-fvisibility=hidden",
                                               "-shared",
                                               "-nostdlib",
                                               "-w",
                                               "-fmax-errors=1",
                                               "-fno-diagnostics-show-caret",
                                               "-fno-exceptions",
                                               "-fno-stack-protector",
                                               "-fstack-clash-protection"};

std::vector<std::string> variantFlags(std::string_view variant) {
  if (variant == "avx2") return {"-mavx2"};
  if (variant == "avx512") return {"-mavx512f", "-mavx512dq", "-mavx512vl", "-mprefer-vector-width=512"};
  expects(variant == "baseline", "an instruction set is baseline, avx2 or avx512");
  return {};
}

std::string programText(const Translation& t) {
  std::string out = "namespace {\n";
  out.append(terrain::glslAsCpp())
      .append("\n")
      .append(embedded::glsl_extras)
      .append(embedded::glsl_matrices)
      .append("\n")
      .append(terrain::prelude())
      .append("\n");
  if (t.bounded) {
    out.append("thread_local int stepsLeft__;\nconstexpr int kMaxSteps = ").append(std::to_string(kMaxSteps));
    out.append(";\nconstexpr uint kOutOfSteps = ")
        .append(std::to_string(kOutOfSteps))
        .append("u;\n#define RIDGECAST_STEPS_LEFT stepsLeft__\n");
  }
  if (t.colours) out.append("#define RIDGECAST_COLOURS\n");
  if (t.materials) out.append("#define RIDGECAST_MATERIALS\n");
  if (t.traced) out.append(embedded::glsl_trace).append("\n");
  out.append("namespace person__ {\n")
      .append(t.text)
      .append("}\n#line 1 \"batch.h\"\nnamespace program__ {\nusing person__::terrainHeight;\n");
  if (t.colours) out.append("using person__::terrainColor;\n");
  if (t.materials) out.append("using person__::terrainMaterial;\n");
  out.append(terrain::batch()).append("\n}\n}\nextern \"C\" __attribute__((visibility(\"default\"))) void ").append(kEntry);
  out.append(
      "(const __INT64_TYPE__* x, const __INT64_TYPE__* z, float* out, __SIZE_TYPE__ count, uint seed) {\n"
      "  program__::heights(x, z, out, count, seed);\n}\n");
  if (t.colours)
    out.append("extern \"C\" __attribute__((visibility(\"default\"))) void ")
        .append(kColours)
        .append(
            "(const __INT64_TYPE__* x, const __INT64_TYPE__* z, const float* height, const float* normal, float footprint, float* out, "
            "__SIZE_TYPE__ count, uint seed) {\n  program__::colours(x, z, height, normal, footprint, out, count, seed);\n}\n");
  if (t.materials)
    out.append("extern \"C\" __attribute__((visibility(\"default\"))) void ")
        .append(kMaterials)
        .append(
            "(const __INT64_TYPE__* x, const __INT64_TYPE__* z, const float* height, const float* normal, unsigned char* out, "
            "__SIZE_TYPE__ count, uint seed) {\n  program__::materials(x, z, height, normal, out, count, seed);\n}\n");
  if (t.traced)
    out.append("extern \"C\" __attribute__((visibility(\"default\"))) Traced__ ")
        .append(kTrace)
        .append("(bool infinite) {\n  const Traced__ first = traced__[infinite];\n  traced__[0] = traced__[1] = {};\n  return first;\n}\n");
  return out;
}

std::uint64_t hashed(std::uint64_t hash, std::string_view text) {
  for (const char c : text) hash = lattice::mix(hash ^ static_cast<unsigned char>(c));
  return lattice::mix(hash ^ text.size());
}

bool isPrivate(const struct stat& s) { return s.st_uid == geteuid() && (s.st_mode & (S_IWGRP | S_IWOTH)) == 0; }

// "terrain.glsl:12:7: error: ..." -> "file:12: ..."; an error inside the program's own text is reported where the file called it. The
// compiler's words are not for people, but for a sentence of ours.
Error complaint(std::string_view file, std::string_view output) {
  constexpr std::string_view kOurs = "static assertion failed: ";
  const auto after = [&](std::string_view words) {
    const std::size_t place = output.find(words);
    return place == output.npos ? std::string_view() : output.substr(place + words.size(), output.find('\n', place) - place - words.size());
  };
  if (output.find("error: ") == output.npos) return Error{std::string(file) + ": the C++ compiler failed without saying why"};
  std::size_t number = 0;
  const std::string mark = std::string(kPersonsFile) + ":";
  for (std::size_t place = output.find(mark); place != output.npos && number == 0; place = output.find(mark, place + 1))
    std::from_chars(output.data() + place + mark.size(), output.data() + output.size(), number);
  std::string why = ": write it in simpler GLSL";
  if (const auto ours = after(kOurs); !ours.empty()) why = ": " + std::string(ours);
  return Error{std::string(file) + ":" + (number ? std::to_string(number) + ":" : "") + " this GLSL has no counterpart for heights" + why};
}

}  // namespace

Outcome<std::shared_ptr<const Library>> Library::open(const std::filesystem::path& file) {
  void* handle = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!handle) return Error{"cannot load " + file.string() + ": " + dlerror()};
  auto library = std::shared_ptr<Library>(new Library(handle));
  library->heights_ = reinterpret_cast<terrain::HeightsFunction>(dlsym(handle, kEntry));
  library->colours_ = reinterpret_cast<terrain::ColoursFunction>(dlsym(handle, kColours));
  library->materials_ = reinterpret_cast<terrain::MaterialsFunction>(dlsym(handle, kMaterials));
  library->trace_ = reinterpret_cast<TraceFunction>(dlsym(handle, kTrace));
  if (!library->heights_) return Error{file.string() + " is not a compiled terrain; remove it"};
  return std::shared_ptr<const Library>(std::move(library));
}

Library::~Library() { dlclose(handle_); }

Outcome<Cache> Cache::open(std::filesystem::path folder) {
  if (folder.empty()) {
    const char* xdg = std::getenv("XDG_CACHE_HOME");
    const char* home = std::getenv("HOME");
    if (xdg && *xdg)
      folder = std::filesystem::path(xdg) / "ridgecast" / "terrains";
    else if (home && *home)
      folder = std::filesystem::path(home) / ".cache" / "ridgecast" / "terrains";
    else
      return Error{"there is no folder for compiled terrains: set HOME, or give --terrain-cache DIR"};
  }
  std::error_code failed;
  if (folder.has_parent_path()) std::filesystem::create_directories(folder.parent_path(), failed);
  mkdir(folder.c_str(), 0700);
  struct stat s;
  if (stat(folder.c_str(), &s) != 0 || !S_ISDIR(s.st_mode) || access(folder.c_str(), W_OK) != 0)
    return Error{"cannot store compiled terrains in " + folder.string() + "; give another folder with --terrain-cache DIR"};
  if (!isPrivate(s))
    return Error{"others can write to " + folder.string() +
                 ", so compiled terrains from it cannot be trusted; give another folder with --terrain-cache DIR"};
  return Cache(std::move(folder));
}

std::filesystem::path Cache::fileFor(std::string_view text, std::string_view variant, bool colours) const {
  std::uint64_t first = 1, second = 2;  // 128 bits in all
  std::string all(text);
  for (const std::string_view part :
       {terrain::glslAsCpp(), std::string_view(embedded::glsl_extras), std::string_view(embedded::glsl_matrices), terrain::prelude(),
        terrain::batch(), variant, std::string_view(embedded::syntax), std::string_view(embedded::translate)})
    all.append(1, '\0').append(part);
  for (const std::string& flag : kCommonFlags) all.append(1, '\0').append(flag);
  all += std::to_string(kMaxSteps) + (colours ? "c" : "");
  return folder_ / (text::hexadecimal(hashed(first, all)) + text::hexadecimal(hashed(second, all)) + "-" + std::string(variant) + ".so");
}

bool Cache::has(const std::filesystem::path& file) const {
  struct stat s;
  if (lstat(file.c_str(), &s) != 0 || !S_ISREG(s.st_mode) || !isPrivate(s)) return false;
  utimensat(AT_FDCWD, file.c_str(), nullptr, AT_SYMLINK_NOFOLLOW);
  return true;
}

void Cache::trim() const {
  std::vector<std::pair<std::filesystem::file_time_type, std::filesystem::path>> kept;
  std::error_code failed;
  for (const auto& entry : std::filesystem::directory_iterator(folder_, failed)) {
    const std::string name = entry.path().filename().string();  // as fileFor() names them; other files are not ours
    if (name.find_first_not_of("0123456789abcdef") != 32 || name[32] != '-' || name.find(".so") == std::string::npos) continue;
    const auto used = entry.last_write_time(failed);
    if (!failed) kept.emplace_back(used, entry.path());
  }
  if (kept.size() <= kMaxKept) return;
  std::ranges::sort(kept);
  for (std::size_t k = 0; k < kept.size() - kMaxKept; ++k) std::filesystem::remove(kept[k].second, failed);
}

Outcome<void> compile(std::string_view file, const Translation& translation, std::string_view variant, const std::filesystem::path& target,
                      const std::stop_token& stop) {
  auto program = process::findProgram("g++");
  if (!program) program = process::findProgram("c++");
  if (!program) return Error{"a terrain file is compiled by g++, which is not installed; on Debian: apt-get install g++ glslang-tools"};
  auto scratch = process::Scratch::create();
  if (!scratch) return scratch.error();
  const std::filesystem::path source = scratch->path() / "terrain.cpp";
  // Written in the same folder, so that moving it into place cannot fail half way.
  const std::filesystem::path made = target.string() + "." + std::to_string(getpid()) + ".new";
  std::ofstream(source, std::ios::binary) << programText(translation);
  std::vector<std::string> arguments = kCommonFlags;
  for (std::string& flag : variantFlags(variant)) arguments.push_back(std::move(flag));
  arguments.insert(arguments.end(), {"-o", made.string(), source.string()});
  auto end = process::runChild(*program, arguments, {.time = std::chrono::seconds(60)}, stop);
  std::error_code failed;
  if (!end || end->timedOut || end->status != 0) {
    std::filesystem::remove(made, failed);
    if (!end) return end.error();
    if (end->timedOut || end->output.find(sigdescr_np(SIGXCPU)) != std::string::npos)  // of the compiler that the driver started
      return Error{std::string(file) + ": compiling it took more than 60 s of a processor; it calls too much: write it shorter"};
    if (end->output.find("out of memory") != std::string::npos || end->output.find("virtual memory exhausted") != std::string::npos ||
        end->status < 0)
      return Error{std::string(file) + ": compiling it needs too much memory; it calls too much: write it shorter"};
    return complaint(file, end->output);
  }
  chmod(made.c_str(), 0600);
  std::filesystem::rename(made, target, failed);
  if (failed) return Error{"cannot write " + target.string() + ": " + failed.message()};
  return {};
}

}  // namespace ridgecast::glsl
