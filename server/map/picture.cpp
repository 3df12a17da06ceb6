// The only includer of libjpeg; with common/raster/png_file.cpp of libpng.

#include "server/map/picture.h"

#include <png.h>

#include <cstddef>
#include <cstdio>  // jpeglib.h needs it
#include <cstdlib>
#include <new>

#include <jpeglib.h>

#include "common/outcome/contract.h"

namespace ridgecast::map {

namespace {

void expectsPixels(std::span<const std::uint8_t> rgb, std::uint32_t columns, std::uint32_t rows) {
  expects(columns > 0 && rows > 0 && rgb.size() == std::size_t{3} * columns * rows, "a picture has three bytes for each of its pixels");
}

}  // namespace

std::string png(std::span<const std::uint8_t> rgb, std::uint32_t columns, std::uint32_t rows) {
  expectsPixels(rgb, columns, rows);
  png_structp file = png_create_write_struct(
      PNG_LIBPNG_VER_STRING, nullptr, [](png_structp, png_const_charp) { throw std::bad_alloc(); }, nullptr);
  if (!file) throw std::bad_alloc();
  std::string out;
  png_infop info = png_create_info_struct(file);
  png_set_write_fn(
      file, &out,
      [](png_structp to, png_bytep bytes, std::size_t size) {
        static_cast<std::string*>(png_get_io_ptr(to))->append(reinterpret_cast<const char*>(bytes), size);
      },
      nullptr);
  png_set_compression_level(file, 3);  // 6 takes twice as long for 5 % fewer bytes
  png_set_IHDR(file, info, columns, rows, 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(file, info);
  for (std::uint32_t row = 0; row < rows; ++row) png_write_row(file, &rgb[std::size_t{3} * columns * row]);
  png_write_end(file, info);
  png_destroy_write_struct(&file, &info);
  return out;
}

std::string jpeg(std::span<const std::uint8_t> rgb, std::uint32_t columns, std::uint32_t rows, int quality) {
  expectsPixels(rgb, columns, rows);
  expects(quality >= 1 && quality <= 100, "a JPEG's quality is 1 to 100");
  jpeg_compress_struct file{};
  jpeg_error_mgr errors{};
  file.err = jpeg_std_error(&errors);
  errors.error_exit = [](j_common_ptr) { throw std::bad_alloc(); };
  jpeg_create_compress(&file);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&file, &bytes, &size);
  file.image_width = columns;
  file.image_height = rows;
  file.input_components = 3;
  file.in_color_space = JCS_RGB;
  jpeg_set_defaults(&file);
  jpeg_set_quality(&file, quality, TRUE);
  jpeg_start_compress(&file, TRUE);
  while (file.next_scanline < rows) {
    auto* row = const_cast<JSAMPROW>(&rgb[std::size_t{3} * columns * file.next_scanline]);  // libjpeg reads it only
    jpeg_write_scanlines(&file, &row, 1);
  }
  jpeg_finish_compress(&file);
  jpeg_destroy_compress(&file);
  std::string out(reinterpret_cast<const char*>(bytes), size);
  std::free(bytes);  // NOLINT(cppcoreguidelines-no-malloc): libjpeg's
  return out;
}

}  // namespace ridgecast::map
