#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartInputFile.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <memory>
#include <new>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "baker/exec/stop.h"
#include "baker/image/sky_decoder.h"

namespace kiln::image {
namespace {

using proto::Expected;
using proto::Unexpected;

constexpr std::string_view kSignature("\x76\x2f\x31\x01", 4);
constexpr std::size_t kMaxAttributes = 1000, kMaxChannels = 64;
/// Where a window may begin, and how much the library may decode at once.
constexpr std::int64_t kFarthest = 1 << 24;
constexpr std::uint64_t kMaxChunkBytes = 512ull << 20, kMaxTileSide = 1 << 14;
/// Lines of a chunk, by the compression's number: none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A,
/// DWAA, DWAB.
constexpr std::array<std::uint64_t, 10> kLines{1, 1, 1, 16, 32, 16, 32, 32, 32, 256};

Unexpected broken(const std::string& why) {
  return proto::fail("invalid_image", why);
}

/// Reads little-endian values from the front; `failed` once they run out.
class Cursor {
 public:
  explicit Cursor(std::string_view bytes) : left_(bytes) {}

  template <class T>
  T value() {
    static_assert(std::endian::native == std::endian::little);
    T v{};
    if (const auto b = bytes(sizeof v); !failed_) std::memcpy(&v, b.data(), sizeof v);
    return v;
  }
  std::string_view bytes(std::size_t n) {
    failed_ = failed_ || n > left_.size();
    if (failed_) return {};
    const auto b = left_.substr(0, n);
    left_.remove_prefix(n);
    return b;
  }
  /// Up to the next zero byte, which is taken too.
  std::string_view name() {
    const auto end = left_.substr(0, 256).find('\0');
    failed_ = failed_ || end == std::string_view::npos;
    if (failed_) return {};
    const auto text = left_.substr(0, end);
    left_.remove_prefix(end + 1);
    return text;
  }
  bool failed() const { return failed_; }
  std::size_t size() const { return left_.size(); }

 private:
  std::string_view left_;
  bool failed_ = false;
};

struct Window {
  std::int32_t min_x = 0, min_y = 0, max_x = -1, max_y = -1;
  bool operator==(const Window&) const = default;
};

/// What a header says, read without the library: that takes memory by these numbers.
struct Layout {
  Window data, display;
  std::uint64_t pixel_bytes = 0;  ///< all channels
  std::set<std::string_view> channels;
  std::uint8_t compression = 0;
  bool tiled = false;
  std::optional<Primaries> primaries;
  std::uint32_t tile_x = 0, tile_y = 0;
  std::size_t rest = 0;  ///< bytes behind the header

