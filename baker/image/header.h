#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <list>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "baker/image/module.h"
#include "baker/image/primaries.h"
#include "proto/expected.h"

namespace kiln::image {

struct Size {
  std::uint32_t width = 0, height = 0;
};

/// The header of an encoded picture, read without the library, which takes memory by these numbers.
/// It has views into the file, which must outlive it.
struct Header {
  Format format{};
  Size size;
  /// Sky maps: the colors that the numbers mean; nothing where the file doesn't tell, and Rec. 709
  /// is meant.
  std::optional<Primaries> primaries;
  std::string odd;   ///< why an OpenEXR or TIFF file is more than one plain picture; "" if it isn't
  std::string flaw;  ///< why it can't be decoded whatever its size is; "" where nothing is known
  bool animated = false;
  /// OpenEXR: the layers of half or float colors. The first is R, G, B, and "" where the file does
  /// not say how it is called; another one is name.R, name.G, name.B.
  std::vector<std::string> layers;
  std::string layer;  ///< OpenEXR: the one to decode; "": the first

  // The decoder needs these.
  std::vector<std::string_view> parts;        ///< the file, without what makes no pixel
  std::vector<std::string_view> alpha_parts;  ///< WebP: the same with alpha; empty: it has none
  std::list<std::string> made;                ///< what parts view beside the file
  std::uint32_t rows = 1;                     ///< that are stored as one
  std::uint64_t chunk_bytes = 0;              ///< unpacked, of what is stored as one
  double exposure = 1;                        ///< Radiance: a factor on all its numbers

  Header() = default;
  Header(Header&&) = default;
  Header& operator=(Header&&) = default;
  Header(const Header&) = delete;
  Header& operator=(const Header&) = delete;

  void add_made(std::string bytes, std::vector<std::string_view>& to) {
    to.push_back(made.emplace_back(std::move(bytes)));
  }
};

// One function a format; each expects bytes that begin as the format does. Errors: `invalid_image`.
proto::Expected<Header> png_header(std::string_view bytes);
proto::Expected<Header> jpeg_header(std::string_view bytes);
proto::Expected<Header> webp_header(std::string_view bytes);
proto::Expected<Header> exr_header(std::string_view bytes);
proto::Expected<Header> hdr_header(std::string_view bytes);
proto::Expected<Header> tiff_header(std::string_view bytes);

/// Makes `header` a picture without Radiance's old way to say that a pixel comes again, which the
/// library takes for pixels. Errors: `invalid_image`, `canceled`.
proto::Expected<void> unfold_old_runs(Header& header, const std::stop_token&);

inline proto::Unexpected invalid_image(const std::string& why) {
  return proto::fail("invalid_image", why);
}
inline constexpr const char* kEndsTooEarly = "the file ends too early";

/// A piece of a picture that is decoded at once may take so much.
inline constexpr std::uint64_t kMaxChunkBytes = 512ull << 20;

/// Reads numbers from the front of bytes; once they run out it has failed and gives zeros.
class Cursor {
 public:
  explicit Cursor(std::string_view bytes, std::endian order = std::endian::little)
      : left_(bytes), order_(order) {}

  template <class T>
  T value() {
    T v{};
    std::string_view b = bytes(sizeof v);
    if (failed_) return v;
    char raw[sizeof v];
    for (std::size_t i = 0; i < sizeof v; ++i)
      raw[i] = b[order_ == std::endian::native ? i : sizeof v - 1 - i];
    std::memcpy(&v, raw, sizeof v);
    return v;
  }
  std::string_view bytes(std::uint64_t n) {
    failed_ = failed_ || n > left_.size();
    if (failed_) return {};
    const auto b = left_.substr(0, std::size_t(n));
    left_.remove_prefix(std::size_t(n));
    return b;
  }
  /// Returns the bytes up to the next zero byte, which is taken too.
  std::string_view name() {
    const auto end = left_.substr(0, 256).find('\0');
    failed_ = failed_ || end == std::string_view::npos;
    if (failed_) return {};
    const auto text = left_.substr(0, end);
    left_.remove_prefix(end + 1);
    return text;
  }
  bool failed() const { return failed_; }
  std::string_view left() const { return left_; }

 private:
  std::string_view left_;
  std::endian order_;
  bool failed_ = false;
};

}  // namespace kiln::image
