#include "baker/image/page_image.h"

#include <png.h>
#include <zlib.h>

#include <csetjmp>
#include <cstring>
#include <new>
#include <stdexcept>
#include <utility>

namespace kiln::image {
namespace {

/// libpng leaves by longjmp() when it gives up: no object with a destructor may live in a function
/// that calls it, so all state is here.
class Writer {
 public:
  Writer() : png_(png_create_write_struct(PNG_LIBPNG_VER_STRING, this, give_up, nullptr)) {
    if (png_) info_ = png_create_info_struct(png_);
    if (!info_) {
      png_destroy_write_struct(&png_, nullptr);
      throw std::bad_alloc();
    }
    png_set_write_fn(png_, this, append, nullptr);
  }
  ~Writer() { png_destroy_write_struct(&png_, &info_); }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  /// False when libpng gave up; reason() then says why.
  bool encode(const std::uint8_t* samples, std::uint32_t width, std::uint32_t height,
              int channels) {
    if (setjmp(failed_)) return false;
    png_set_user_limits(png_, 0x7fffffff, 0x7fffffff);
    png_set_IHDR(png_, info_, width, height, 8,
                 channels == 4 ? PNG_COLOR_TYPE_RGB_ALPHA : PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    // For baked light, runs after the "average" filter come out as small as all filters with full
    // matching do, in a tenth of the time.
    png_set_filter(png_, PNG_FILTER_TYPE_BASE, PNG_FILTER_AVG);
    png_set_compression_strategy(png_, Z_RLE);
    png_write_info(png_, info_);
    for (std::uint32_t y = 0; y < height; ++y)
      png_write_row(png_, samples + std::size_t(y) * width * unsigned(channels));
    png_write_end(png_, nullptr);
    return true;
  }

  std::string& bytes() { return bytes_; }
  bool out_of_memory() const { return out_of_memory_; }
  std::string reason() const { return reason_; }

 private:
  static void give_up(png_structp png, png_const_charp why) {
    auto& self = *static_cast<Writer*>(png_get_error_ptr(png));
    std::strncpy(self.reason_, why, sizeof self.reason_ - 1);
    std::longjmp(self.failed_, 1);
  }
  static void append(png_structp png, png_bytep data, std::size_t count) {
    auto& self = *static_cast<Writer*>(png_get_io_ptr(png));
    try {
      self.bytes_.append(reinterpret_cast<const char*>(data), count);
    } catch (const std::bad_alloc&) {  // must not fly through libpng
      self.out_of_memory_ = true;
    }
    if (self.out_of_memory_) png_error(png, "out of memory");
  }

  std::string bytes_;
  std::jmp_buf failed_;
  char reason_[200] = {};
  bool out_of_memory_ = false;
  png_structp png_;
  png_infop info_ = nullptr;
};

}  // namespace

proto::Expected<std::string> encode_png_bytes(std::span<const std::uint8_t> samples,
                                              std::uint32_t width, std::uint32_t height,
                                              int channels) {
  if (width == 0 || samples.size() != std::size_t(width) * height * std::size_t(channels))
    throw std::invalid_argument("encode_png: the size does not fit the samples");
  Writer writer;
  if (writer.encode(samples.data(), width, height, channels)) return std::move(writer.bytes());
  if (writer.out_of_memory()) throw std::bad_alloc();
  return proto::fail("internal", "cannot encode a PNG: " + writer.reason());
}

proto::Expected<std::string> encode_png(std::span<const std::array<std::uint8_t, 3>> pixels,
                                        std::uint32_t width, std::uint32_t height) {
  return encode_png_bytes({pixels.empty() ? nullptr : pixels[0].data(), pixels.size() * 3}, width,
                          height, 3);
}

}  // namespace kiln::image
