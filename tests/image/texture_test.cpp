// PNG, JPEG and WebP bytes to texels, against what was encoded.
#include "baker/image/image.h"

#include <gtest/gtest.h>
#include <png.h>
#include <webp/encode.h>

#include <cmath>
#include <cstdlib>
#include <functional>
#include <vector>

#include "tests/support/jpeg_file.h"

namespace kiln::image {
namespace {

constexpr std::uint32_t kWidth = 61, kHeight = 47;  // no multiple of a block

using Pixels = std::vector<std::array<std::uint8_t, 4>>;

/// A smooth picture, so that little is lost to JPEG.
std::uint8_t shade(std::uint32_t x, std::uint32_t y, std::uint32_t channel) {
  const float phase = 0.05f * float(x) + 0.03f * float(y) + 2 * float(channel);
  return std::uint8_t(std::lround(128 + 100 * std::sin(phase)));
}

std::vector<std::uint8_t> picture(std::uint32_t channels) {
  std::vector<std::uint8_t> samples;
  for (std::uint32_t y = 0; y < kHeight; ++y)
    for (std::uint32_t x = 0; x < kWidth; ++x)
      for (std::uint32_t c = 0; c < channels; ++c) samples.push_back(shade(x, y, c));
  return samples;
}

std::string encode_jpeg(J_COLOR_SPACE color_space = JCS_RGB, int channels = 3,
                        bool progressive = false) {
  return test::jpeg_file({kWidth, kHeight, color_space, channels, 98, progressive},
                         picture(std::uint32_t(channels)));
}

void append(png_structp png, png_bytep data, std::size_t count) {
  static_cast<std::string*>(png_get_io_ptr(png))->append(reinterpret_cast<char*>(data), count);
}

std::string encode_interlaced_png(const std::vector<std::uint8_t>& rgb) {
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  std::string file;
  png_set_write_fn(png, &file, append, nullptr);
  png_set_IHDR(png, info, kWidth, kHeight, 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_ADAM7,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  std::vector<png_bytep> rows;
  for (std::uint32_t y = 0; y < kHeight; ++y)
    rows.push_back(const_cast<png_bytep>(&rgb[std::size_t(y) * kWidth * 3]));
  png_write_info(png, info);
  png_write_image(png, rows.data());
  png_write_end(png, nullptr);
  png_destroy_write_struct(&png, &info);
  return file;
}

/// A PNG of kWidth x 1 pixels that are palette entries 0, 1, 2, 0, 1, 2, ...
std::string encode_palette_png() {
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  std::string file;
  png_set_write_fn(png, &file, append, nullptr);
  png_set_IHDR(png, info, kWidth, 1, 8, PNG_COLOR_TYPE_PALETTE, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  const png_color colors[3] = {{10, 20, 30}, {40, 50, 60}, {70, 80, 90}};
  const png_byte alphas[2] = {7, 200};  // the third has none: opaque
  png_set_PLTE(png, info, colors, 3);
  png_set_tRNS(png, info, alphas, 2, nullptr);
  png_set_gAMA(png, info, 1.0);  // stored codes are kept all the same
  png_write_info(png, info);
  std::vector<png_byte> row;
  for (std::uint32_t x = 0; x < kWidth; ++x) row.push_back(png_byte(x % 3));
  png_write_row(png, row.data());
  png_write_end(png, nullptr);
  png_destroy_write_struct(&png, &info);
  return file;
}

/// Decodes into texels of the size that the header says.
proto::Expected<std::string> decode(std::string_view file, Pixels& texels,
                                    const std::stop_token& stop = {}) {
  const auto header = read_header(file);
  if (!header) return proto::Unexpected(header.error());
  texels.resize(std::size_t(header->size.width) * header->size.height);
  return decode_rgba8(*header, texels, stop);
}

/// The texels of a whole image.
Pixels decoded(const std::string& file, Size expected = {kWidth, kHeight}) {
  const auto header = read_header(file);
  EXPECT_TRUE(header);
  EXPECT_EQ(header->size.width, expected.width);
  EXPECT_EQ(header->size.height, expected.height);
  Pixels texels;
  const auto damage = decode(file, texels);
  EXPECT_EQ(damage ? *damage : damage.error().message, "");
  return texels;
}

/// `value(x, y, channel)` of RGB within `tolerance`, and opaque.
void expect_picture(const Pixels& texels, int tolerance,
                    const std::function<int(std::uint32_t, std::uint32_t, std::uint32_t)>& value) {
  for (std::uint32_t y = 0; y < kHeight; ++y) {
    for (std::uint32_t x = 0; x < kWidth; ++x) {
      const auto& texel = texels[std::size_t(y) * kWidth + x];
      for (std::uint32_t c = 0; c < 3; ++c)
        ASSERT_NEAR(texel[c], value(x, y, c), tolerance) << x << " " << y << " " << c;
      ASSERT_EQ(texel[3], 255);
    }
  }
}

// At quality 98 the coarsest step of the tables is 5: half of it, with the rounding of two color
// conversions and half the chroma samples.
constexpr int kJpegLoss = 6;

TEST(Textures, JpegInColorAndGrayBaselineAndProgressive) {
  for (const bool progressive : {false, true}) {
    expect_picture(decoded(encode_jpeg(JCS_RGB, 3, progressive)), kJpegLoss, shade);
    expect_picture(decoded(encode_jpeg(JCS_GRAYSCALE, 1, progressive)), kJpegLoss,
                   [](auto x, auto y, auto) { return shade(x, y, 0); });
  }
}

TEST(Textures, JpegOfInvertedInks) {
  const auto expected = [](auto x, auto y, auto c) {
    return int(std::lround(shade(x, y, c) * shade(x, y, 3) / 255.0));
  };
  expect_picture(decoded(encode_jpeg(JCS_CMYK, 4, false)), 2 * kJpegLoss, expected);
  expect_picture(decoded(encode_jpeg(JCS_CMYK, 4, true)), 2 * kJpegLoss, expected);
}

TEST(Textures, JpegThatEndsEarlySaysSo) {
  const std::string file = encode_jpeg();
  Pixels texels;
  const std::string cut = file.substr(0, file.size() * 3 / 4);
  const auto damage = decode(cut, texels);
  ASSERT_TRUE(damage) << damage.error().message;
  EXPECT_NE(*damage, "");
  EXPECT_NEAR(texels[0][0], shade(0, 0, 0), kJpegLoss);  // what came is kept
}

TEST(Textures, JpegWithoutTablesIsAnError) {
  const std::string file = encode_jpeg();
  const std::size_t frame = file.find("\xff\xc0");
  ASSERT_NE(frame, std::string::npos);
  const std::string bare = "\xff\xd8" + file.substr(frame);
  Pixels texels;
  const auto damage = decode(bare, texels);
  ASSERT_FALSE(damage);
  EXPECT_EQ(damage.error().code, "invalid_image");
  EXPECT_NE(damage.error().message, "");
}

TEST(Textures, EachScanOfAJpegCostsSoTheirNumberIsLimited) {
  const std::string file = encode_jpeg(JCS_GRAYSCALE, 1, true);
  // The last scan, from its marker to the end of the image, once more and again.
  const std::size_t scan = file.rfind("\xff\xda"), end = file.size() - 2;
  std::string long_file = file.substr(0, end);
  for (int i = 0; i < 600; ++i) long_file += file.substr(scan, end - scan);
  long_file += "\xff\xd9";
  Pixels texels;
  const auto damage = decode(long_file, texels);
  ASSERT_FALSE(damage);
  EXPECT_EQ(damage.error().code, "invalid_image");
  EXPECT_EQ(damage.error().message, "it has over 500 scans");
}

TEST(Textures, InterlacedPng) {
  expect_picture(decoded(encode_interlaced_png(picture(3))), 0, shade);
}

TEST(Textures, PngPaletteWithTransparency) {
  const Pixels texels = decoded(encode_palette_png(), {kWidth, 1});
  EXPECT_EQ(texels[0], (Texels::value_type{10, 20, 30, 7}));
  EXPECT_EQ(texels[1], (Texels::value_type{40, 50, 60, 200}));
  EXPECT_EQ(texels[2], (Texels::value_type{70, 80, 90, 255}));
  EXPECT_EQ(texels[60], (Texels::value_type{10, 20, 30, 7}));
}

/// @param quality of a lossy picture; 0: lossless
std::string encode_webp(const std::vector<std::uint8_t>& rgba, float quality = 0) {
  std::uint8_t* bytes = nullptr;
  const std::size_t size =
      quality > 0 ? WebPEncodeRGBA(rgba.data(), kWidth, kHeight, 4 * kWidth, quality, &bytes)
                  : WebPEncodeLosslessRGBA(rgba.data(), kWidth, kHeight, 4 * kWidth, &bytes);
  std::string file(reinterpret_cast<const char*>(bytes), size);
  WebPFree(bytes);
  return file;
}

std::vector<std::uint8_t> opaque_picture() {
  std::vector<std::uint8_t> rgba = picture(4);
  for (std::size_t i = 3; i < rgba.size(); i += 4) rgba[i] = 255;
  return rgba;
}

TEST(Textures, WebpLosslessAndLossy) {
  expect_picture(decoded(encode_webp(opaque_picture())), 0, shade);
  expect_picture(decoded(encode_webp(opaque_picture(), 98)), 12, shade);
  // Alpha of both; colors are not multiplied by it.
  std::vector<std::uint8_t> rgba = picture(4);
  for (const float quality : {0.f, 98.f}) {
    const Pixels texels = decoded(encode_webp(rgba, quality));
    for (std::size_t i = 0; i < texels.size(); ++i) {
      ASSERT_EQ(texels[i][3], rgba[4 * i + 3]);
      ASSERT_NEAR(texels[i][0], rgba[4 * i], quality > 0 ? 12 : 0);
    }
  }
}

TEST(Textures, WebpThatIsBrokenIsAnError) {
  for (const float quality : {0.f, 80.f}) {
    const std::string file = encode_webp(picture(4), quality);
    Pixels texels;
    std::uint32_t random = 1, refused = 0;
    for (std::size_t n = 30; n < file.size(); n += 7) {
      const std::vector<char> exact(file.begin(), file.begin() + std::ptrdiff_t(n));
      const auto cut = decode({exact.data(), n}, texels);
      ASSERT_FALSE(cut) << n;
      EXPECT_EQ(cut.error().code, "invalid_image");
      EXPECT_NE(cut.error().message, "");
    }
    for (int i = 0; i < 500; ++i) {
      std::string flipped = file;
      random = random * 1664525 + 1013904223;
      flipped[30 + (random >> 8) % (file.size() - 30)] ^= char(1 << (random & 7));
      refused += !decode(flipped, texels);
    }
    EXPECT_GT(refused, 0u);
  }
  EXPECT_FALSE(read_header(std::string_view("RIFF\x20\0\0\0WEBPVP8 nothing", 23)));
  // Animated: the flag of the extended header.
  std::string animated("RIFF\x16\0\0\0WEBPVP8X\x0a\0\0\0\x02\0\0\0\x3c\0\0\x2e\0\0", 30);
  Pixels texels;
  const auto refused = decode(animated, texels);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().message, "it is animated");
}

TEST(Textures, ASizeThatIsDeclaredTwiceWritesNothing) {
  // A second frame header; the library reads the last.
  std::string file = encode_jpeg();
  const std::size_t frame = file.find("\xff\xc0");
  std::string other = file.substr(frame, 19);
  other[6] = 8;  // rows
  file.insert(frame + 19, other);
  Pixels texels;
  EXPECT_FALSE(decode(file, texels));
}

TEST(Textures, StopRequestEndsAll) {
  std::stop_source stop;
  stop.request_stop();
  Pixels texels;
  for (const std::string& file :
       {encode_jpeg(JCS_RGB, 3, false), encode_jpeg(JCS_RGB, 3, true),
        encode_interlaced_png(picture(3)), encode_palette_png(), encode_webp(picture(4))}) {
    const auto decoded = decode(file, texels, stop.get_token());
    ASSERT_FALSE(decoded);
    EXPECT_EQ(decoded.error().code, proto::kCanceledCode);
  }
}

std::string big_endian(std::uint32_t value) {
  std::string out;
  for (int shift = 24; shift >= 0; shift -= 8) out += char(value >> shift);
  return out;
}

// Their parsers are no fit place for bytes from outside.
TEST(Textures, ProfilesTextAndThumbnailsAreLeftOut) {
  const std::string secret = "not for parsers";
  std::string jpeg = encode_jpeg(JCS_RGB, 3, true);
  const Pixels plain = decoded(jpeg);
  for (const char* segment : {"\xff\xe1", "\xff\xe2", "\xff\xed", "\xff\xfe"})
    for (const std::size_t at : {jpeg.rfind("\xff\xda"), std::size_t(2)})
      jpeg.insert(at, segment + std::string(1, '\0') + char(2 + secret.size()) + secret);
  std::string png = encode_interlaced_png(picture(3));
  for (const char* type : {"iCCP", "zTXt", "eXIf", "tIME"})
    png.insert(33, big_endian(std::uint32_t(secret.size())) + type + secret + "crc!");
  for (const std::string* file : {&jpeg, &png}) {
    const auto header = read_header(*file);
    ASSERT_TRUE(header);
    for (const std::string_view part : header->parts)
      EXPECT_EQ(part.find(secret), std::string_view::npos);
  }
  EXPECT_EQ(decoded(jpeg), plain);
  expect_picture(decoded(png), 0, shade);
}

TEST(Textures, SixteenBitsAreRounded) {
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  std::string file;
  png_set_write_fn(png, &file, append, nullptr);
  constexpr std::uint32_t kSide = 256;
  png_set_IHDR(png, info, kSide, kSide, 16, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, info);
  for (std::uint32_t y = 0; y < kSide; ++y) {
    std::vector<png_byte> row;
    for (std::uint32_t x = 0; x < kSide; ++x) row.insert(row.end(), {png_byte(y), png_byte(x)});
    png_write_row(png, row.data());
  }
  png_write_end(png, nullptr);
  png_destroy_write_struct(&png, &info);
  const Pixels texels = decoded(file, {kSide, kSide});
  for (std::uint32_t v = 0; v < kSide * kSide; ++v)
    ASSERT_EQ(texels[v][0], std::lround(v / 257.0)) << v;  // never half way: 257 is odd
}

}  // namespace
}  // namespace kiln::image
