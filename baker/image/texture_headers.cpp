// PNG, JPEG and WebP: this finds their sizes, and leaves out text, dates, thumbnails and profiles.
// No parser of those ever sees a byte from outside.
#include "baker/image/header.h"

#include "proto/bytes.h"

namespace kiln::image {
namespace {

using proto::Expected;

constexpr const char* kNoHeader = "its header can't be read";
/// Each scan of a progressive JPEG may cost a walk over the whole image.
constexpr int kMaxScans = 500;

/// Adds the piece of `file`, as one with the last if they touch.
void keep(std::vector<std::string_view>& parts, std::string_view piece) {
  if (!parts.empty() && parts.back().data() + parts.back().size() == piece.data())
    parts.back() = {parts.back().data(), parts.back().size() + piece.size()};
  else
    parts.push_back(piece);
}

std::uint8_t byte(std::string_view bytes, std::size_t at) {
  return static_cast<std::uint8_t>(bytes[at]);
}

/// Walks over the segments of a JPEG as libjpeg does, so that both find the same.
class JpegWalk {
 public:
  explicit JpegWalk(std::string_view bytes) : bytes_(bytes) {}

  Expected<Header> run() {
    header_.format = Format::kJpeg;
    keep(header_.parts, bytes_.substr(0, 2));
    for (at_ = 2; next_marker() && take_segment();) {
    }
    if (!sized_) return invalid_image(kNoHeader);
    if (scans_ > kMaxScans) header_.flaw = "it has over 500 scans";
    return std::move(header_);
  }

 private:
  /// At its second byte; bytes between segments mean nothing.
  bool next_marker() {
    for (;; ++at_) {
      at_ = bytes_.find('\xff', at_);
      if (at_ == std::string_view::npos) return false;
      at_ = bytes_.find_first_not_of('\xff', at_);
      if (at_ == std::string_view::npos) return false;
      const std::uint8_t m = byte(bytes_, at_);
      const bool stands_alone = m == 0 || m == 1 || (m >= 0xd0 && m <= 0xd7);
      if (!stands_alone) return true;
    }
  }

  /// Returns false at the end of the file.
  bool take_segment() {
    const std::size_t begin = at_ - 1;
    const std::uint8_t m = byte(bytes_, at_++);
    if (m == 0xd8 || m == 0xd9) {  // begin and end of the image
      keep(header_.parts, bytes_.substr(begin, 2));
      return m == 0xd8;
    }
    Cursor segment(bytes_.substr(at_), std::endian::big);
    const std::size_t length = std::max<std::size_t>(2, segment.value<std::uint16_t>());
    const bool is_frame = m >= 0xc0 && m <= 0xcf && m != 0xc4 && m != 0xc8 && m != 0xcc;
    if (is_frame && !sized_) read_frame(segment);
    // JFIF and Adobe say what the colors are; other applications' data and comments go.
    const bool is_kept = (m < 0xe0 || m > 0xef || m == 0xe0 || m == 0xee) && m != 0xfe;
    if (is_kept) keep(header_.parts, bytes_.substr(begin, length + 2));
    if (length > bytes_.size() - at_) return false;
    at_ += length;
    if (m == 0xda) take_scan();
    return true;
  }

  /// [ITU T.81, B.2.2]
  void read_frame(Cursor segment) {
    segment.bytes(1);
    header_.size.height = segment.value<std::uint16_t>();
    header_.size.width = segment.value<std::uint16_t>();
    sized_ = !segment.failed();
  }

  void take_scan() {
    ++scans_;
    const std::size_t begin = at_;
    std::size_t end = bytes_.size();
    for (; (at_ = bytes_.find('\xff', at_)) != std::string_view::npos; ++at_) {
      if (at_ + 1 == bytes_.size()) break;
      const std::uint8_t m = byte(bytes_, at_ + 1);
      if (m < 0xc0 || m == 0xff || (m >= 0xd0 && m <= 0xd7)) continue;  // data, or a restart
      end = at_;
      break;
    }
    at_ = end;
    keep(header_.parts, bytes_.substr(begin, end - begin));
  }

  std::string_view bytes_;
  std::size_t at_ = 0;
  int scans_ = 0;
  bool sized_ = false;
  Header header_;
};

std::string little_endian(std::uint32_t value, int bytes) {
  std::string out;
  for (int i = 0; i < bytes; ++i) out += static_cast<char>(value >> (8 * i));
  return out;
}

/// A chunk's name, length, content and padding.
struct Chunk {
  std::string_view name, content;
  bool whole = false;
};
Chunk take_chunk(Cursor& file) {
  Chunk chunk{file.bytes(4), {}};
  const auto length = file.value<std::uint32_t>();
  chunk.whole = !file.failed() && length <= file.left().size();
  chunk.content = file.left().substr(0, length);
  file.bytes(chunk.content.size());
  if (chunk.content.size() % 2 != 0 && !file.left().empty()) file.bytes(1);
  return chunk;
}

/// The chunks of the one picture of a WebP file [RFC 9649].
struct WebpPicture {
  std::string_view pixels, alpha;  ///< `alpha`: of a lossy one
  bool lossless = false, lossless_alpha = false;
  Size size;

