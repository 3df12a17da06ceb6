// The terrain as a graphics driver compiles it. Heights through headless EGL must be, bit for bit, those of the C++ side on a driver
// that does not fuse multiplication and addition (Mesa's llvmpipe).

#include <epoxy/egl.h>
#include <epoxy/gl.h>
#include <gtest/gtest.h>

#include <unistd.h>
#include <bit>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "common/terrain/terrain.h"
#include "tests/unit/common/terrain/points.h"

namespace ridgecast::terrain {
namespace {

std::string text(std::string_view version, const Terrain& terrain, std::string_view main) {
  std::string s = "#version ";
  s.append(version).append("\n");
  if (version.ends_with("es")) s.append("precision highp float;\nprecision highp int;\n");
  s.append(prelude()).append(terrain.source()).append(shading()).append(main);
  return s;
}

TEST(Glsl, compilesInEveryDialect) {
  if (std::system("glslangValidator --version > /dev/null 2>&1") != 0)
    GTEST_SKIP() << "glslangValidator (package glslang-tools) is not installed";
  const std::filesystem::path folder = std::filesystem::temp_directory_path() / ("ridgecast-glsl-" + std::to_string(getpid()));
  std::filesystem::create_directories(folder);
  const std::filesystem::path file = folder / "terrain.frag", log = folder / "log";
  for (const Description& d : builtIn()) {
    for (const std::string_view version : {"330 core", "450", "300 es"}) {
      std::ofstream(file) << text(
          version, *create(d.name, 1).value(),
          "out vec4 colour;\n"
          "void main() {\n"
          "  vec3 c = shadeTerrain(ivec2(1, 2), gl_FragCoord.xy * 0.001, 3.0, 0.1, vec3(0.0, 0.0, 1.0), 1.0, 2.0, 3u);\n"
          "  colour = vec4(toDisplay(c + skyColor(vec3(0.0, 1.0, 0.0))), 1.0);\n"
          "}\n");
      const int status = std::system(("glslangValidator " + file.string() + " > " + log.string() + " 2>&1").c_str());
      std::ifstream in(log);
      EXPECT_EQ(status, 0) << d.name << " as " << version << ":\n" << std::string(std::istreambuf_iterator<char>(in), {});
    }
  }
  std::filesystem::remove_all(folder);
}

class Headless : public testing::Test {
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
    if (context_ == EGL_NO_CONTEXT || !eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, context_)) {
      GTEST_SKIP() << "EGL gives no OpenGL 3.3 core context without a surface";
    }
  }
  void TearDown() override {
    if (display_ == EGL_NO_DISPLAY) return;
    eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    if (context_ != EGL_NO_CONTEXT) eglDestroyContext(display_, context_);
  }

  static GLuint shader(GLenum kind, const std::string& source) {
    const GLuint name = glCreateShader(kind);
    const char* p = source.c_str();
    glShaderSource(name, 1, &p, nullptr);
    glCompileShader(name);
    GLint ok = 0;
    glGetShaderiv(name, GL_COMPILE_STATUS, &ok);
    char log[4096] = "";
    glGetShaderInfoLog(name, sizeof log, nullptr, log);
    EXPECT_TRUE(ok) << log;
    return name;
  }

  EGLDisplay display_ = EGL_NO_DISPLAY;
  EGLContext context_ = EGL_NO_CONTEXT;
};

class EveryTerrain : public Headless, public testing::WithParamInterface<std::string_view> {};
INSTANTIATE_TEST_SUITE_P(Glsl, EveryTerrain, testing::Values("alpine", "canyon", "archipelago"),
                         [](const auto& i) { return std::string(i.param); });

TEST_P(EveryTerrain, heightsAreTheBitsOfTheServer) {
  constexpr int kSide = 317;  // 100,489 points a distance
  const auto terrain = create(GetParam(), 0x1234567u).value();
  const GLuint program = glCreateProgram();
  glAttachShader(program,
                 shader(GL_VERTEX_SHADER,
                        "#version 330 core\n"
                        "void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }\n"));
  glAttachShader(program, shader(GL_FRAGMENT_SHADER, text("330 core", *terrain,
                                                          "uniform isampler2D points;\n"
                                                          "uniform uint seed;\n"
                                                          "out float height;\n"
                                                          "void main() {\n"
                                                          "  ivec4 p = texelFetch(points, ivec2(gl_FragCoord.xy), 0);\n"
                                                          "  height = terrainHeight(p.xy, vec2(p.zw) / 1048576.0, 0.0, seed);\n"
                                                          "}\n")));
  glLinkProgram(program);
  GLint ok = 0;
  glGetProgramiv(program, GL_LINK_STATUS, &ok);
  ASSERT_TRUE(ok);
  glUseProgram(program);
  glUniform1ui(glGetUniformLocation(program, "seed"), terrain->seed());

  GLuint textures[2], framebuffer, vertices;
  glGenTextures(2, textures);
  glBindTexture(GL_TEXTURE_2D, textures[0]);
  glTexImage2D(GL_TEXTURE_2D, 0, GL_R32F, kSide, kSide, 0, GL_RED, GL_FLOAT, nullptr);
  glGenFramebuffers(1, &framebuffer);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, textures[0], 0);
  ASSERT_EQ(glCheckFramebufferStatus(GL_FRAMEBUFFER), GLenum{GL_FRAMEBUFFER_COMPLETE});
  glGenVertexArrays(1, &vertices);
  glBindVertexArray(vertices);
  glViewport(0, 0, kSide, kSide);
  glBindTexture(GL_TEXTURE_2D, textures[1]);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);

  const std::string renderer = reinterpret_cast<const char*>(glGetString(GL_RENDERER));
  const bool exact = renderer.find("llvmpipe") != std::string::npos || renderer.find("softpipe") != std::string::npos;
  std::printf("renderer: %s\n", renderer.c_str());
  for (const double distance : kDistances) {
    const Points p = pointsAt(distance, kSide * kSide);
    std::vector<std::int32_t> texels;
    constexpr lattice::Step kMask = (lattice::Step{1} << lattice::kCellBits) - 1;
    for (std::size_t i = 0; i < p.x.size(); ++i) {
      texels.insert(texels.end(), {lattice::cellOf(p.x[i]), lattice::cellOf(p.z[i]), static_cast<std::int32_t>(p.x[i] & kMask),
                                   static_cast<std::int32_t>(p.z[i] & kMask)});
    }
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32I, kSide, kSide, 0, GL_RGBA_INTEGER, GL_INT, texels.data());
    glDrawArrays(GL_TRIANGLES, 0, 3);
    std::vector<float> drawn(p.x.size()), computed(p.x.size());
    glReadPixels(0, 0, kSide, kSide, GL_RED, GL_FLOAT, drawn.data());
    ASSERT_EQ(glGetError(), GLenum{GL_NO_ERROR});
    terrain->heights(p.x, p.z, computed);
    std::size_t different = 0;
    float worst = 0;
    for (std::size_t i = 0; i < drawn.size(); ++i) {
      different += std::bit_cast<std::uint32_t>(drawn[i]) != std::bit_cast<std::uint32_t>(computed[i]);
      worst = std::max(worst, std::abs(drawn[i] - computed[i]));
    }
    EXPECT_LT(worst, 0.05f) << distance;
    if (exact) {
      EXPECT_EQ(different, 0u) << "at " << distance << " m, worst " << worst << " m";
    }
  }
}

}  // namespace
}  // namespace ridgecast::terrain
