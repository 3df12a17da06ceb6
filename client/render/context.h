#pragma once
// An OpenGL context without a window system: EGL's device platform first (a graphics card), then the surfaceless platform (Mesa, with
// or without a card), then the default display. Needs no X server; on a machine without a card Mesa's llvmpipe draws.

#include <memory>
#include <string>

#include "common/outcome/outcome.h"

namespace ridgecast::render {

class HeadlessContext {
 public:
  // Makes the context current on the calling thread, the only thread that may use this room afterwards. Errors: no EGL library, no EGL
  // display, no OpenGL 3.3 core; each says what to install or try.
  static Outcome<std::unique_ptr<HeadlessContext>> create();
  ~HeadlessContext();
  HeadlessContext(const HeadlessContext&) = delete;
  HeadlessContext& operator=(const HeadlessContext&) = delete;

 private:
  HeadlessContext(void* display, void* context) : display_(display), context_(context) {}
  void* display_;
  void* context_;
};

// The current context's renderer and version, for results: "llvmpipe (LLVM 15.0.6, 256 bits), OpenGL 4.5". Needs a current context.
std::string contextDescription();

}  // namespace ridgecast::render
