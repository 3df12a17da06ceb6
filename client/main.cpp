// ridgecast-client: looks at and measures the terrain that a server streams.

#include <CLI/CLI.hpp>

int main(int argc, char** argv) {
  CLI::App app{"Flies over terrain that a Ridgecast server streams."};
  app.set_version_flag("--version", RIDGECAST_VERSION);
  CLI11_PARSE(app, argc, argv);
}
