#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <thread>

#include "baker/output/output.h"
#include "tests/support/temp_files.h"

namespace kiln::image {
namespace {

using test::read_bytes;
using test::TempFolder;

PageImage gradient(std::uint32_t width, std::uint32_t height) {
  PageImage image{width, height, {}, {}};
  for (std::uint32_t i = 0; i < width * height; ++i) {
    image.rgb.push_back({float(i % 2048), 0.25f * float(i % 512), 1000});
    image.coverage.push_back(i % 3 == 0 ? 0 : 0.01f);
  }
  return image;
}

const std::vector<std::pair<std::string, std::string>> kMetadata{{"lightkiln:units", "lux"}};

TEST(Exr, RoundTripIsExact) {
  const TempFolder folder;
  const PageImage image = gradient(130, 70);  // tiles of 64 are cut at both edges
  for (const auto precision : {proto::Precision::kHalf, proto::Precision::kFloat}) {
    const ExrLayer layer{"irradiance", &image};
    ASSERT_TRUE(write_exr(folder.path() / "a.exr", {&layer, 1}, precision, kMetadata));
    const auto back = read_exr(folder.path() / "a.exr");
    ASSERT_TRUE(back) << back.error().message;
    ASSERT_EQ(back->width, 130u);
    ASSERT_EQ(back->height, 70u);
    EXPECT_EQ(back->rgb, image.rgb);  // all values are halves
    for (std::size_t i = 0; i < image.rgb.size(); ++i)
      EXPECT_EQ(back->coverage[i], image.coverage[i] > 0 ? 1 : 0);
  }
}

TEST(Exr, FloatKeepsWhatHalfRounds) {
  const TempFolder folder;
  PageImage image{1, 1, {{0.1f, 70000, 1e-20f}}, {1}};
  const ExrLayer layer{"irradiance", &image};
  ASSERT_TRUE(write_exr(folder.path() / "a.exr", {&layer, 1}, proto::Precision::kFloat, {}));
  EXPECT_EQ(read_exr(folder.path() / "a.exr")->rgb, image.rgb);
}

TEST(Exr, SameBytesASecondLater) {
  const TempFolder folder;
  const PageImage image = gradient(100, 100), other = gradient(100, 100);
  const std::vector<ExrLayer> layers{{"irradiance", &image}, {"direct", &other}};
  ASSERT_TRUE(write_exr(folder.path() / "a.exr", layers, proto::Precision::kHalf, kMetadata));
  std::this_thread::sleep_for(std::chrono::milliseconds(1100));
  ASSERT_TRUE(write_exr(folder.path() / "b.exr", layers, proto::Precision::kHalf, kMetadata));
  const std::string a = test::read_bytes(folder.path() / "a.exr");
  EXPECT_EQ(a, test::read_bytes(folder.path() / "b.exr"));
  EXPECT_NE(a.find("lightkiln:units"), std::string::npos);
  EXPECT_NE(a.find("direct.R"), std::string::npos);
  EXPECT_EQ(a.find("capDate"), std::string::npos);
}

TEST(Exr, RefusesWhatThePrecisionCannotHold) {
  const TempFolder folder;
  const auto error_of = [&](float value, proto::Precision precision) {
    PageImage image{2, 2, {{}, {}, {}, {0, value, 0}}, {1, 1, 1, 1}};
    const ExrLayer layer{"irradiance", &image};
    const auto ok = write_exr(folder.path() / "a.exr", {&layer, 1}, precision, {});
    return ok ? "" : ok.error().code + ": " + ok.error().message;
  };
  const float inf = std::numeric_limits<float>::infinity();
  for (const float bad : {inf, -inf, std::nanf("")}) {
    const std::string error = error_of(bad, proto::Precision::kFloat);
    EXPECT_EQ(error.substr(0, 9), "internal:") << bad;
    EXPECT_NE(error.find("(1, 1)"), std::string::npos) << error;
  }
  EXPECT_NE(error_of(65505, proto::Precision::kHalf), "");
  EXPECT_EQ(error_of(65504, proto::Precision::kHalf), "");
  EXPECT_EQ(error_of(65505, proto::Precision::kFloat), "");
}

TEST(Exr, AMissingFolderIsAnIoError) {
  const TempFolder folder;
  const PageImage image = gradient(4, 4);
  const ExrLayer layer{"irradiance", &image};
  const auto ok =
      write_exr(folder.path() / "none" / "a.exr", {&layer, 1}, proto::Precision::kHalf, {});
  ASSERT_FALSE(ok);
  EXPECT_EQ(ok.error().code, "io_error");
}

TEST(Exr, StopsWhenTold) {
  const TempFolder folder;
  const PageImage image = gradient(70, 66);
  const ExrLayer layer{"irradiance", &image};
  std::stop_source stop;
  stop.request_stop();
  const auto ok = write_exr(folder.path() / "a.exr", {&layer, 1}, proto::Precision::kHalf, {},
                            stop.get_token());
  ASSERT_FALSE(ok);
  EXPECT_EQ(ok.error().code, proto::kCanceledCode);
}

std::string read_error(const std::filesystem::path& path) {
  const auto image = read_exr(path);
  return image ? "" : image.error().code;
}

TEST(Exr, EveryTruncationIsAnError) {
  const TempFolder folder;
  const PageImage image = gradient(70, 66);
  const ExrLayer layer{"irradiance", &image};
  ASSERT_TRUE(write_exr(folder.path() / "a.exr", {&layer, 1}, proto::Precision::kHalf, kMetadata));
  const std::string whole = test::read_bytes(folder.path() / "a.exr");
  for (std::size_t size = 0; size < whole.size(); size += 1 + size / 16) {
    std::ofstream(folder.path() / "cut.exr", std::ios::binary) << whole.substr(0, size);
    EXPECT_EQ(read_error(folder.path() / "cut.exr"), "invalid_image") << size;
  }
  EXPECT_EQ(read_error(folder.path() / "none.exr"), "invalid_image");
}

TEST(Exr, AHugeSizeIsRefusedBeforeMemoryIsTaken) {
  const TempFolder folder;
  const PageImage image = gradient(16, 16);
  const ExrLayer layer{"irradiance", &image};
  ASSERT_TRUE(write_exr(folder.path() / "a.exr", {&layer, 1}, proto::Precision::kHalf, {}));
  std::string bytes = test::read_bytes(folder.path() / "a.exr");
  const std::size_t window = bytes.find("dataWindow");
  ASSERT_NE(window, std::string::npos);
  const std::size_t max_x = window + sizeof("dataWindow") + sizeof("box2i") + 4 + 8;
  for (const char* side : {"\xFF\xFF\x01\x00", "\xFE\xFF\xFF\x7F", "\x00\x00\x00\x80"}) {
    bytes.replace(max_x, 4, side, 4);
    bytes.replace(max_x + 4, 4, side, 4);
    std::ofstream(folder.path() / "big.exr", std::ios::binary) << bytes;
    EXPECT_EQ(read_error(folder.path() / "big.exr"), "invalid_image");
  }
}

TEST(Exr, ReadsALayerByItsName) {
  const TempFolder folder;
  PageImage first = gradient(70, 66), other = first;
  for (math::Rgb& v : other.rgb) v = {v.g, 3, v.r};
  const std::vector<ExrLayer> layers{{"irradiance", &first}, {"direct", &other}};
  const std::vector<std::pair<std::string, std::string>> named{
      {"lightkiln:layers", "irradiance,direct"}};
  for (const auto precision : {proto::Precision::kHalf, proto::Precision::kFloat}) {
    ASSERT_TRUE(write_exr(folder.path() / "a.exr", layers, precision, named));
    for (const char* name : {"", "irradiance"})
      EXPECT_EQ(read_exr(folder.path() / "a.exr", name)->rgb, first.rgb) << name;
    const auto direct = read_exr(folder.path() / "a.exr", "direct");
    ASSERT_TRUE(direct) << direct.error().message;
    EXPECT_EQ(direct->rgb, other.rgb);
    EXPECT_EQ(direct->coverage, read_exr(folder.path() / "a.exr")->coverage);
  }
  for (const char* name : {"raw", "R", "direct.R", "direct,irradiance", "irradiance,direct"}) {
    const auto missing = read_exr(folder.path() / "a.exr", name);
    ASSERT_FALSE(missing) << name;
    EXPECT_EQ(missing.error().code, "invalid_image");
    EXPECT_NE(missing.error().message.find("its layers are irradiance, direct"), std::string::npos)
        << missing.error().message;
  }
  // A file of others does not say how R, G, B are called.
  ASSERT_TRUE(write_exr(folder.path() / "b.exr", layers, proto::Precision::kHalf, {}));
  EXPECT_EQ(read_exr(folder.path() / "b.exr", "direct")->rgb, other.rgb);
  EXPECT_FALSE(read_exr(folder.path() / "b.exr", "irradiance"));
}

TEST(Png, HoldsItsPixelsAndNoDate) {
  std::vector<std::array<std::uint8_t, 3>> pixels(20 * 10);
  for (std::size_t i = 0; i < pixels.size(); ++i) pixels[i] = {std::uint8_t(i), 7, 200};
  const auto png = encode_png(pixels, 20, 10);
  ASSERT_TRUE(png) << png.error().message;
  EXPECT_EQ(png->substr(0, 8), "\x89PNG\r\n\x1a\n");
  for (const char* chunk : {"tIME", "gAMA", "sRGB", "iCCP", "tEXt"})
    EXPECT_EQ(png->find(chunk), std::string::npos) << chunk;
  EXPECT_EQ(*encode_png(pixels, 20, 10), *png);
}

}  // namespace
}  // namespace kiln::image
