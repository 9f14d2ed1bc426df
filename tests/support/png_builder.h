#pragma once

#include <array>
#include <cstdint>
#include <string>

namespace kiln::test {

/// A PNG file from raw scanline bytes, stored without compression, of any depth and color type:
/// what image libraries write for us is never odd enough.
class PngBuilder {
 public:
  /// @param rows height times the bytes of one row, without filter bytes
  static std::string encode(std::uint32_t width, std::uint32_t height, int bit_depth,
                            int color_type, const std::string& rows) {
    const std::size_t stride = rows.size() / height;
    std::string raw;
    for (std::uint32_t y = 0; y < height; ++y) raw += '\0' + rows.substr(y * stride, stride);
    return from_stream(width, height, bit_depth, color_type, zlib(raw));
  }

  /// @param stream scanlines with their filter bytes, as zlib compressed them
  static std::string from_stream(std::uint32_t width, std::uint32_t height, int bit_depth,
                                 int color_type, const std::string& stream) {
    std::string header = be32(width) + be32(height);
    header += {static_cast<char>(bit_depth), static_cast<char>(color_type), 0, 0, 0};
    return "\x89PNG\r\n\x1a\n" + chunk("IHDR", header) + chunk("IDAT", stream) + chunk("IEND", "");
  }

 private:
  static std::string be32(std::uint32_t v) {
    return {static_cast<char>(v >> 24), static_cast<char>(v >> 16), static_cast<char>(v >> 8),
            static_cast<char>(v)};
  }

  static std::string chunk(const std::string& type, const std::string& data) {
    std::uint32_t crc = 0xffffffffu;
    for (const char c : type + data) {
      crc ^= static_cast<unsigned char>(c);
      for (int k = 0; k < 8; ++k) crc = (crc & 1u) != 0 ? 0xedb88320u ^ crc >> 1 : crc >> 1;
    }
    return be32(static_cast<std::uint32_t>(data.size())) + type + data + be32(~crc);
  }

  /// One stored block: at most 65535 bytes.
  static std::string zlib(const std::string& raw) {
    std::uint32_t a = 1, b = 0;
    for (const char c : raw) {
      a = (a + static_cast<unsigned char>(c)) % 65521;
      b = (b + a) % 65521;
    }
    const auto n = static_cast<std::uint16_t>(raw.size());
    const auto m = static_cast<std::uint16_t>(~n);
    std::string out{'\x78', '\x01', '\x01'};
    out += {static_cast<char>(n), static_cast<char>(n >> 8), static_cast<char>(m),
            static_cast<char>(m >> 8)};
    return out + raw + be32(b << 16 | a);
  }
};

}  // namespace kiln::test
