// Radiance's header [Ward, "Real Pixels", Graphics Gems II, 1991; the file format is described with
// Radiance, "Picture File Format"]. The library reads no more of it than the size; so much is given
// to it.
#include <algorithm>
#include <charconv>
#include <cmath>

#include "baker/exec/stop.h"
#include "baker/image/header.h"

namespace kiln::image {
namespace {

using proto::Expected;

constexpr std::size_t kMaxHeader = 64 << 10;
/// Rows of these lengths may be packed component by component.
constexpr std::uint32_t kPackedFrom = 8, kPackedTo = 0x7fff;

/// Takes a line without its end; returns nothing when there is none.
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
std::optional<Size> parse_size(std::string_view line) {
  Size size;
  const auto x = line.find(" +X ");
  if (!line.starts_with("-Y ") || x == std::string_view::npos) return std::nullopt;
  if (!parse(line.substr(3, x - 3), size.height) || !parse(line.substr(x + 4), size.width))
    return std::nullopt;
  return size;
}

/// Reads eight numbers with spaces between.
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

/// Returns "" when the line is fine.
std::string read_line(std::string_view line, Header& header) {
  if (line.starts_with("FORMAT=") && line != "FORMAT=32-bit_rle_rgbe")
    return "its pixels are not RGBE";
  if (line.starts_with("COLORCORR=")) return "its colors were corrected (COLORCORR)";
  if (line.starts_with("PRIMARIES=")) {
    header.primaries = parse_primaries(line.substr(10));
    if (!header.primaries) return "its PRIMARIES are not eight numbers";
  }
  if (!line.starts_with("EXPOSURE=")) return "";
  double exposure = 1;
  if (!parse(line.substr(9), exposure) || !(exposure > 0) || !std::isfinite(exposure))
    return "its EXPOSURE is no positive number";
  header.exposure *= exposure;
  return "";
}

bool may_be_packed(std::uint32_t width) {
  return width >= kPackedFrom && width <= kPackedTo;
}

/// The fewest bytes that hold a row: runs of 127 bytes in each of four components, or one pixel
/// that is repeated.
std::uint64_t least_bytes(std::uint32_t width) {
  const std::uint64_t packed = 4 + 4 * 2 * ((std::uint64_t(width) + 126) / 127);
  const std::uint64_t repeated = 4 + (width > 1 ? 4 : 0);
  return may_be_packed(width) ? std::min(packed, repeated) : repeated;
}

bool is_old_run(std::string_view pixel) {
  return pixel.starts_with("\x01\x01\x01");
}

}  // namespace

Expected<Header> hdr_header(std::string_view bytes) {
  Header header;
  header.format = Format::kHdr;
  header.rows = 16;
  std::string_view text = bytes.substr(0, kMaxHeader);
  while (const auto line = take_line(text)) {
    if (!line->empty()) {
      if (auto why = read_line(*line, header); !why.empty()) return invalid_image(why);
      continue;
    }
    const auto size_line = take_line(text);
    if (!size_line) break;
    const auto size = parse_size(*size_line);
    if (!size) return invalid_image("its rows do not run from the top, each from left to right");
    header.size = *size;
    if (!std::isfinite(1 / header.exposure) || !std::isfinite(header.exposure))
      return invalid_image("the product of its EXPOSUREs is no positive number");
    header.add_made("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y " + std::to_string(size->height) +
                        " +X " + std::to_string(size->width) + "\n",
                    header.parts);
    const std::string_view pixels = bytes.substr(std::size_t(text.data() - bytes.data()));
    header.parts.push_back(pixels);
    header.chunk_bytes = std::uint64_t(size->width) * 16 * header.rows;
    if (pixels.size() / least_bytes(size->width) < size->height) header.flaw = kEndsTooEarly;
    return header;
  }
  return invalid_image("its header has no end");
}

/// (1, 1, 1, n) repeats the pixel before n times, and one right behind it n * 256 times, and so on.
Expected<void> unfold_old_runs(Header& header, const std::stop_token& stop) {
  constexpr const char* kDamaged = "its rows are damaged, or the file ends too early";
  std::string_view left = header.parts.back();
  const bool packed = may_be_packed(header.size.width) && left.starts_with("\x02\x02") &&
                      left.size() > 2 && left[2] >= 0;
  bool runs = false;
  for (std::size_t at = 0; !packed && !runs && at + 4 <= left.size(); at += 4)
    runs = is_old_run(left.substr(at));
  if (!runs) return {};
  std::string pixels;
  const std::uint64_t row = std::uint64_t(header.size.width) * 4;
  for (std::uint32_t y = 0; y < header.size.height; ++y) {
    if (stop.stop_requested()) return exec::canceled();
    const std::uint64_t begin = row * y, end = begin + row;
    for (int shift = 0; pixels.size() < end;) {
      if (left.size() < 4) return invalid_image(kDamaged);
      const std::string_view pixel = left.substr(0, 4);
      left.remove_prefix(4);
      if (!is_old_run(pixel)) {
        pixels += pixel;
        shift = 0;
        continue;
      }
      const std::uint64_t count = shift > 16 ? end : std::uint64_t(std::uint8_t(pixel[3])) << shift;
      if (pixels.size() == begin || count > (end - pixels.size()) / 4)
        return invalid_image(kDamaged);
      const std::string last = pixels.substr(pixels.size() - 4);
      for (std::uint64_t i = 0; i < count; ++i) pixels += last;
      shift += 8;
    }
  }
  header.parts.pop_back();
  header.add_made(std::move(pixels), header.parts);
  return {};
}

}  // namespace kiln::image
