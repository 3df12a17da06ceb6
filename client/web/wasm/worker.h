#pragma once
// What the worker does for the core, as imports: src/core/core.ts.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "client/web/wasm/json.h"

#define IMPORT(name) extern "C" __attribute__((import_module("page"), import_name(#name)))

namespace ridgecast::page {

struct Array {
  enum Kind : std::uint32_t { kInt32, kUint32, kFloat32, kBytes } kind;
  const void* data;
  std::size_t count;
};
static_assert(sizeof(Array) == 12);

// At another place than start() named, SCHEME://HOST:PORT, or at that (empty); with its token, if there is one, or without. opened() or
// closed() follow.
IMPORT(dial) void pageDial(const char* elsewhere, std::size_t bytes, bool showsToken);
IMPORT(send) void pageSend(const char* frame, std::size_t bytes);  // over the line
IMPORT(hangUp) void pageHangUp(const char* why, std::size_t bytes);
IMPORT(tell) void pageTell(const char* json, std::size_t bytes);  // FromEngine of src/messages.ts
// ToPainterFromEngine, with these arrays beside it. Where it is a change, taken() follows.
IMPORT(paint) void pagePaint(const char* json, std::size_t bytes, const Array* arrays, std::size_t count);

inline void tell(const Object& message) {
  const std::string text = json(message);
  pageTell(text.data(), text.size());
}
inline void paint(const Object& message, const std::vector<Array>& arrays = {}) {
  const std::string text = json(message);
  pagePaint(text.data(), text.size(), arrays.data(), arrays.size());
}
inline Object kind(const char* name) { return Object()("kind", name); }

}  // namespace ridgecast::page
