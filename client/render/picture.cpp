#include "client/render/picture.h"

#include <stb/stb_image.h>
#include <stb/stb_image_write.h>

#include <algorithm>
#include <cstddef>
#include <fstream>

#include "common/outcome/contract.h"

namespace ridgecast::render {

Picture downsample(const Picture& picture, std::uint32_t n) {
  expects(n >= 1 && picture.width % n == 0 && picture.height % n == 0, "a pixel is made of whole samples");
  if (n == 1) return picture;
  Picture out{picture.width / n, picture.height / n, {}, {}};
  out.rgb.resize(std::size_t{out.width} * out.height * 3);
  out.terrain.resize(std::size_t{out.width} * out.height);
  for (std::size_t y = 0; y < out.height; ++y)
    for (std::size_t x = 0; x < out.width; ++x) {
      std::uint32_t sum[3] = {};
      std::uint8_t terrain = 255;
      for (std::size_t v = 0; v < n; ++v)
        for (std::size_t u = 0; u < n; ++u) {
          const std::size_t at = (y * n + v) * picture.width + x * n + u;
          for (std::size_t c = 0; c < 3; ++c) sum[c] += picture.rgb[3 * at + c];
          terrain = std::min(terrain, picture.terrain[at]);
        }
      const std::size_t at = y * out.width + x;
      for (std::size_t c = 0; c < 3; ++c) out.rgb[3 * at + c] = static_cast<std::uint8_t>((sum[c] + n * n / 2) / (n * n));
      out.terrain[at] = terrain;
    }
  return out;
}

std::string encodeJpeg(const Picture& picture, int quality) {
  std::string out;
  const auto append = [](void* text, void* data, int size) {
    static_cast<std::string*>(text)->append(static_cast<char*>(data), static_cast<std::size_t>(size));
  };
  stbi_write_jpg_to_func(append, &out, static_cast<int>(picture.width), static_cast<int>(picture.height), 3, picture.rgb.data(), quality);
  return out;
}

Outcome<void> writePng(const Picture& picture, const std::filesystem::path& file) {
  std::ofstream out(file, std::ios::binary);
  const auto append = [](void* stream, void* data, int size) {
    static_cast<std::ofstream*>(stream)->write(static_cast<char*>(data), size);
  };
  stbi_write_png_to_func(append, &out, static_cast<int>(picture.width), static_cast<int>(picture.height), 3, picture.rgb.data(),
                         static_cast<int>(picture.width * 3));
  out.close();
  if (!out) return Error{"cannot write " + file.string() + ": choose a folder that exists, may be written and has room"};
  return {};
}

Outcome<Picture> readPng(const std::filesystem::path& file) {
  int width = 0, height = 0, channels = 0;
  unsigned char* data = stbi_load(file.c_str(), &width, &height, &channels, 3);
  if (!data) return Error{file.string() + " is not a PNG picture that can be read"};
  Picture out{static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height), {}, {}};
  out.rgb.assign(data, data + std::size_t{out.width} * out.height * 3);
  stbi_image_free(data);
  return out;
}

}  // namespace ridgecast::render