  std::uint64_t width() const { return std::uint64_t(std::int64_t(data.max_x) - data.min_x + 1); }
  std::uint64_t height() const { return std::uint64_t(std::int64_t(data.max_y) - data.min_y + 1); }
};

/// "" when the attribute is fine.
std::string read_channels(Cursor at, Layout& out) {
  constexpr std::int32_t kHalf = 1, kFloat = 2;
  for (;;) {
    const std::string_view name = at.name();
    if (at.failed()) return "its channels can't be read";
    if (name.empty()) return "";
    const auto type = at.value<std::int32_t>();
    at.bytes(4);
    const auto x_step = at.value<std::int32_t>(), y_step = at.value<std::int32_t>();
    if (at.failed() || type < 0 || type > kFloat) return "its channels can't be read";
    const bool is_color = name == "R" || name == "G" || name == "B";
    if (is_color && type != kHalf && type != kFloat)
      return "its channels are neither half nor float";
    if (x_step != 1 || y_step != 1) return "its channels are subsampled";
    if (!out.channels.insert(name).second) return "a channel appears twice";
    if (out.channels.size() > kMaxChannels) return "it has too many channels";
    out.pixel_bytes += type == kHalf ? 2 : 4;
  }
}

std::string read_attribute(std::string_view name, std::string_view type, std::string_view bytes,
                           Layout& out) {
  Cursor at(bytes);
  const auto is = [&](const char* n, const char* t, std::size_t size) {
    return name == n && type == t && (size == 0 || bytes.size() == size);
  };
  if (is("dataWindow", "box2i", 16)) {
    out.data = at.value<Window>();
  } else if (is("displayWindow", "box2i", 16)) {
    out.display = at.value<Window>();
  } else if (is("compression", "compression", 1)) {
    out.compression = at.value<std::uint8_t>();
  } else if (is("channels", "chlist", 0)) {
    return read_channels(at, out);
  } else if (name == "chromaticities") {
    if (!is("chromaticities", "chromaticities", 32)) return "its chromaticities can't be read";
    Primaries& p = out.primaries.emplace();
    for (auto* point : {&p.red, &p.green, &p.blue, &p.white})
      for (float& v : *point) v = at.value<float>();
  } else if (is("tiles", "tiledesc", 9)) {
    out.tile_x = at.value<std::uint32_t>(), out.tile_y = at.value<std::uint32_t>();
  }
  return "";
}

/// All but the length of the file.
std::string check_layout(const Layout& layout) {
  const Window& w = layout.data;
  for (const std::int32_t edge : {w.min_x, w.min_y, w.max_x, w.max_y})
    if (std::abs(std::int64_t(edge)) > kFarthest) return "its window can't be right";
  if (w.max_x < w.min_x || w.max_y < w.min_y) return "its window is empty";
  if (!(w == layout.display)) return "its pixels do not fill its display window";
  if (layout.compression >= kLines.size()) return "its compression is unknown";
  for (const char* channel : {"R", "G", "B"})
    if (layout.channels.count(channel) == 0) return std::string("it has no channel ") + channel;
  for (const std::uint64_t side : {layout.tile_x, layout.tile_y})
    if (layout.tiled && (side == 0 || side > kMaxTileSide)) return "its tiles can't be right";
  return "";
}

struct Chunks {
  std::uint64_t count = 0, bytes = 0;  ///< how many, and of each when it is unpacked
};
Chunks chunks_of(const Layout& layout) {
  if (layout.tiled) {
    const std::uint64_t x = layout.tile_x, y = layout.tile_y;
    const std::uint64_t columns = (layout.width() + x - 1) / x,
                        rows = (layout.height() + y - 1) / y;
    // The library keeps a whole row of tiles.
    return {columns * rows, columns * x * y * layout.pixel_bytes};
  }
  const std::uint64_t lines = kLines[layout.compression];
  return {(layout.height() + lines - 1) / lines, layout.width() * lines * layout.pixel_bytes};
}

proto::Expected<void> check_length(const Layout& layout) {
  const Chunks chunks = chunks_of(layout);
  if (chunks.count > layout.rest / sizeof(std::uint64_t)) return broken("the file ends too early");
  if (chunks.bytes > kMaxChunkBytes) return broken("its chunks are too large");
  return {};
}

proto::Expected<Layout> read_layout(std::string_view bytes) {
  constexpr std::uint32_t kVersion = 2, kTiled = 0x200, kLongNames = 0x400;
  Layout layout;
  Cursor at(bytes);
  at.bytes(kSignature.size());
  const auto version = at.value<std::uint32_t>();
  if (at.failed() || (version & 0xff) != kVersion) return broken("its version is unknown");
  if ((version & ~(0xff | kTiled | kLongNames)) != 0)
    return broken("it has several parts or deep pixels: only plain pictures are read");
  layout.tiled = (version & kTiled) != 0;
  std::set<std::string_view> seen;
  for (;;) {
    const std::string_view name = at.name();
    if (name.empty() && !at.failed()) break;
    const std::string_view type = at.name();
    const auto size = at.value<std::int32_t>();
    const std::string_view value = at.bytes(size < 0 ? bytes.size() : std::size_t(size));
    if (at.failed()) return broken("its header can't be read");
    if (!seen.insert(name).second || seen.size() > kMaxAttributes)
      return broken("its header has an attribute twice, or too many");
    if (auto why = read_attribute(name, type, value, layout); !why.empty()) return broken(why);
  }
  layout.rest = at.size();
  if (auto why = check_layout(layout); !why.empty()) return broken(why);
  return layout;
}

/// The file, for the library.
class Stream final : public Imf::IStream {
 public:
  explicit Stream(std::string_view bytes) : IStream("sky map"), bytes_(bytes) {}

