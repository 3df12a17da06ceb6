#include "client/render/surface.h"

#include <epoxy/gl.h>

#include <string>

namespace ridgecast::render {
namespace {

Outcome<void> checkSize(std::uint32_t width, std::uint32_t height) {
  GLint limit = 0;
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &limit);
  const auto most = static_cast<std::uint32_t>(limit);
  if (width < 1 || height < 1 || width > most || height > most)
    return Error{"this graphics driver draws pictures of 1 to " + std::to_string(limit) + " samples a side, not " + std::to_string(width) +
                 "x" + std::to_string(height) + ": choose a smaller --size or --supersample"};
  return {};
}

Outcome<void> checkComplete(std::uint32_t width, std::uint32_t height) {
  const GLenum status = glCheckFramebufferStatus(GL_FRAMEBUFFER);
  glBindFramebuffer(GL_FRAMEBUFFER, 0);
  if (status != GL_FRAMEBUFFER_COMPLETE || glGetError() == GL_OUT_OF_MEMORY)
    return Error{"the graphics driver cannot hold a picture of " + std::to_string(width) + "x" + std::to_string(height) +
                 " samples: choose a smaller --size or --supersample"};
  return {};
}

}  // namespace

Target::Target(std::uint32_t format, std::uint32_t width, std::uint32_t height)
    : width_(width), height_(height), framebuffer_(makeFramebuffer()) {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_.name());
  texture_ = attach(GL_COLOR_ATTACHMENT0, format);
}

GlObject Target::attach(std::uint32_t attachment, std::uint32_t format) const {
  GlObject texture = makeTexture(format, width_, height_);
  glFramebufferTexture2D(GL_FRAMEBUFFER, attachment, GL_TEXTURE_2D, texture.name(), 0);
  return texture;
}

Outcome<Surface> Surface::create(std::uint32_t width, std::uint32_t height, bool carried) {
  if (auto fits = checkSize(width, height); !fits) return fits.error();
  Surface s(GL_RGBA32F, width, height);
  s.depth_ = s.attach(GL_DEPTH_ATTACHMENT, GL_DEPTH_COMPONENT32F);
  if (carried) {
    s.carried_ = s.attach(GL_COLOR_ATTACHMENT1, GL_RGBA16F);
    const GLenum both[] = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1};
    glDrawBuffers(2, both);
  }
  if (auto complete = checkComplete(width, height); !complete) return complete.error();
  return s;
}

Outcome<Canvas> Canvas::create(std::uint32_t width, std::uint32_t height) {
  if (auto fits = checkSize(width, height); !fits) return fits.error();
  Canvas c(GL_RGBA8, width, height);
  if (auto complete = checkComplete(width, height); !complete) return complete.error();
  return c;
}

}  // namespace ridgecast::render
