#pragma once
// Owners of OpenGL names, and programs from text. Everything needs the context that was current when it was made.

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "common/outcome/outcome.h"

namespace ridgecast::render {

// A name and the function that releases it; 0 owns nothing.
class GlObject {
 public:
  using Release = void (*)(std::uint32_t);
  GlObject() = default;
  GlObject(std::uint32_t name, Release release) : name_(name), release_(release) {}
  ~GlObject() {
    if (name_) release_(name_);
  }
  GlObject(GlObject&& other) noexcept : name_(std::exchange(other.name_, 0)), release_(other.release_) {}
  GlObject& operator=(GlObject other) noexcept {
    std::swap(name_, other.name_);
    std::swap(release_, other.release_);
    return *this;
  }
  std::uint32_t name() const { return name_; }

 private:
  std::uint32_t name_ = 0;
  Release release_ = nullptr;
};

GlObject makeBuffer();
GlObject makeVertexArray();
GlObject makeFramebuffer();
GlObject makeTexture();
// A texture of one level without filtering; `internalFormat` is OpenGL's: colours, depth, or integers (GL_RGBA32I).
GlObject makeTexture(std::uint32_t internalFormat, std::uint32_t width, std::uint32_t height);

// Directs drawing to all of a framebuffer (0: the window's), without scissor, depth test, blending or culling. It stays bound.
void drawInto(std::uint32_t framebuffer, std::uint32_t width, std::uint32_t height);

// A linked program. Setting a uniform that it does not have is not an error: the compiler drops unused ones.
class Program {
 public:
  // Fragment shaders come in pieces, joined after the version line, each with its own #line so that messages name the piece.
  struct Piece {
    std::string_view name;
    std::string_view text;
  };
  // Error: the first messages of compiler or linker, with the piece's name and line.
  static Outcome<Program> build(std::string_view what, std::string_view vertexSource, std::span<const Piece> fragmentPieces);
  static Outcome<Program> build(std::string_view what, std::string_view vertexSource, std::string_view fragment) {
    const Piece whole{what, fragment};
    return build(what, vertexSource, std::span(&whole, 1));
  }

  void use() const;
  // One triangle that covers the target, for programs with shaders::full_screen; the program must be in use.
  void drawFullScreen() const;
  void set(const char* name, int v) const;
  void set(const char* name, std::uint32_t v) const;
  void set(const char* name, float v) const;
  void set(const char* name, float x, float y) const;
  void set(const char* name, float x, float y, float z) const;
  void set(const char* name, int x, int y) const;
  // A sampler's texture, which is bound to this unit; unit 0 is active afterwards.
  void sample(const char* name, int unit, std::uint32_t texture) const;
  int location(const char* name) const;

 private:
  explicit Program(GlObject program) : program_(std::move(program)), vertexArray_(makeVertexArray()) {}
  GlObject program_;
  GlObject vertexArray_;  // empty: OpenGL draws nothing without one
};

}  // namespace ridgecast::render
