// The only includer of libpng. Reads a picture row by row; interlaced ones have none.

#include <png.h>

#include <csetjmp>
#include <cstdio>
#include <string>
#include <vector>

#include "common/raster/raster_file.h"

namespace ridgecast::raster {
namespace {

class PngFile final : public RasterFile {
 public:
  explicit PngFile(std::string name) : name_(std::move(name)) {}
  ~PngFile() override {
    if (png_) png_destroy_read_struct(&png_, &info_, nullptr);
    if (file_) std::fclose(file_);
  }
  const RasterHeader& header() const override { return header_; }

  Outcome<void> open(std::uint64_t size) {
    file_ = std::fopen(name_.c_str(), "rb");
    if (!file_) return Error{"cannot read " + name_};
    unsigned char signature[8];
    if (std::fread(signature, 1, 8, file_) != 8 || png_sig_cmp(signature, 0, 8) != 0) return Error{name_ + ": this is not a PNG"};
    png_ = png_create_read_struct(PNG_LIBPNG_VER_STRING, this, &PngFile::failed, [](png_structp, png_const_charp) {});
    if (png_) info_ = png_create_info_struct(png_);
    if (!info_) return Error{name_ + ": no memory to read it with"};
    png_set_user_limits(png_, 0x7fffffff, 0x7fffffff);
    png_set_chunk_malloc_max(png_, 8 << 20);
    if (!begin()) return broken();
    header_.unread = besideIt(name_, false);
    if (png_get_color_type(png_, info_) == PNG_COLOR_TYPE_GRAY_ALPHA || isPartlyTransparent_) header_.unread = "it has a mask (alpha)";
    if (png_get_interlace_type(png_, info_) != PNG_INTERLACE_NONE) header_.unread = "it is interlaced";
    if (!header_.unread.empty()) return {};
    if (png_get_color_type(png_, info_) != PNG_COLOR_TYPE_GRAY)
      return Error{name_ + ": the picture has colours; a height map has one channel, grey, of 8 or 16 bits"};
    bytes_ = png_get_bit_depth(png_, info_) == 16 ? 2 : 1;
    header_.width = png_get_image_width(png_, info_);
    header_.height = png_get_image_height(png_, info_);
    if (auto fine = checkClaim(name_, header_.width, header_.height, bytes_, size, true); !fine) return fine;
    row_.resize(std::size_t{header_.width} * bytes_);
    return {};
  }

  Outcome<void> read(std::span<double> out) override {
    if (!next()) return broken();
    for (std::size_t k = 0; k < out.size(); ++k) out[k] = bytes_ == 2 ? row_[2 * k] << 8 | row_[2 * k + 1] : row_[k];
    return {};
  }

 private:
  // libpng leaves by longjmp: nothing with a destructor may live in the frames below setjmp.
  static void failed(png_structp png, png_const_charp message) {
    auto* self = static_cast<PngFile*>(png_get_error_ptr(png));
    std::snprintf(self->message_, sizeof self->message_, "%s", message);
    std::longjmp(self->jump_, 1);
  }
  bool begin() {
    if (setjmp(jump_) != 0) return false;
    png_init_io(png_, file_);
    png_set_sig_bytes(png_, 8);
    png_read_info(png_, info_);
    isPartlyTransparent_ = png_get_valid(png_, info_, PNG_INFO_tRNS) != 0;
    if (png_get_bit_depth(png_, info_) < 8) png_set_expand_gray_1_2_4_to_8(png_);
    png_read_update_info(png_, info_);
    return true;
  }
  bool next() {
    if (setjmp(jump_) != 0) return false;
    png_read_row(png_, row_.data(), nullptr);
    return true;
  }
  Error broken() const { return {name_ + ": the picture is cut off or broken (" + message_ + ")"}; }

  std::string name_;
  std::FILE* file_ = nullptr;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
  RasterHeader header_;
  std::size_t bytes_ = 1;
  bool isPartlyTransparent_ = false;
  std::vector<unsigned char> row_;
  std::jmp_buf jump_;
  char message_[120] = "";
};

}  // namespace

Outcome<std::unique_ptr<RasterFile>> openPng(const std::filesystem::path& file, std::uint64_t size) {
  auto png = std::make_unique<PngFile>(file.string());
  if (auto opened = png->open(size); !opened) return opened.error();
  return std::unique_ptr<RasterFile>(std::move(png));
}

}  // namespace ridgecast::raster
