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

Outcome<Surface> Surface::create(std::uint32_t width, std::uint32_t height, bool carried) {
  if (auto fits = checkSize(width, height); !fits) return fits.error();
  Surface s;
  s.width_ = width;
  s.height_ = height;
  s.positions_ = makeTexture(GL_RGBA32F, width, height);
  s.depth_ = makeTexture(GL_DEPTH_COMPONENT32F, width, height);
  s.framebuffer_ = makeFramebuffer();
  glBindFramebuffer(GL_FRAMEBUFFER, s.framebuffer_.name());
  glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, s.positions_.name(), 0);
  if (carried) {
    s.carried_ = makeTexture(GL_RGBA16F, width, height);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT1, GL_TEXTURE_2D, s.carried_.name(), 0);
    const GLenum both[] = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1};
    glDrawBuffers(2, both);
  }
  glFramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, s.depth_.name(), 0);
  if (auto complete = checkComplete(width, height); !complete) return complete.error();
  return s;
}

Outcome<Canvas> Canvas::create(std::uint32_t width, std::uint32_t height) {
  if (auto fits = checkSize(width, height); !fits) return fits.error();
  Canvas c;
  c.width_ = width;
  c.height_ = height;
  c.colours_ = makeTexture(GL_RGBA8, width, height);
  c.framebuffer_ = makeFramebuffer();
  glBindFramebuffer(GL_FRAMEBUFFER, c.framebuffer_.name());
  glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, c.colours_.name(), 0);
  if (auto complete = checkComplete(width, height); !complete) return complete.error();
  return c;
}

}  // namespace ridgecast::render
