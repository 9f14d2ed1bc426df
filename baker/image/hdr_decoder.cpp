// Radiance pictures [Ward, "Real Pixels", Graphics Gems II, 1991; the file format is described with
// Radiance, "Picture File Format"].
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <optional>
#include <vector>

#include "baker/exec/stop.h"
#include "baker/image/sky_decoder.h"

namespace kiln::image {
namespace {

using proto::Expected;
using proto::Unexpected;

constexpr std::string_view kSignature = "#?";
constexpr std::size_t kMaxHeader = 64 << 10;
/// Rows of these lengths may be packed component by component.
constexpr std::uint32_t kPackedFrom = 8, kPackedTo = 0x7fff;

Unexpected broken(const char* why) {
  return proto::fail("invalid_image", why);
}

/// Takes a line without its end; nothing when there is none.
std::optional<std::string_view> take_line(std::string_view& text) {
  const auto end = text.find('\n');
  if (end == std::string_view::npos) return std::nullopt;
  std::string_view line = text.substr(0, end);
  text.remove_prefix(end + 1);
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

template <class T>
bool parse(std::string_view text, T& out) {
  while (text.starts_with(' ')) text.remove_prefix(1);
  while (text.ends_with(' ')) text.remove_suffix(1);
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
  return error == std::errc() && end == text.data() + text.size();
}

/// "-Y 512 +X 1024": rows from the top, each from the left.
std::optional<ImageSize> parse_size(std::string_view line) {
  ImageSize size;
  const auto x = line.find(" +X ");
  if (!line.starts_with("-Y ") || x == std::string_view::npos) return std::nullopt;
  if (!parse(line.substr(3, x - 3), size.height) || !parse(line.substr(x + 4), size.width))
    return std::nullopt;
  return size;
}

/// Eight numbers with spaces between.
std::optional<Primaries> parse_primaries(std::string_view text) {
  Primaries out;
  for (auto* point : {&out.red, &out.green, &out.blue, &out.white})
    for (float& v : *point) {
      text.remove_prefix(std::min(text.find_first_not_of(" \t"), text.size()));
      const std::string_view number = text.substr(0, text.find_first_of(" \t"));
      if (!parse(number, v)) return std::nullopt;
      text.remove_prefix(number.size());
    }
  if (text.find_first_not_of(" \t") != std::string_view::npos) return std::nullopt;
  return out;
}

struct Header {
  ImageSize size;
  double exposure = 1;  ///< factor on all pixels of the file
  std::optional<Primaries> primaries;
  std::string_view pixels;
};

proto::Expected<Header> read_header(std::string_view bytes) {
  Header header;
  std::string_view text = bytes.substr(0, kMaxHeader);
  while (const auto line = take_line(text)) {
    if (line->empty()) {
      const auto size_line = take_line(text);
      if (!size_line) break;
      const auto size = parse_size(*size_line);
      if (!size) return broken("its rows do not run from the top, each from left to right");
      header.size = *size;
      header.pixels = bytes.substr(std::size_t(text.data() - bytes.data()));
      if (!std::isfinite(1 / header.exposure) || !std::isfinite(header.exposure))
        return broken("the product of its EXPOSUREs is no positive number");
      return header;
    }
    if (line->starts_with("FORMAT=") && *line != "FORMAT=32-bit_rle_rgbe")
      return broken("its pixels are not RGBE");
    if (line->starts_with("COLORCORR=")) return broken("its colours were corrected (COLORCORR)");
    if (line->starts_with("PRIMARIES=")) {
      header.primaries = parse_primaries(line->substr(10));
      if (!header.primaries) return broken("its PRIMARIES are not eight numbers");
    }
    if (!line->starts_with("EXPOSURE=")) continue;
    double exposure = 1;
    if (!parse(line->substr(9), exposure) || !(exposure > 0) || !std::isfinite(exposure))
      return broken("its EXPOSURE is no positive number");
    header.exposure *= exposure;
  }
  return broken("its header has no end");
}

using Rgbe = std::array<std::uint8_t, 4>;

/// Rows of RGBE, in any of the three ways in which they are stored.
class Rows {
 public:
  explicit Rows(std::string_view bytes) : left_(bytes) {}

  /// False when the file ends too early, or is none of Radiance's.
  bool read(std::vector<Rgbe>& row) {
    const std::size_t width = row.size();
    const bool packed = width >= kPackedFrom && width <= kPackedTo && left_.size() >= 4 &&
                        byte(0) == 2 && byte(1) == 2 && byte(2) < 128;
    if (!packed) return read_pixels(row);
    if ((std::size_t(byte(2)) << 8 | byte(3)) != width) return false;
    left_.remove_prefix(4);
    for (std::size_t c = 0; c < 4; ++c)
      if (!read_component(row, c)) return false;
    return true;
  }

 private:
  std::uint8_t byte(std::size_t i) const { return static_cast<std::uint8_t>(left_[i]); }

  /// Runs of one value, and stretches of different ones.
  bool read_component(std::vector<Rgbe>& row, std::size_t c) {
    for (std::size_t x = 0; x < row.size();) {
      if (left_.size() < 2) return false;
      const bool run = byte(0) > 128;
      const std::size_t count = run ? byte(0) - 128u : byte(0), bytes = run ? 1 : count;
      left_.remove_prefix(1);
      if (count == 0 || count > row.size() - x || bytes > left_.size()) return false;
      for (std::size_t i = 0; i < count; ++i) row[x++][c] = byte(run ? 0 : i);
      left_.remove_prefix(bytes);
    }
    return true;
  }

  /// Pixels one after the other; (1, 1, 1, n) repeats the one before n times, and one right behind
  /// it n * 256 times, and so on.
  bool read_pixels(std::vector<Rgbe>& row) {
    int shift = 0;
    for (std::size_t x = 0; x < row.size();) {
      if (left_.size() < 4) return false;
      const Rgbe pixel{byte(0), byte(1), byte(2), byte(3)};
      left_.remove_prefix(4);
      if (pixel[0] != 1 || pixel[1] != 1 || pixel[2] != 1) {
        row[x++] = pixel;
        shift = 0;
        continue;
      }
      if (x == 0 || shift > 16) return false;
      const std::size_t count = std::size_t(pixel[3]) << shift;
      if (count > row.size() - x) return false;
      for (std::size_t i = 0; i < count; ++i, ++x) row[x] = row[x - 1];
      shift += 8;
    }
    return true;
  }

  std::string_view left_;
};

math::Rgb color_of(const Rgbe& pixel, double per_exposure) {
  if (pixel[3] == 0) return {};
  const double scale = std::ldexp(per_exposure, int(pixel[3]) - 136);
  return {float(pixel[0] * scale), float(pixel[1] * scale), float(pixel[2] * scale)};
}

/// The fewest bytes that hold a row: runs of 127 bytes in each of four components, or one pixel
/// that is repeated.
std::uint64_t least_bytes(std::uint32_t width) {
  const std::uint64_t packed = 4 + 4 * 2 * ((std::uint64_t(width) + 126) / 127);
  const std::uint64_t repeated = 4 + (width > 1 ? 4 : 0);
  return width >= kPackedFrom && width <= kPackedTo ? std::min(packed, repeated) : repeated;
}

}  // namespace

bool is_hdr(std::string_view bytes) {
  return bytes.starts_with(kSignature);
}

proto::Expected<SkyHeader> hdr_header(std::string_view bytes) {
  const auto header = read_header(bytes);
  if (!header) return Unexpected(header.error());
  return SkyHeader{header->size, header->primaries};
}

proto::Expected<void> check_hdr_length(std::string_view bytes) {
  const auto header = read_header(bytes);
  if (!header) return Unexpected(header.error());
  if (header->pixels.size() / least_bytes(header->size.width) < header->size.height)
    return broken("the file ends too early");
  return {};
}

proto::Expected<void> decode_hdr(std::string_view bytes, ImageSize declared, SkyTexels texels,
                                 const std::stop_token& stop) {
  const auto header = read_header(bytes);
  if (!header) return Unexpected(header.error());
  Rows rows(header->pixels);
  std::vector<Rgbe> row(declared.width);
  for (std::uint32_t y = 0; y < declared.height; ++y) {
    if (stop.stop_requested()) return exec::canceled();
    if (!rows.read(row)) return broken("its rows are damaged, or the file ends too early");
    for (std::uint32_t x = 0; x < declared.width; ++x)
      texels[std::size_t(y) * declared.width + x] = color_of(row[x], 1 / header->exposure);
  }
  return {};
}

}  // namespace kiln::image
