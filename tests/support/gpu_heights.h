#pragma once
// A terrain's heights as a graphics driver computes them from its GLSL, through headless EGL. Tests that need it skip where there is none.

#include <epoxy/egl.h>
#include <epoxy/gl.h>
#include <gtest/gtest.h>

#include <cmath>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/terrain/terrain.h"

namespace ridgecast::testing_support {

class HeadlessGl : public testing::Test {
 protected:
  void SetUp() override {
    if (!epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_EXT_platform_base")) GTEST_SKIP() << "no EGL with platform displays on this machine";
    display_ = eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
    if (display_ == EGL_NO_DISPLAY || !eglInitialize(display_, nullptr, nullptr)) GTEST_SKIP() << "EGL has no surfaceless display here";
    eglBindAPI(EGL_OPENGL_API);
    const EGLint attributes[] = {
        EGL_CONTEXT_MAJOR_VERSION,           3,       EGL_CONTEXT_MINOR_VERSION, 3, EGL_CONTEXT_OPENGL_PROFILE_MASK,
        EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT, EGL_NONE};
    context_ = eglCreateContext(display_, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, attributes);
    if (context_ == EGL_NO_CONTEXT || !eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, context_))
      GTEST_SKIP() << "EGL gives no OpenGL 3.3 core context without a surface";
  }
  void TearDown() override {
    if (display_ == EGL_NO_DISPLAY) return;
    eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    if (context_ != EGL_NO_CONTEXT) eglDestroyContext(display_, context_);
  }
  static std::string renderer() { return reinterpret_cast<const char*>(glGetString(GL_RENDERER)); }
  // Whether the driver fuses no multiplication with an addition, so that it rounds as the C++ side does.
  static bool isExact() { return renderer().starts_with("llvmpipe") || renderer().starts_with("softpipe"); }

 private:
  EGLDisplay display_ = EGL_NO_DISPLAY;
  EGLContext context_ = EGL_NO_CONTEXT;
};

// Of one terrain, in the context that is current.
class GpuHeights {
 public:
  explicit GpuHeights(const terrain::Terrain& terrain) : program_(glCreateProgram()) {
    attach(GL_VERTEX_SHADER,
           "#version 330 core\n"
           "void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }\n");
    attach(GL_FRAGMENT_SHADER, std::string("#version 330 core\n") + std::string(terrain::prelude()) + std::string(terrain.source()) +
                                   "\nuniform isampler2D points;\n"
                                   "uniform uint seed;\n"
                                   "out float height;\n"
                                   "void main() {\n"
                                   "  ivec4 p = texelFetch(points, ivec2(gl_FragCoord.xy), 0);\n"
                                   "  height = terrainHeight(p.xy, vec2(p.zw) / 1048576.0, 0.0, seed);\n"
                                   "}\n");
    glLinkProgram(program_);
    GLint ok = 0;
    glGetProgramiv(program_, GL_LINK_STATUS, &ok);
    EXPECT_TRUE(ok);
    seed(terrain.seed());
    glGenTextures(2, textures_);
    glGenFramebuffers(1, &framebuffer_);
    glGenVertexArrays(1, &vertices_);
  }
  GpuHeights(const GpuHeights&) = delete;
  GpuHeights& operator=(const GpuHeights&) = delete;
  ~GpuHeights() {
    glDeleteProgram(program_);
    glDeleteTextures(2, textures_);
    glDeleteFramebuffers(1, &framebuffer_);
    glDeleteVertexArrays(1, &vertices_);
  }
  void seed(std::uint32_t seed) const {
    glUseProgram(program_);
    glUniform1ui(glGetUniformLocation(program_, "seed"), seed);
  }
  std::vector<float> at(std::span<const lattice::Step> x, std::span<const lattice::Step> z) const {
    constexpr lattice::Step kMask = (lattice::Step{1} << lattice::kCellBits) - 1;
    const auto side = static_cast<GLsizei>(std::ceil(std::sqrt(static_cast<double>(x.size()))));
    std::vector<std::int32_t> texels;
    for (std::size_t i = 0; i < x.size(); ++i)
      texels.insert(texels.end(), {lattice::cellOf(x[i]), lattice::cellOf(z[i]), static_cast<std::int32_t>(x[i] & kMask),
                                   static_cast<std::int32_t>(z[i] & kMask)});
    texels.resize(4 * static_cast<std::size_t>(side) * static_cast<std::size_t>(side));
    glUseProgram(program_);
    glBindTexture(GL_TEXTURE_2D, textures_[0]);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_R32F, side, side, 0, GL_RED, GL_FLOAT, nullptr);
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, textures_[0], 0);
    EXPECT_EQ(glCheckFramebufferStatus(GL_FRAMEBUFFER), GLenum{GL_FRAMEBUFFER_COMPLETE});
    glBindVertexArray(vertices_);
    glViewport(0, 0, side, side);
    glBindTexture(GL_TEXTURE_2D, textures_[1]);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32I, side, side, 0, GL_RGBA_INTEGER, GL_INT, texels.data());
    glDrawArrays(GL_TRIANGLES, 0, 3);
    std::vector<float> drawn(static_cast<std::size_t>(side) * static_cast<std::size_t>(side));
    glReadPixels(0, 0, side, side, GL_RED, GL_FLOAT, drawn.data());
    EXPECT_EQ(glGetError(), GLenum{GL_NO_ERROR});
    drawn.resize(x.size());
    return drawn;
  }

 private:
  void attach(GLenum kind, const std::string& source) const {
    const GLuint name = glCreateShader(kind);
    const char* p = source.c_str();
    glShaderSource(name, 1, &p, nullptr);
    glCompileShader(name);
    GLint ok = 0;
    glGetShaderiv(name, GL_COMPILE_STATUS, &ok);
    char log[4096] = "";
    glGetShaderInfoLog(name, sizeof log, nullptr, log);
    EXPECT_TRUE(ok) << log;
    glAttachShader(program_, name);
    glDeleteShader(name);
  }

  GLuint program_ = 0, textures_[2] = {}, framebuffer_ = 0, vertices_ = 0;
};

}  // namespace ridgecast::testing_support
