// The client's core (client/core) as functions of a WebAssembly module, for the page's worker: one client a module. src/core/core.ts calls
// them. Texts and frames that go in lie in room(); what comes out is good until the call returns.

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "client/web/wasm/client.h"

// Nothing is caught here: what would throw ends the module.
extern "C" void* __cxa_allocate_exception(std::size_t) { __builtin_trap(); }
extern "C" void __cxa_throw(void*, void*, void (*)(void*)) { __builtin_trap(); }
// The one thread does not end.
extern "C" int __cxa_thread_atexit(void (*)(void*), void*, void*) { return 0; }

#define EXPORT(name) extern "C" __attribute__((export_name(#name)))

namespace ridgecast::page {
namespace {

Client client;
std::vector<char> given;

// The first so many bytes of what was given, after those that were taken before.
struct Given {
  std::size_t at = 0;
  std::string text(std::size_t bytes) {
    at += bytes;
    return std::string(given.data() + at - bytes, bytes);
  }
};

}  // namespace

EXPORT(room) char* room(std::size_t bytes) {
  given.resize(bytes);
  return given.data();
}
EXPORT(start) void start(std::size_t host, std::size_t name, double threshold, std::uint32_t random) {
  Given texts;
  const std::string at = texts.text(host);
  client.start(at, texts.text(name), threshold, random);
}
EXPORT(stop) void stop() { client.stop(); }
EXPORT(step) double step(double now) { return client.step(now); }
EXPORT(opened) void opened() { client.opened(); }
EXPORT(isGreeted) bool isGreeted() { return client.isGreeted(); }
EXPORT(comesBack) bool comesBack() { return client.comesBack(); }
EXPORT(closed) void closed(std::size_t why, double now) { client.closed(Given().text(why), now); }
EXPORT(hurry) void hurry(double now) { client.hurry(now); }
EXPORT(heard) void heard(std::size_t bytes, double now) { client.heard({reinterpret_cast<const std::uint8_t*>(given.data()), bytes}, now); }
EXPORT(pose)
void pose(double x, double z, double y, double yaw, double pitch, double fov, std::uint32_t width, std::uint32_t height,
          std::uint32_t number, double now) {
  client.pose({{.x = stepsOf(x), .z = stepsOf(z), .y = y, .yaw = yaw, .pitch = pitch}, {fov, width, height}}, number, now);
}
EXPORT(candidates) void candidates(bool wanted) { client.wantCandidates(wanted); }
EXPORT(threshold) void threshold(double pixels) { client.setThreshold(pixels); }
EXPORT(edit) void edit(std::uint32_t id, std::size_t operation) { client.edit(id, Given().text(operation)); }
EXPORT(setClock) void setClock(double rate, double microseconds, double now) { client.setClock(rate, microseconds, now); }
EXPORT(drive) void drive(Client::Drive drive, double microseconds, double now) { client.drive(drive, microseconds, now); }
EXPORT(act) void act(Client::Act act, double by) { client.act(act, by); }
EXPORT(brush) void brush(double x, double z, double y, double dx, double dy, double dz, bool uses) {
  client.brush({stepsOf(x), stepsOf(z), y, dx, dy, dz, 1e6}, uses);
}
// Given: x and z of places, as doubles. So many doubles.
EXPORT(heights) const double* heights(std::size_t places) {
  static std::vector<double> metres;
  const auto* const at = reinterpret_cast<const double*>(given.data());
  metres.clear();
  for (std::size_t k = 0; k < places; ++k) metres.push_back(client.height({stepsOf(at[2 * k]), stepsOf(at[2 * k + 1])}));
  return metres.data();
}
EXPORT(taken) void taken() { client.taken(); }

}  // namespace ridgecast::page