  bool read_size() {
    if (lossless) {
      Cursor head(pixels.substr(0, 5));
      const bool signed_ok = head.value<std::uint8_t>() == 0x2f;
      const auto bits = head.value<std::uint32_t>();
      size = {(bits & 0x3fff) + 1, (bits >> 14 & 0x3fff) + 1};
      lossless_alpha = (bits >> 28 & 1) != 0;
      return !head.failed() && signed_ok && bits >> 29 == 0;
    }
    Cursor head(pixels);
    head.bytes(3);
    const bool signed_ok = head.bytes(3) == "\x9d\x01\x2a";
    const auto width = head.value<std::uint16_t>(), height = head.value<std::uint16_t>();
    size = {width & 0x3fffu, height & 0x3fffu};
    return !head.failed() && signed_ok && size.width > 0 && size.height > 0;
  }
};

/// A file of `chunks`, each a name, and pieces of its content.
void make_webp(
    Header& header, std::vector<std::string_view>& parts,
    const std::vector<std::pair<std::string_view, std::vector<std::string_view>>>& chunks) {
  parts.emplace_back();  // the file's head comes when its length is known
  std::uint32_t all = 4;
  for (const auto& [name, pieces] : chunks) {
    std::uint32_t length = 0;
    for (const auto piece : pieces) length += std::uint32_t(piece.size());
    header.add_made(std::string(name) + little_endian(length, 4), parts);
    parts.insert(parts.end(), pieces.begin(), pieces.end());
    if (length % 2 != 0) header.add_made(std::string(1, '\0'), parts);
    all += 8 + length + length % 2;
  }
  parts.front() = header.made.emplace_back("RIFF" + little_endian(all, 4) + "WEBP");
}

}  // namespace

Expected<Header> png_header(std::string_view bytes) {
  Header header;
  header.format = Format::kPng;
  Cursor file(bytes, std::endian::big);
  keep(header.parts, file.bytes(8));
  for (bool first = true;; first = false) {
    const std::string_view rest = file.left();
    const auto length = file.value<std::uint32_t>();
    const std::string_view type = file.bytes(4);
    const std::string_view content = file.bytes(length);
    file.bytes(4);  // its checksum
    if (first) {
      Cursor ihdr(rest.substr(0, 16), std::endian::big);
      ihdr.bytes(8);
      header.size = {ihdr.value<std::uint32_t>(), ihdr.value<std::uint32_t>()};
      if (ihdr.failed() || type != "IHDR") return invalid_image(kNoHeader);
    }
    if (file.failed()) break;
    const bool is_critical = (byte(type, 0) & 0x20) == 0;  // by its letter
    if (is_critical || type == "tRNS") keep(header.parts, rest.substr(0, content.size() + 12));
    if (type == "IEND") return header;
  }
  header.flaw = kEndsTooEarly;
  return header;
}

Expected<Header> jpeg_header(std::string_view bytes) {
  return JpegWalk(bytes).run();
}

Expected<Header> webp_header(std::string_view bytes) {
  Header header;
  header.format = Format::kWebp;
  Cursor file(bytes);
  file.bytes(12);
  WebpPicture picture;
  std::optional<Size> canvas;
  bool whole = false;
  while (picture.pixels.empty() && !file.left().empty()) {
    const Chunk chunk = take_chunk(file);
    if (chunk.name == "VP8X") {
      Cursor extended(chunk.content);
      const auto word = extended.value<std::uint32_t>();
      header.animated = (word & 2) != 0;
      const auto w = extended.bytes(3), h = extended.bytes(3);
      if (extended.failed()) return invalid_image(kNoHeader);
      const auto size = [](std::string_view b) {
        return 1u + static_cast<std::uint32_t>(proto::little_endian(b));
      };
      header.size = canvas.emplace(Size{size(w), size(h)});
      if (header.animated) break;
    } else if (chunk.name == "ALPH" && canvas) {
      picture.alpha = chunk.content;
    } else if (chunk.name == "VP8 " || chunk.name == "VP8L") {
      picture.pixels = chunk.content;
      picture.lossless = chunk.name == "VP8L";
      whole = chunk.whole;
      break;
    }
    if (!chunk.whole) break;
  }
  if (header.animated) {
    header.flaw = "it is animated";
    return header;
  }
  if (!picture.read_size()) return invalid_image(kNoHeader);
  if (canvas && (canvas->width != picture.size.width || canvas->height != picture.size.height))
    header.flaw = "its size is declared twice";
  header.size = picture.size;
  if (!whole) header.flaw = kEndsTooEarly;
  // The library multiplies colors by alpha where there is any: it reads them from a file without.
  const std::string_view p = picture.pixels;
  if (!picture.lossless) {
    make_webp(header, header.parts, {{"VP8 ", {p}}});
    if (picture.alpha.empty()) return header;
    std::string extended = little_endian(0x10, 4) + little_endian(picture.size.width - 1, 3) +
                           little_endian(picture.size.height - 1, 3);
    const std::string_view vp8x = header.made.emplace_back(std::move(extended));
    make_webp(header, header.alpha_parts,
              {{"VP8X", {vp8x}}, {"ALPH", {picture.alpha}}, {"VP8 ", {p}}});
  } else if (picture.lossless_alpha) {
    const std::string_view opaque =
        header.made.emplace_back(1, static_cast<char>(byte(p, 4) & ~0x10));
    make_webp(header, header.parts, {{"VP8L", {p.substr(0, 4), opaque, p.substr(5)}}});
    make_webp(header, header.alpha_parts, {{"VP8L", {p}}});
  } else {
    make_webp(header, header.parts, {{"VP8L", {p}}});
  }
  return header;
}

}  // namespace kiln::image
