// OpenEXR's header [OpenEXR, "File Layout"].
#include <algorithm>
#include <array>
#include <set>

#include "baker/image/header.h"

namespace kiln::image {
namespace {

using proto::Expected;

constexpr std::size_t kMaxAttributes = 1000, kMaxChannels = 1024;
/// A window begins within these bounds.
constexpr std::int64_t kFarthest = 1 << 24;
constexpr std::uint64_t kMaxTileSide = 1 << 14;
/// Lines of a chunk, by the compression's number: none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A,
/// DWAA, DWAB.
constexpr std::array<std::uint64_t, 10> kLines{1, 1, 1, 16, 32, 16, 32, 32, 32, 256};

struct Window {
  std::int64_t min_x = 0, min_y = 0, max_x = -1, max_y = -1;
  bool operator==(const Window&) const = default;
};

Window read_window(Cursor& at) {
  Window w;
  for (std::int64_t* edge : {&w.min_x, &w.min_y, &w.max_x, &w.max_y})
    *edge = at.value<std::int32_t>();
  return w;
}

struct Layout {
  Window data, display;
  std::uint64_t pixel_bytes = 0;                 ///< all channels
  std::set<std::string_view> channels, numbers;  ///< all of them; those of half or float
  std::string_view layers;                       ///< what Lightkiln writes of them
  std::uint8_t compression = 0;
  bool tiled = false;
  std::optional<Primaries> primaries;
  std::uint32_t tile_x = 0, tile_y = 0;

  std::uint64_t width() const { return std::uint64_t(data.max_x - data.min_x + 1); }
  std::uint64_t height() const { return std::uint64_t(data.max_y - data.min_y + 1); }
};

/// Returns "" when the attribute is fine.
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
    if (type == kHalf || type == kFloat) out.numbers.insert(name);
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
    out.data = read_window(at);
  } else if (is("displayWindow", "box2i", 16)) {
    out.display = read_window(at);
  } else if (is("compression", "compression", 1)) {
    out.compression = at.value<std::uint8_t>();
  } else if (is("channels", "chlist", 0)) {
    return read_channels(at, out);
  } else if (is("lightkiln:layers", "string", 0)) {
    out.layers = bytes;
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

std::string check(const Layout& layout) {
  const Window& w = layout.data;
  for (const std::int64_t edge : {w.min_x, w.min_y, w.max_x, w.max_y})
    if (std::abs(edge) > kFarthest) return "its window can't be right";
  if (w.max_x < w.min_x || w.max_y < w.min_y) return "its window is empty";
  if (layout.compression >= kLines.size()) return "its compression is unknown";
  for (const char* channel : {"R", "G", "B"})
    if (layout.channels.count(channel) == 0) return std::string("it has no channel ") + channel;
  for (const std::uint64_t side : {layout.tile_x, layout.tile_y})
    if (layout.tiled && (side == 0 || side > kMaxTileSide)) return "its tiles can't be right";
  return "";
}

/// See Header::layers.
std::vector<std::string> layers_of(const Layout& layout) {
  std::vector<std::string> names{std::string(layout.layers.substr(0, layout.layers.find(',')))};
  for (const std::string_view channel : layout.numbers) {
    if (!channel.ends_with(".R")) continue;
    const std::string name(channel.substr(0, channel.size() - 2));
    if (layout.numbers.contains(name + ".G") && layout.numbers.contains(name + ".B"))
      names.push_back(name);
  }
  return names;
}

/// Fills in the facts that a decoder needs. `rest`: bytes behind the header.
void fill(Header& header, const Layout& layout, std::size_t rest) {
  header.size = {std::uint32_t(layout.width()), std::uint32_t(layout.height())};
  header.primaries = layout.primaries;
  header.layers = layers_of(layout);
  std::uint64_t chunks = 0;
  if (layout.tiled) {
    const std::uint64_t x = layout.tile_x, y = layout.tile_y;
    const std::uint64_t columns = (layout.width() + x - 1) / x,
                        rows = (layout.height() + y - 1) / y;
    chunks = columns * rows;
    header.rows = layout.tile_y;
    header.chunk_bytes = columns * x * y * layout.pixel_bytes;  // a row of tiles is read at once
  } else {
    const std::uint64_t lines = kLines[layout.compression];
    chunks = (layout.height() + lines - 1) / lines;
    header.rows = std::uint32_t(lines);
    header.chunk_bytes = layout.width() * lines * layout.pixel_bytes;
  }
  if (chunks > rest / sizeof(std::uint64_t))
    header.flaw = kEndsTooEarly;
  else if (header.chunk_bytes > kMaxChunkBytes)
    header.flaw = "its chunks are too large";
}

}  // namespace

Expected<Header> exr_header(std::string_view bytes) {
  constexpr std::uint32_t kVersion = 2, kTiled = 0x200, kLongNames = 0x400, kParts = 0x1000;
  Header header;
  header.format = Format::kExr;
  header.parts = {bytes};
  Layout layout;
  Cursor at(bytes);
  at.bytes(4);  // the signature
  const auto version = at.value<std::uint32_t>();
  if (at.failed() || (version & 0xff) != kVersion) return invalid_image("its version is unknown");
  if ((version & ~(0xff | kTiled | kLongNames)) != 0)
    header.odd = "it has several parts or deep pixels: only plain pictures are read";
  if ((version & ~(0xff | kTiled | kLongNames | kParts)) != 0) return invalid_image(header.odd);
  layout.tiled = (version & kTiled) != 0;
  std::set<std::string_view> seen;
  for (;;) {
    const std::string_view name = at.name();
    if (name.empty() && !at.failed()) break;
    const std::string_view type = at.name();
    const auto size = at.value<std::int32_t>();
    const std::string_view value = at.bytes(size < 0 ? bytes.size() : std::size_t(size));
    if (at.failed()) return invalid_image("its header can't be read");
    if (!seen.insert(name).second || seen.size() > kMaxAttributes)
      return invalid_image("its header has an attribute twice, or too many");
    // Each of several parts says for itself how it is stored.
    if (name == "type" && type == "string") {
      layout.tiled = value == "tiledimage";
      if (value.starts_with("deep")) return invalid_image("its pixels are deep");
    }
    if (auto why = read_attribute(name, type, value, layout); !why.empty())
      return invalid_image(why);
  }
  if (auto why = check(layout); !why.empty()) return invalid_image(why);
  if (header.odd.empty() && !(layout.data == layout.display))
    header.odd = "its pixels do not fill its display window";
  fill(header, layout, at.left().size());
  return header;
}

}  // namespace kiln::image
