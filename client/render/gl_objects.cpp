#include "client/render/gl_objects.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <string>
#include <vector>

namespace ridgecast::render {
namespace {

// Mesa writes "1:23(4): error: ...", NVIDIA "1(23) : error ...": the first number is the piece.
std::string firstComplaints(std::string log, std::span<const Program::Piece> pieces) {
  while (!log.empty() && (log.back() == '\n' || log.back() == '\0')) log.pop_back();
  if (log.size() > 800) log.resize(800);
  std::string legend;
  for (std::size_t k = 0; k < pieces.size(); ++k) legend += (k ? ", " : "") + std::to_string(k + 1) + " = " + std::string(pieces[k].name);
  return log + (legend.empty() ? "" : " (source " + legend + ")");
}

Outcome<GlObject> compile(GLenum kind, const std::string& text, std::string_view what, std::span<const Program::Piece> pieces) {
  GlObject shader(glCreateShader(kind), [](std::uint32_t n) { glDeleteShader(n); });
  const char* source = text.c_str();
  glShaderSource(shader.name(), 1, &source, nullptr);
  glCompileShader(shader.name());
  GLint ok = GL_FALSE;
  glGetShaderiv(shader.name(), GL_COMPILE_STATUS, &ok);
  if (ok) return shader;
  GLint length = 0;
  glGetShaderiv(shader.name(), GL_INFO_LOG_LENGTH, &length);
  std::string log(static_cast<std::size_t>(std::max(length, 1)), '\0');
  glGetShaderInfoLog(shader.name(), length, nullptr, log.data());
  return Error{"the graphics driver cannot compile the " + std::string(what) + " shader: " + firstComplaints(log, pieces)};
}

template <auto& kGenerate, auto& kDelete>
GlObject make() {
  std::uint32_t name = 0;
  kGenerate(1, &name);
  return {name, [](std::uint32_t n) { kDelete(1, &n); }};
}

}  // namespace

void drawInto(std::uint32_t framebuffer, std::uint32_t width, std::uint32_t height) {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  glViewport(0, 0, static_cast<GLsizei>(width), static_cast<GLsizei>(height));
  glDisable(GL_SCISSOR_TEST);
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  glDisable(GL_CULL_FACE);
}

GlObject makeBuffer() { return make<glGenBuffers, glDeleteBuffers>(); }
GlObject makeVertexArray() { return make<glGenVertexArrays, glDeleteVertexArrays>(); }
GlObject makeFramebuffer() { return make<glGenFramebuffers, glDeleteFramebuffers>(); }
GlObject makeTexture() { return make<glGenTextures, glDeleteTextures>(); }

GlObject makeTexture(std::uint32_t internalFormat, std::uint32_t width, std::uint32_t height) {
  GlObject texture = makeTexture();
  const bool depth = internalFormat == GL_DEPTH_COMPONENT32F, integers = internalFormat == GL_RGBA32I;
  glBindTexture(GL_TEXTURE_2D, texture.name());
  glTexImage2D(GL_TEXTURE_2D, 0, static_cast<GLint>(internalFormat), static_cast<GLsizei>(width), static_cast<GLsizei>(height), 0,
               depth      ? GL_DEPTH_COMPONENT
               : integers ? GL_RGBA_INTEGER
                          : GL_RGBA,
               integers                                ? GL_INT
               : depth || internalFormat == GL_RGBA32F ? GL_FLOAT
                                                       : GL_UNSIGNED_BYTE,
               nullptr);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, 0);
  glBindTexture(GL_TEXTURE_2D, 0);
  return texture;
}

Outcome<Program> Program::build(std::string_view what, std::string_view vertexSource, std::span<const Piece> fragmentPieces) {
  const std::string version = "#version 330 core\n";
  std::string fragment = version;
  for (std::size_t k = 0; k < fragmentPieces.size(); ++k)
    fragment += "#line 1 " + std::to_string(k + 1) + "\n" + std::string(fragmentPieces[k].text) + "\n";
  auto vertexShader = compile(GL_VERTEX_SHADER, version + std::string(vertexSource), what, {});
  if (!vertexShader) return vertexShader.error();
  auto fragmentShader = compile(GL_FRAGMENT_SHADER, fragment, what, fragmentPieces);
  if (!fragmentShader) return fragmentShader.error();

  GlObject program(glCreateProgram(), [](std::uint32_t n) { glDeleteProgram(n); });
  glAttachShader(program.name(), vertexShader->name());
  glAttachShader(program.name(), fragmentShader->name());
  glLinkProgram(program.name());
  GLint ok = GL_FALSE;
  glGetProgramiv(program.name(), GL_LINK_STATUS, &ok);
  if (!ok) {
    std::string log(800, '\0');
    GLsizei length = 0;
    glGetProgramInfoLog(program.name(), static_cast<GLsizei>(log.size()), &length, log.data());
    log.resize(static_cast<std::size_t>(std::max(length, 0)));
    return Error{"the graphics driver cannot link the " + std::string(what) + " program: " + firstComplaints(log, {})};
  }
  return Program(std::move(program));
}

void Program::sample(const char* name, int unit, std::uint32_t texture) const {
  glActiveTexture(GL_TEXTURE0 + static_cast<GLenum>(unit));
  glBindTexture(GL_TEXTURE_2D, texture);
  glActiveTexture(GL_TEXTURE0);
  set(name, unit);
}
int Program::location(const char* name) const { return glGetUniformLocation(program_.name(), name); }
void Program::use() const { glUseProgram(program_.name()); }
void Program::drawFullScreen() const {
  glBindVertexArray(vertexArray_.name());
  glDrawArrays(GL_TRIANGLES, 0, 3);
  glBindVertexArray(0);
}
void Program::set(const char* name, int v) const { glUniform1i(location(name), v); }
void Program::set(const char* name, std::uint32_t v) const { glUniform1ui(location(name), v); }
void Program::set(const char* name, float v) const { glUniform1f(location(name), v); }
void Program::set(const char* name, float x, float y) const { glUniform2f(location(name), x, y); }
void Program::set(const char* name, float x, float y, float z) const { glUniform3f(location(name), x, y, z); }
void Program::set(const char* name, int x, int y) const { glUniform2i(location(name), x, y); }

}  // namespace ridgecast::render
