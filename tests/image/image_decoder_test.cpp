// PNG, JPEG and WebP bytes to texels, against what was encoded.
#include "baker/image/image_decoder.h"

#include <gtest/gtest.h>
#include <png.h>
#include <webp/encode.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <vector>

#include <jpeglib.h>  // after <cstdio>: it names FILE

namespace kiln::image {
namespace {

constexpr std::uint32_t kWidth = 61, kHeight = 47;  // no multiple of a block

using Texels = std::vector<std::array<std::uint8_t, 4>>;

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

struct JpegOptions {
  J_COLOR_SPACE samples = JCS_RGB;
  int channels = 3;
  bool progressive = false;
};

std::string encode_jpeg(const JpegOptions& options) {
  jpeg_compress_struct jpeg{};
  jpeg_error_mgr errors{};
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&jpeg, &bytes, &size);
  jpeg.image_width = kWidth;
  jpeg.image_height = kHeight;
  jpeg.input_components = options.channels;
  jpeg.in_color_space = options.samples;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, 98, TRUE);
  if (options.progressive) jpeg_simple_progression(&jpeg);
  jpeg_start_compress(&jpeg, TRUE);
  std::vector<std::uint8_t> samples = picture(std::uint32_t(options.channels));
  for (std::uint32_t y = 0; y < kHeight; ++y) {
    JSAMPROW row = &samples[std::size_t(y) * kWidth * std::size_t(options.channels)];
    jpeg_write_scanlines(&jpeg, &row, 1);
  }
  jpeg_finish_compress(&jpeg);
  jpeg_destroy_compress(&jpeg);
  std::string file(reinterpret_cast<const char*>(bytes), size);
  std::free(bytes);
  return file;
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
  const png_color colours[3] = {{10, 20, 30}, {40, 50, 60}, {70, 80, 90}};
  const png_byte alphas[2] = {7, 200};  // the third has none: opaque
  png_set_PLTE(png, info, colours, 3);
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

/// The texels of a whole image.
Texels decoded(const std::string& file, ImageSize expected = {kWidth, kHeight}) {
  const auto size = is_png(file) ? png_size(file) : jpeg_size(file);
  EXPECT_TRUE(size);
  EXPECT_EQ(size->width, expected.width);
  EXPECT_EQ(size->height, expected.height);
  Texels texels(std::size_t(expected.width) * expected.height);
  const auto damage = (is_png(file) ? decode_png : decode_jpeg)(file, expected, texels, {});
  EXPECT_EQ(damage ? *damage : damage.error().message, "");
  return texels;
}

/// `value(x, y, channel)` of RGB within `tolerance`, and opaque.
void expect_picture(const Texels& texels, int tolerance,
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

// At quality 98 the coarsest step of the tables is 5: half of it, with the rounding of two colour
// conversions and half the chroma samples.
constexpr int kJpegLoss = 6;

TEST(ImageDecoder, JpegInColourAndGreyBaselineAndProgressive) {
  for (const bool progressive : {false, true}) {
    expect_picture(decoded(encode_jpeg({JCS_RGB, 3, progressive})), kJpegLoss, shade);
    expect_picture(decoded(encode_jpeg({JCS_GRAYSCALE, 1, progressive})), kJpegLoss,
                   [](auto x, auto y, auto) { return shade(x, y, 0); });
  }
}

TEST(ImageDecoder, JpegOfInvertedInks) {
  const auto expected = [](auto x, auto y, auto c) {
    return int(std::lround(shade(x, y, c) * shade(x, y, 3) / 255.0));
  };
  expect_picture(decoded(encode_jpeg({JCS_CMYK, 4, false})), 2 * kJpegLoss, expected);
  expect_picture(decoded(encode_jpeg({JCS_CMYK, 4, true})), 2 * kJpegLoss, expected);
}

TEST(ImageDecoder, JpegThatEndsEarlySaysSo) {
  const std::string file = encode_jpeg({});
  Texels texels(std::size_t(kWidth) * kHeight);
  const auto damage =
      decode_jpeg(file.substr(0, file.size() * 3 / 4), {kWidth, kHeight}, texels, {});
  ASSERT_TRUE(damage) << damage.error().message;
  EXPECT_NE(*damage, "");
  EXPECT_NEAR(texels[0][0], shade(0, 0, 0), kJpegLoss);  // what came is kept
}

TEST(ImageDecoder, JpegWithoutTablesIsAnError) {
  const std::string file = encode_jpeg({});
  const std::size_t frame = file.find("\xff\xc0");
  ASSERT_NE(frame, std::string::npos);
  const std::string bare = "\xff\xd8" + file.substr(frame);
  Texels texels(std::size_t(kWidth) * kHeight);
  const auto damage = decode_jpeg(bare, {kWidth, kHeight}, texels, {});
  ASSERT_FALSE(damage);
  EXPECT_EQ(damage.error().code, "invalid_image");
  EXPECT_NE(damage.error().message, "");
}

TEST(ImageDecoder, EachScanOfAJpegCostsSoTheirNumberIsLimited) {
  const std::string file = encode_jpeg({JCS_GRAYSCALE, 1, true});
  // The last scan, from its marker to the end of the image, once more and again.
  const std::size_t scan = file.rfind("\xff\xda"), end = file.size() - 2;
  std::string long_file = file.substr(0, end);
  for (int i = 0; i < 600; ++i) long_file += file.substr(scan, end - scan);
  Texels texels(std::size_t(kWidth) * kHeight);
  const auto damage = decode_jpeg(long_file + "\xff\xd9", {kWidth, kHeight}, texels, {});
  ASSERT_FALSE(damage);
  EXPECT_EQ(damage.error().code, "invalid_image");
  EXPECT_EQ(damage.error().message, "it has over 500 scans");
}

TEST(ImageDecoder, InterlacedPng) {
  expect_picture(decoded(encode_interlaced_png(picture(3))), 0, shade);
}

TEST(ImageDecoder, PngPaletteWithTransparency) {
  const Texels texels = decoded(encode_palette_png(), {kWidth, 1});
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

Texels decoded_webp(const std::string& file) {
  const ImageSize size{kWidth, kHeight};
  EXPECT_TRUE(is_webp(file));
  EXPECT_EQ(webp_size(file).value_or(ImageSize{}).width, kWidth);
  EXPECT_EQ(webp_size(file).value_or(ImageSize{}).height, kHeight);
  Texels texels(std::size_t(kWidth) * kHeight);
  const auto damage = decode_webp(file, size, texels, {});
  EXPECT_EQ(damage ? *damage : damage.error().message, "");
  return texels;
}

TEST(ImageDecoder, WebpLosslessAndLossy) {
  expect_picture(decoded_webp(encode_webp(opaque_picture())), 0, shade);
  expect_picture(decoded_webp(encode_webp(opaque_picture(), 98)), 12, shade);
  // Alpha of both; colours are not multiplied by it.
  std::vector<std::uint8_t> rgba = picture(4);
  for (const float quality : {0.f, 98.f}) {
    const Texels texels = decoded_webp(encode_webp(rgba, quality));
    for (std::size_t i = 0; i < texels.size(); ++i) {
      ASSERT_EQ(texels[i][3], rgba[4 * i + 3]);
      ASSERT_NEAR(texels[i][0], rgba[4 * i], quality > 0 ? 12 : 0);
    }
  }
}

TEST(ImageDecoder, WebpThatIsBrokenIsAnError) {
  for (const float quality : {0.f, 80.f}) {
    const std::string file = encode_webp(picture(4), quality);
    Texels texels(std::size_t(kWidth) * kHeight);
    std::uint32_t random = 1, refused = 0;
    for (std::size_t n = 30; n < file.size(); n += 7) {
      const std::vector<char> exact(file.begin(), file.begin() + std::ptrdiff_t(n));
      const auto cut = decode_webp({exact.data(), n}, {kWidth, kHeight}, texels, {});
      ASSERT_FALSE(cut) << n;
      EXPECT_EQ(cut.error().code, "invalid_image");
      EXPECT_NE(cut.error().message, "");
    }
    for (int i = 0; i < 500; ++i) {
      std::string flipped = file;
      random = random * 1664525 + 1013904223;
      flipped[30 + (random >> 8) % (file.size() - 30)] ^= char(1 << (random & 7));
      refused += !decode_webp(flipped, {kWidth, kHeight}, texels, {});
    }
    EXPECT_GT(refused, 0u);
  }
  EXPECT_FALSE(webp_size("RIFF\x20\0\0\0WEBPVP8 nothing"));
  // Animated: the flag of the extended header.
  std::string animated("RIFF\x16\0\0\0WEBPVP8X\x0a\0\0\0\x02\0\0\0\x3c\0\0\x2e\0\0", 30);
  Texels texels(std::size_t(kWidth) * kHeight);
  const auto refused = decode_webp(animated, {kWidth, kHeight}, texels, {});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().message, "it is animated");
}

TEST(ImageDecoder, AHeaderThatIsNotTheDeclaredOneWritesNothing) {
  const std::string file = encode_webp(picture(4));
  Texels texels(std::size_t(kWidth) * kHeight / 4);
  EXPECT_FALSE(decode_webp(file, {kWidth / 2, kHeight / 2}, texels, {}));
}

TEST(ImageDecoder, StopRequestEndsAll) {
  std::stop_source stop;
  stop.request_stop();
  Texels texels(std::size_t(kWidth) * kHeight);
  const ImageSize size{kWidth, kHeight};
  for (const bool progressive : {false, true}) {
    const auto jpeg =
        decode_jpeg(encode_jpeg({JCS_RGB, 3, progressive}), size, texels, stop.get_token());
    ASSERT_FALSE(jpeg);
    EXPECT_EQ(jpeg.error().code, proto::kCanceledCode);
  }
  const auto png = decode_png(encode_interlaced_png(picture(3)), size, texels, stop.get_token());
  ASSERT_FALSE(png);
  EXPECT_EQ(png.error().code, proto::kCanceledCode);
  const auto webp = decode_webp(encode_webp(picture(4)), size, texels, stop.get_token());
  ASSERT_FALSE(webp);
  EXPECT_EQ(webp.error().code, proto::kCanceledCode);
}

}  // namespace
}  // namespace kiln::image