  bool isMemoryMapped() const override { return false; }
  bool read(char to[], int n) override {
    if (n < 0 || std::uint64_t(n) > bytes_.size() - at_)
      throw std::runtime_error("the file ends too early");
    std::memcpy(to, bytes_.data() + at_, std::size_t(n));
    at_ += std::size_t(n);
    return at_ < bytes_.size();
  }
  std::uint64_t tellg() override { return at_; }
  void seekg(std::uint64_t to) override {
    if (to > bytes_.size()) throw std::runtime_error("a place lies behind the end of the file");
    at_ = std::size_t(to);
  }

 private:
  std::string_view bytes_;
  std::size_t at_ = 0;
};

/// False when stopped. Throws what the library throws.
bool decode(std::string_view bytes, const Layout& layout, SkyTexels texels,
            const std::stop_token& stop) {
  Stream stream(bytes);
  Imf::MultiPartInputFile file(stream, 0, /*reconstructChunkOffsetTable=*/false);
  Imf::InputPart part(file, 0);
  const auto box = part.header().dataWindow();
  const Window& w = layout.data;
  if (!(Window{box.min.x, box.min.y, box.max.x, box.max.y} == w))
    throw std::runtime_error("its window can't be read");
  const std::size_t stride = sizeof(math::Rgb), row = stride * std::size_t(layout.width());
  Imf::FrameBuffer frame;
  for (const auto& [name, first] :
       {std::pair("R", &texels[0].r), std::pair("G", &texels[0].g), std::pair("B", &texels[0].b)})
    frame.insert(name, Imf::Slice::Make(Imf::FLOAT, first, box.min, std::int64_t(layout.width()),
                                        std::int64_t(layout.height()), stride, row));
  part.setFrameBuffer(frame);
  const std::int64_t step = layout.tiled ? layout.tile_y : kLines[layout.compression];
  for (std::int64_t y = w.min_y; y <= w.max_y; y += step) {
    if (stop.stop_requested()) return false;
    part.readPixels(int(y), int(std::min<std::int64_t>(y + step - 1, w.max_y)));
  }
  return true;
}

/// Throws std::bad_alloc when the library may have failed for want of memory. It tells that by
/// errors of its own, which may name it; zlib within says no more than that it failed. What it held
/// is free again: if that was not enough, as much is not to be had now.
void throw_if_memory_lacks(const std::string& error, const Layout& layout) {
  constexpr std::uint64_t kCopies = 8, kBeside = 4 << 20, kPiece = 256 << 20;
  if (error.find("std::bad_alloc") != std::string::npos) throw std::bad_alloc();
  std::vector<std::unique_ptr<char[]>> room;
  for (std::uint64_t left = kCopies * chunks_of(layout).bytes + kBeside; left > 0;) {
    const std::uint64_t piece = std::min(left, kPiece);
    room.push_back(std::make_unique_for_overwrite<char[]>(piece));
    left -= piece;
  }
}

}  // namespace

bool is_exr(std::string_view bytes) {
  return bytes.starts_with(kSignature);
}

proto::Expected<SkyHeader> exr_header(std::string_view bytes) {
  const auto layout = read_layout(bytes);
  if (!layout) return Unexpected(layout.error());
  return SkyHeader{{std::uint32_t(layout->width()), std::uint32_t(layout->height())},
                   layout->primaries};
}

proto::Expected<void> check_exr_length(std::string_view bytes) {
  const auto layout = read_layout(bytes);
  if (!layout) return Unexpected(layout.error());
  return check_length(*layout);
}

proto::Expected<void> decode_exr(std::string_view bytes, ImageSize /*declared*/, SkyTexels texels,
                                 const std::stop_token& stop) {
  const auto layout = read_layout(bytes);
  if (!layout) return Unexpected(layout.error());
  if (auto fits = check_length(*layout); !fits) return fits;
  try {
    if (!decode(bytes, *layout, texels, stop)) return exec::canceled();
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& e) {  // the library's own are among them
    const std::string why = e.what();
    throw_if_memory_lacks(why, *layout);
    return broken(why);
  }
  return {};
}

}  // namespace kiln::image
