#include <png.h>

#include <algorithm>
#include <csetjmp>
#include <cstdlib>
#include <cstring>

#include "baker/exec/stop.h"
#include "baker/image/image_decoder.h"

namespace kiln::image {
namespace {

constexpr std::string_view kSignature = "\x89PNG\r\n\x1a\n";

std::uint32_t big_endian(std::string_view bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t i = at; i < at + 4; ++i) value = value << 8 | std::uint8_t(bytes[i]);
  return value;
}

/// libpng leaves by longjmp() when it gives up: no object with a destructor may live in a function
/// that calls it, so all state is here.
class Reader {
 public:
  explicit Reader(std::string_view bytes)
      : left_(bytes),
        png_(png_create_read_struct_2(PNG_LIBPNG_VER_STRING, this, give_up, ignore, this, allocate,
                                      release)) {
    if (png_) info_ = png_create_info_struct(png_);
    if (!info_) {
      png_destroy_read_struct(&png_, nullptr, nullptr);
      throw std::bad_alloc();
    }
    png_set_read_fn(png_, this, read);
  }
  ~Reader() { png_destroy_read_struct(&png_, &info_, nullptr); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  /// False when libpng gave up; reason() then says why.
  bool decode(ImageSize declared, ImageTexels texels, const std::stop_token& stop) {
    if (setjmp(failed_)) return false;
    read_header(declared);
    read_texels(texels, declared, stop);
    return true;
  }

  bool stopped() const { return stopped_; }
  bool out_of_memory() const { return out_of_memory_; }
  std::string reason() const { return reason_; }

 private:
  static void give_up(png_structp png, png_const_charp why) {
    auto& self = *static_cast<Reader*>(png_get_error_ptr(png));
    std::strncpy(self.reason_, why, sizeof self.reason_ - 1);
    std::longjmp(self.failed_, 1);
  }
  /// About chunks that mean nothing here, such as colour profiles.
  static void ignore(png_structp /*png*/, png_const_charp /*why*/) {}

  static png_voidp allocate(png_structp png, png_alloc_size_t size) {
    void* const memory = std::malloc(size);
    if (!memory) static_cast<Reader*>(png_get_mem_ptr(png))->out_of_memory_ = true;
    return memory;
  }
  static void release(png_structp /*png*/, png_voidp memory) { std::free(memory); }

  static void read(png_structp png, png_bytep to, std::size_t count) {
    auto& left = static_cast<Reader*>(png_get_io_ptr(png))->left_;
    if (count > left.size()) png_error(png, "the file ends too early");
    std::memcpy(to, left.data(), count);
    left.remove_prefix(count);
  }

  void read_header(ImageSize declared) {
    // Colours stay as stored; nothing but palette and transparency is of interest.
    png_set_keep_unknown_chunks(png_, PNG_HANDLE_CHUNK_NEVER, nullptr, -1);
    png_read_info(png_, info_);
    if (png_get_image_width(png_, info_) != declared.width ||
        png_get_image_height(png_, info_) != declared.height)
      png_error(png_, "the header appears twice");
    png_set_expand(png_);
    png_set_scale_16(png_);
    png_set_gray_to_rgb(png_);
    png_set_add_alpha(png_, 0xff, PNG_FILLER_AFTER);
    passes_ = png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
    if (png_get_rowbytes(png_, info_) != std::size_t(declared.width) * 4)
      png_error(png_, "the pixels can't be made RGBA");
  }

  void read_texels(ImageTexels texels, ImageSize size, const std::stop_token& stop) {
    for (int pass = 0; pass < passes_; ++pass) {
      for (std::uint32_t y = 0; y < size.height; ++y) {
        if (stop.stop_requested()) {
          stopped_ = true;
          png_error(png_, "stopped");
        }
        png_read_row(png_, texels[std::size_t(y) * size.width].data(), nullptr);
      }
    }
    png_read_end(png_, nullptr);
  }

  std::string_view left_;
  std::jmp_buf failed_;
  char reason_[200] = {};
  bool stopped_ = false, out_of_memory_ = false;
  int passes_ = 1;
  png_structp png_;
  png_infop info_ = nullptr;
};

}  // namespace

bool is_png(std::string_view bytes) {
  return bytes.starts_with(kSignature);
}

std::optional<ImageSize> png_size(std::string_view bytes) {
  if (bytes.size() < 24 || bytes.substr(12, 4) != "IHDR") return std::nullopt;
  return ImageSize{big_endian(bytes, 16), big_endian(bytes, 20)};
}

proto::Expected<std::string> decode_png(std::string_view bytes, ImageSize declared,
                                        ImageTexels texels, const std::stop_token& stop) {
  Reader reader(bytes);
  if (reader.decode(declared, texels, stop)) return "";
  if (reader.stopped()) return exec::canceled();
  if (reader.out_of_memory()) throw std::bad_alloc();
  return proto::fail("invalid_image", reader.reason());
}

}  // namespace kiln::image
