// Reduces a TIFF file [TIFF 6.0, and BigTIFF] to its first picture and the fields of its pixels, so
// that no profile, thumbnail or text reaches a parser.
#include <algorithm>
#include <initializer_list>
#include <map>

#include "baker/image/header.h"

namespace kiln::image {
namespace {

using proto::Expected;

enum Tag : std::uint16_t {
  kWidth = 256,
  kHeight = 257,
  kBits = 258,
  kCompression = 259,
  kPhotometric = 262,
  kStripOffsets = 273,
  kOrientation = 274,
  kSamples = 277,
  kStripRows = 278,
  kStripBytes = 279,
  kPlanar = 284,
  kPredictor = 317,
  kWhitePoint = 318,
  kPrimaries = 319,
  kTileWidth = 322,
  kTileHeight = 323,
  kTileOffsets = 324,
  kTileBytes = 325,
  kExtraSamples = 338,
  kSampleFormat = 339
};
constexpr std::uint16_t kForTheDecoder[] = {
    kWidth,      kHeight,      kBits,       kCompression,  kPhotometric, kStripOffsets,
    kSamples,    kStripRows,   kStripBytes, kPlanar,       kPredictor,   kTileWidth,
    kTileHeight, kTileOffsets, kTileBytes,  kExtraSamples, kSampleFormat};
constexpr std::uint64_t kMaxFields = 4096, kMaxSamples = 64, kMaxTileSide = 1 << 14;

struct Field {
  std::uint16_t type = 0;
  std::uint64_t count = 0;
  std::string_view entry;   ///< as the directory has it
  std::string_view values;  ///< wherever they are

  std::size_t value_bytes() const {
    constexpr std::size_t kBytes[] = {0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8};
    return type < std::size(kBytes) ? kBytes[type] : 0;
  }
};

class Tiff {
 public:
  explicit Tiff(std::string_view bytes)
      : bytes_(bytes), order_(bytes.starts_with("MM") ? std::endian::big : std::endian::little) {}

  Expected<Header> run() {
    if (!read_directory()) return invalid_image("its header can't be read");
    header_.format = Format::kTiff;
    header_.size = {std::uint32_t(number(kWidth)), std::uint32_t(number(kHeight))};
    if (number(kWidth) > UINT32_MAX || number(kHeight) > UINT32_MAX)
      return invalid_image("its size can't be right");
    for (auto why : {check_pixels(), check_storage()})
      if (!why.empty()) return invalid_image(why);
    read_primaries();
    rebuild();
    return std::move(header_);
  }

 private:
  Cursor at(std::uint64_t place) const {
    return Cursor(place <= bytes_.size() ? bytes_.substr(std::size_t(place)) : std::string_view(),
                  order_);
  }
  std::uint64_t word(Cursor& c) const {
    return big_ ? c.value<std::uint64_t>() : c.value<std::uint32_t>();
  }
  std::size_t word_bytes() const { return big_ ? 8 : 4; }

  bool read_directory() {
    Cursor head = at(2);
    const auto version = head.value<std::uint16_t>();
    big_ = version == 43;
    if (big_ && (head.value<std::uint16_t>() != 8 || head.value<std::uint16_t>() != 0))
      return false;
    const std::uint64_t place = word(head);
    Cursor directory = at(place);
    const std::uint64_t count =
        big_ ? directory.value<std::uint64_t>() : directory.value<std::uint16_t>();
    if (head.failed() || directory.failed() || count > kMaxFields) return false;
    for (std::uint64_t i = 0; i < count; ++i) {
      Field field;
      field.entry = directory.bytes(4 + 2 * word_bytes());
      Cursor entry(field.entry, order_);
      const auto tag = entry.value<std::uint16_t>();
      field.type = entry.value<std::uint16_t>();
      field.count = word(entry);
      if (directory.failed()) return false;
      const std::uint64_t bytes = std::min(field.count, bytes_.size() + 1) * field.value_bytes();
      field.values = entry.left().substr(0, std::size_t(bytes));
      if (bytes > word_bytes()) field.values = at(word(entry)).bytes(bytes);
      fields_.emplace(tag, field);
    }
    return true;
  }

  /// Returns number `i` of a field, which may be of 16, 32 or 64 bits; `otherwise` where there is
  /// none.
  std::uint64_t number(Tag tag, std::uint64_t otherwise = 0, std::uint64_t i = 0) const {
    const auto found = fields_.find(tag);
    if (found == fields_.end()) return otherwise;
    const Field& field = found->second;
    const std::size_t size = field.value_bytes();
    if (i >= field.values.size() / std::max<std::size_t>(1, size)) return otherwise;
    Cursor value(field.values.substr(i * size), order_);
    if (size == 2) return value.value<std::uint16_t>();
    if (size == 4) return value.value<std::uint32_t>();
    return value.value<std::uint64_t>();
  }
  bool all_are(Tag tag, std::uint64_t wanted) const {
    for (std::uint64_t i = 0; i < samples_; ++i)
      if (number(tag, 0, i) != wanted) return false;
    return true;
  }

