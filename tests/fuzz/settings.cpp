// A settings file: options get values within their limits, or one sentence says what is wrong.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

#include "server/config/layers.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const std::string file = "/dev/shm/fuzz-settings-" + std::to_string(getpid()) + ".toml";
  std::ofstream(file, std::ios::binary).write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  CLI::App app;
  int port = 1;
  double rate = 1;
  bool quiet = false;
  std::vector<std::string> names;
  app.add_option("--port", port)->check(CLI::Range(0, 65'535));
  app.add_option("--rate", rate);
  app.add_flag("--quiet", quiet);
  app.add_option("--param", names);
  app.parse("");
  const char* const environment[] = {nullptr};
  const auto sources = ridgecast::config::addLayers(app, file, environment);
  if (sources ? port < 0 || port > 65'535 : sources.error().message.empty()) std::abort();
  if (sources) ridgecast::config::describe(app, *sources);
  return 0;
}
