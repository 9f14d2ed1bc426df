// TIFF files as sky maps, written here byte by byte; and what is no picture for us.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>

#include "baker/image/image.h"

namespace kiln::image {
namespace {

constexpr std::uint32_t kSkyWidth = 6, kSkyHeight = 3;

float value(std::uint32_t x, std::uint32_t y, std::uint32_t channel) {
  return 0.25f * float(x) + 8 * float(y) + 1000 * float(channel);
}

/// A TIFF file of one strip of floats.
struct Tiff {
  bool big_endian = false;
  std::uint32_t width = kSkyWidth, height = kSkyHeight, bits = 32, format = 3, samples = 3;
  std::uint32_t compression = 1, orientation = 1;
  bool has_extras = false;  ///< a profile and a next directory, both beyond the file
  std::vector<std::pair<std::uint32_t, std::uint32_t>> primaries{};

  std::string number(std::uint64_t v, int bytes) const {
    std::string out;
    for (int i = 0; i < bytes; ++i) out += char(v >> 8 * (big_endian ? bytes - 1 - i : i));
    return out;
  }
  std::string bytes() const {
    std::string file = (big_endian ? "MM" : "II") + number(42, 2) + number(0, 4);
    const std::size_t strip = file.size();
    for (std::uint32_t y = 0; y < kSkyHeight; ++y)
      for (std::uint32_t x = 0; x < kSkyWidth; ++x)
        for (std::uint32_t c = 0; c < 3; ++c)
          file += number(std::bit_cast<std::uint32_t>(value(x, y, c)), 4);
    const std::size_t strip_bytes = file.size() - strip, rationals = file.size();
    for (const auto& [above, below] : primaries) file += number(above, 4) + number(below, 4);
    const std::size_t arrays = file.size();
    for (const std::uint32_t v : {bits, bits, bits, format, format, format}) file += number(v, 2);
    const auto field = [&](std::uint32_t tag, std::uint32_t type, std::uint64_t count,
                           std::uint64_t v) {
      const bool is_short = type == 3 && count == 1;
      return number(tag, 2) + number(type, 2) + number(count, 4) +
             (is_short ? number(v, 2) + number(0, 2) : number(v, 4));
    };
    std::vector<std::string> fields{field(256, 4, 1, width),       field(257, 4, 1, height),
                                    field(258, 3, 3, arrays),      field(259, 3, 1, compression),
                                    field(262, 3, 1, 2),           field(273, 4, 1, strip),
                                    field(274, 3, 1, orientation), field(277, 3, 1, samples),
                                    field(278, 4, 1, height),      field(279, 4, 1, strip_bytes)};
    if (!primaries.empty()) fields.push_back(field(318, 5, 2, rationals));
    if (!primaries.empty()) fields.push_back(field(319, 5, 6, rationals + 16));
    fields.push_back(field(339, 3, 3, arrays + 6));
    if (has_extras) fields.push_back(field(34675, 7, 1000, 0xfffffff0u));
    const std::size_t directory = file.size();
    file.replace(4, 4, number(directory, 4));
    file += number(fields.size(), 2);
    for (const std::string& f : fields) file += f;
    return file + number(has_extras ? 0xfffffff0u : 0, 4);
  }
};

TEST(TiffSky, BothByteOrdersAndWithoutWhatIsNoPixel) {
  for (const bool big_endian : {false, true})
    for (const bool has_extras : {false, true}) {
      const std::string file = Tiff{.big_endian = big_endian, .has_extras = has_extras}.bytes();
      ASSERT_EQ(format_of(file), Format::kTiff);
      auto header = read_header(file);
      ASSERT_TRUE(header) << header.error().message;
      EXPECT_EQ(header->flaw, "");
      ASSERT_EQ(header->size.width, kSkyWidth);
      ASSERT_EQ(header->size.height, kSkyHeight);
      EXPECT_FALSE(header->primaries);
      std::vector<math::Rgb> rgb(kSkyWidth * kSkyHeight);
      std::vector<float> alpha(rgb.size());
      const auto decoded = decode_rgb(*header, rgb, alpha, {});
      ASSERT_TRUE(decoded) << decoded.error().message;
      for (std::uint32_t i = 0; i < rgb.size(); ++i) {
        const std::uint32_t x = i % kSkyWidth, y = i / kSkyWidth;
        EXPECT_EQ(rgb[i], (math::Rgb{value(x, y, 0), value(x, y, 1), value(x, y, 2)}));
        EXPECT_EQ(alpha[i], 1);
      }
    }
}

TEST(TiffSky, ItsPrimariesAreRead) {
  Tiff tiff;
  for (const std::uint32_t v : {32168, 33767, 71300, 29300, 16500, 83000, 12800, 4400})
    tiff.primaries.emplace_back(v, 100'000);
  const std::string file = tiff.bytes();
  const auto header = read_header(file);
  ASSERT_TRUE(header) << header.error().message;
  ASSERT_TRUE(header->primaries);
  EXPECT_FLOAT_EQ(header->primaries->white[0], 0.32168f);
  EXPECT_FLOAT_EQ(header->primaries->red[0], 0.713f);
  EXPECT_FLOAT_EQ(header->primaries->blue[1], 0.044f);
  tiff.primaries[0].second = 0;
  const std::string odd = tiff.bytes();
  const auto infinite = read_header(odd);
  ASSERT_TRUE(infinite);
  EXPECT_FALSE(std::isfinite(infinite->primaries->white[0]));
}

TEST(TiffSky, WhatIsNoRadianceIsRefused) {
  const std::pair<Tiff, const char*> cases[] = {
      {{.bits = 8, .format = 1}, "neither half nor float"},
      {{.bits = 16, .format = 1}, "neither half nor float"},
      {{.bits = 64}, "neither half nor float"},
      {{.samples = 1}, "not R, G and B"},
      {{.compression = 7}, "compression"},
      {{.compression = 34677}, "compression"},
      {{.orientation = 3}, "from the top"}};
  for (const auto& [tiff, words] : cases) {
    const std::string file = tiff.bytes();
    const auto header = read_header(file);
    ASSERT_FALSE(header) << words;
    EXPECT_EQ(header.error().code, "invalid_image");
    EXPECT_NE(header.error().message.find(words), std::string::npos) << header.error().message;
  }
}

TEST(TiffSky, SizesBeyondTheFileTakeNoMemory) {
  for (const auto& [width, height] :
       {std::pair(1u << 30, 1u << 29), std::pair(0xffffffffu, 0xffffffffu), std::pair(0u, 0u)}) {
    const std::string file = Tiff{.width = width, .height = height}.bytes();
    const auto header = read_header(file);
    EXPECT_FALSE(header && width > 0 && header->flaw.empty()) << width;
  }
  const std::string file = Tiff{}.bytes();
  constexpr std::size_t kNextPlace = 4;  // of a directory that is not looked at
  for (std::size_t n = 8; n < file.size() - kNextPlace; ++n) {
    auto header = read_header(std::string_view(file).substr(0, n));
    EXPECT_FALSE(header && header->flaw.empty()) << n;
  }
}

TEST(Formats, OthersOfTheLibraryAreNotReached) {
  for (const std::string_view file :
       {std::string_view("BM\x36\0\0\0\0\0\0\0\x36\0\0\0", 14), std::string_view("GIF89a\1\0\1\0"),
        std::string_view("8BPS\0\1\0\0\0\0\0\0\0\3", 14), std::string_view("DDS \x7c\0\0\0", 8),
        std::string_view("\0\0\2\0\0\0\0\0\0\0\0\0\1\0\1\0\x18\0TRUEVISION-XFILE.\0", 36),
        std::string_view("P6 1 1 255\nabc"), std::string_view("\0\0\0\fjP  \r\n\x87\n", 12),
        std::string_view("\0\0\0\x1c"
                         "ftypheic",
                         12),
        std::string_view("SIMPLE  =  T"), std::string_view("RIFF\x10\0\0\0WAVE", 12),
        std::string_view("")})
    EXPECT_FALSE(format_of(file)) << file;
}

}  // namespace
}  // namespace kiln::image