  /// Returns "" when the pixels are red, green and blue as numbers with a fraction.
  std::string check_pixels() {
    constexpr std::uint64_t kRgb = 2, kFloat = 3;
    samples_ = number(kSamples, 1);
    if (samples_ < 3 || samples_ > kMaxSamples || number(kPhotometric) != kRgb)
      return "its channels are not R, G and B";
    const std::uint64_t bits = number(kBits);
    if ((bits != 16 && bits != 32) || !all_are(kBits, bits) || !all_are(kSampleFormat, kFloat))
      return "its channels are neither half nor float";
    pixel_bytes_ = samples_ * bits / 8;
    if (number(kOrientation, 1) != 1)
      return "its rows do not run from the top, each from left to right";
    return "";
  }

  std::string check_storage() {
    constexpr std::uint64_t kNone = 1, kLzw = 5, kDeflate = 8, kOldDeflate = 32946,
                            kPackBits = 32773;
    const std::uint64_t compression = number(kCompression, kNone), planar = number(kPlanar, 1);
    if (compression != kNone && compression != kLzw && compression != kDeflate &&
        compression != kOldDeflate && compression != kPackBits)
      return "its compression is unknown";
    if (planar != 1 && planar != 2) return "its planes can't be right";
    const bool tiled = fields_.contains(kTileWidth);
    const std::uint64_t width = header_.size.width, height = header_.size.height;
    const std::uint64_t x = tiled ? number(kTileWidth) : std::max<std::uint64_t>(1, width);
    std::uint64_t y = tiled ? number(kTileHeight) : number(kStripRows, height);
    if (!tiled) y = std::clamp<std::uint64_t>(y, 1, std::max<std::uint64_t>(1, height));
    if (tiled && (x == 0 || y == 0 || x > kMaxTileSide || y > kMaxTileSide))
      return "its tiles can't be right";
    const std::uint64_t columns = (width + x - 1) / x, rows = (height + y - 1) / y;
    header_.rows = std::uint32_t(tiled ? y : std::min<std::uint64_t>(y, 64));
    header_.chunk_bytes = columns * x * y * pixel_bytes_;
    if (width > 0 && height > UINT64_MAX / 64 / width) return "its size can't be right";
    if (header_.chunk_bytes / columns_or_one(columns) > kMaxChunkBytes)
      header_.flaw = "its chunks are too large";
    if (!chunks_are_there(columns * rows * (planar == 2 ? samples_ : 1),
                          tiled ? kTileOffsets : kStripOffsets, tiled ? kTileBytes : kStripBytes))
      header_.flaw = kEndsTooEarly;
    return "";
  }
  static std::uint64_t columns_or_one(std::uint64_t columns) {
    return std::max<std::uint64_t>(1, columns);
  }

  bool chunks_are_there(std::uint64_t count, Tag offsets, Tag lengths) const {
    if (count > bytes_.size()) return false;
    for (std::uint64_t i = 0; i < count; ++i) {
      const std::uint64_t offset = number(offsets, UINT64_MAX, i), length = number(lengths, 0, i);
      if (offset > bytes_.size() || length > bytes_.size() - offset || length == 0) return false;
    }
    return true;
  }

  /// Rationals: x and y of white, and of red, green and blue.
  void read_primaries() {
    const auto found = fields_.find(kPrimaries), white = fields_.find(kWhitePoint);
    if (found == fields_.end() && white == fields_.end()) return;
    Primaries& p = header_.primaries.emplace();
    const auto read = [&](const auto& field, std::initializer_list<Primaries::Point*> points) {
      if (field == fields_.end()) return;
      Cursor values(field->second.values, order_);
      for (Primaries::Point* point : points)
        for (float& v : *point) {
          const double above = values.value<std::uint32_t>(), below = values.value<std::uint32_t>();
          v = float(above / below);  // 0 / 0 is no number, which is refused as a primary
        }
    };
    read(found, {&p.red, &p.green, &p.blue});
    read(white, {&p.white});
  }

  template <class T>
  void put(std::string& out, T value) const {
    for (std::size_t i = 0; i < sizeof value; ++i) {
      const std::size_t shift = 8 * (order_ == std::endian::little ? i : sizeof value - 1 - i);
      out += static_cast<char>(std::uint64_t(value) >> shift);
    }
  }
  void put_word(std::string& out, std::uint64_t value) const {
    big_ ? put(out, value) : put(out, std::uint32_t(value));
  }

  /// Returns the old head with another directory's place, the old bytes, the new directory.
  void rebuild() {
    std::string directory(bytes_.size() % 2, '\0'), head(bytes_.substr(0, big_ ? 8 : 4));
    put_word(head, bytes_.size() + directory.size());
    std::string entries;
    std::uint16_t count = 0;
    for (const std::uint16_t tag : kForTheDecoder)
      if (const auto found = fields_.find(tag); found != fields_.end())
        entries += found->second.entry, ++count;
    big_ ? put(directory, std::uint64_t(count)) : put(directory, count);
    directory += entries;
    put_word(directory, 0);  // there is no other
    const std::size_t head_bytes = head.size();
    header_.add_made(std::move(head), header_.parts);
    header_.parts.push_back(bytes_.substr(head_bytes));
    header_.add_made(std::move(directory), header_.parts);
  }

  std::string_view bytes_;
  std::endian order_;
  bool big_ = false;
  std::map<std::uint16_t, Field> fields_;
  std::uint64_t samples_ = 0, pixel_bytes_ = 0;
  Header header_;
};

}  // namespace

Expected<Header> tiff_header(std::string_view bytes) {
  return Tiff(bytes).run();
}

}  // namespace kiln::image
