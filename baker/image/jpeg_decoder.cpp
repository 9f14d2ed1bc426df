#include <algorithm>
#include <csetjmp>
#include <cstdio>

#include <jerror.h>
#include <jpeglib.h>  // after <cstdio>: it names FILE

#include "baker/exec/stop.h"
#include "baker/image/image_decoder.h"

namespace kiln::image {
namespace {

/// Each scan of a progressive file may cost a walk over the whole image.
constexpr int kMaxScans = 500;

std::uint32_t big_endian_16(std::string_view bytes, std::size_t at) {
  return std::uint32_t(std::uint8_t(bytes[at]) << 8 | std::uint8_t(bytes[at + 1]));
}

/// Inverted inks, as Adobe stores them, to RGB.
void inks_to_rgb(ImageTexels texels) {
  const auto product = [](unsigned a, unsigned b) { return std::uint8_t((a * b + 127) / 255); };
  for (auto& t : texels) t = {product(t[0], t[3]), product(t[1], t[3]), product(t[2], t[3]), 255};
}

/// libjpeg leaves by longjmp() when it gives up: no object with a destructor may live in a function
/// that calls it, so all state is here.
class Reader {
 public:
  Reader(std::string_view bytes, const std::stop_token& stop) : bytes_(bytes), stop_(stop) {
    jpeg_.err = jpeg_std_error(&errors_);
    errors_.error_exit = give_up;
    errors_.emit_message = note;
    jpeg_.client_data = this;
    progress_.progress_monitor = watch;
  }
  ~Reader() { jpeg_destroy_decompress(&jpeg_); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  /// False when libjpeg gave up; reason() then says why.
  bool decode(ImageSize declared, ImageTexels texels) {
    if (setjmp(failed_)) return false;
    if (!read_header(declared)) return false;
    read_texels(texels);
    return true;
  }

  bool stopped() const { return stopped_; }
  bool out_of_memory() const { return out_of_memory_; }
  std::string reason() const { return reason_; }
  std::string damage() const { return damage_; }

 private:
  static Reader& of(j_common_ptr jpeg) { return *static_cast<Reader*>(jpeg->client_data); }

  static void give_up(j_common_ptr jpeg) {
    Reader& self = of(jpeg);
    self.out_of_memory_ = jpeg->err->msg_code == JERR_OUT_OF_MEMORY;
    jpeg->err->format_message(jpeg, self.reason_);
    std::longjmp(self.failed_, 1);
  }
  /// Keeps the first word about data that is missing or wrong; others, such as stray bytes between
  /// segments, change no pixel.
  static void note(j_common_ptr jpeg, int level) {
    Reader& self = of(jpeg);
    const int code = jpeg->err->msg_code;
    const bool is_damage = code == JWRN_HIT_MARKER || code == JWRN_HUFF_BAD_CODE ||
                           code == JWRN_MUST_RESYNC || code == JWRN_JPEG_EOF;
    if (level < 0 && is_damage && self.damage_[0] == '\0')
      jpeg->err->format_message(jpeg, self.damage_);
  }
  /// Called for every row of blocks, of every scan.
  static void watch(j_common_ptr jpeg) {
    Reader& self = of(jpeg);
    if (self.jpeg_.input_scan_number > kMaxScans) self.leave("it has over 500 scans");
    self.stopped_ = self.stop_.stop_requested();
    if (self.stopped_) self.leave("stopped");
  }
  [[noreturn]] void leave(const char* why) {
    std::snprintf(reason_, sizeof reason_, "%s", why);
    std::longjmp(failed_, 1);
  }

  bool read_header(ImageSize declared) {
    jpeg_create_decompress(&jpeg_);
    jpeg_.progress = &progress_;
    jpeg_mem_src(&jpeg_, reinterpret_cast<const unsigned char*>(bytes_.data()), bytes_.size());
    jpeg_read_header(&jpeg_, TRUE);
    if (jpeg_.image_width != declared.width || jpeg_.image_height != declared.height)
      leave("its size is declared twice");
    switch (jpeg_.jpeg_color_space) {
      case JCS_GRAYSCALE:
      case JCS_RGB:
      case JCS_YCbCr:
        jpeg_.out_color_space = JCS_EXT_RGBA;
        return true;
      case JCS_CMYK:
      case JCS_YCCK:
        jpeg_.out_color_space = JCS_CMYK;
        return true;
      default:
        leave("its colours are neither grey nor RGB nor CMYK");
    }
  }

  void read_texels(ImageTexels texels) {
    jpeg_start_decompress(&jpeg_);
    while (jpeg_.output_scanline < jpeg_.output_height) {
      JSAMPROW row = texels[std::size_t(jpeg_.output_scanline) * jpeg_.output_width].data();
      jpeg_read_scanlines(&jpeg_, &row, 1);
    }
    if (jpeg_.out_color_space == JCS_CMYK) inks_to_rgb(texels);
  }

  std::string_view bytes_;
  const std::stop_token& stop_;
  jpeg_decompress_struct jpeg_{};
  jpeg_error_mgr errors_{};
  jpeg_progress_mgr progress_{};
  std::jmp_buf failed_;
  char reason_[JMSG_LENGTH_MAX] = {}, damage_[JMSG_LENGTH_MAX] = {};
  bool stopped_ = false, out_of_memory_ = false;
};

}  // namespace

bool is_jpeg(std::string_view bytes) {
  return bytes.starts_with("\xff\xd8\xff");
}

/// From its first SOF marker [ITU T.81, B.2.2]. Bytes between segments are skipped as libjpeg does,
/// so that both find the same marker.
std::optional<ImageSize> jpeg_size(std::string_view bytes) {
  for (std::size_t at = 2; at + 9 <= bytes.size();) {
    const auto byte = static_cast<unsigned char>(bytes[at]);
    const auto marker = static_cast<unsigned char>(bytes[at + 1]);
    if (byte != 0xff || marker == 0 || marker == 0xff) {
      ++at;
      continue;
    }
    at += 2;
    if (marker == 0x01 || (marker >= 0xd0 && marker <= 0xd8)) continue;  // no segment follows
    const bool is_frame =
        marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (is_frame) return ImageSize{big_endian_16(bytes, at + 5), big_endian_16(bytes, at + 3)};
    if (marker == 0xd9 || marker == 0xda) return std::nullopt;
    at += std::max(2u, big_endian_16(bytes, at));
  }
  return std::nullopt;
}

proto::Expected<std::string> decode_jpeg(std::string_view bytes, ImageSize declared,
                                         ImageTexels texels, const std::stop_token& stop) {
  Reader reader(bytes, stop);
  if (reader.decode(declared, texels)) return reader.damage();
  if (reader.stopped()) return exec::canceled();
  if (reader.out_of_memory()) throw std::bad_alloc();
  return proto::fail("invalid_image", reader.reason());
}

}  // namespace kiln::image
