// Sky maps: two file formats in all the ways in which they store pixels, and what is wrong with
// files that are none.
#include <cmath>
#include <cstring>
#include <limits>

#include "tests/import/import_helpers.h"
#include "tests/support/sky_files.h"

namespace kiln::import {
namespace {

using test::ExrStorage;
using test::HdrRows;
using test::SkyPicture;

/// Numbers that half floats and RGBE of Radiance hold, with long runs and without.
test::SkyPicture picture(std::uint32_t rows = 24) {
  return {rows, [](math::Vec3 d) -> math::Rgb {
            if (d.y < -0.5f) return {};
            if (d.y < 0) return {0.25f, 0.5f, 0.125f};
            const auto steps = float(int((d.x + 1) * 100));
            return d.x > 0.9f ? math::Rgb{4096, 2048, 1024}
                              : math::Rgb{steps / 256, steps / 128, 0.75f};
          }};
}

proto::BakeSettings with_map(const std::string& name = "sky") {
  proto::BakeSettings settings = dark();
  settings.sky.map = name;
  return settings;
}

proto::Expected<scene::Scene> import_sky(const std::string& bytes,
                                         const files::ImportLimits& limits = {}) {
  const Upload upload(test::triangle_builder().glb(), {{"sky", bytes}});
  return import_scene(upload.files, with_map(), limits);
}

/// The error's code, and what its message has; both checks must say the same but for what only
/// decoding can tell.
void expect_refused(const std::string& bytes, const std::string& code, const std::string& words,
                    bool by_header = true, const files::ImportLimits& limits = {}) {
  const Upload upload(test::triangle_builder().glb(), {{"sky", bytes}});
  const auto scene = import_scene(upload.files, with_map(), limits);
  const auto checked = check_scene(upload.files, with_map(), limits);
  ASSERT_FALSE(scene) << words;
  EXPECT_EQ(scene.error().code, code);
  EXPECT_NE(scene.error().message.find(words), std::string::npos) << scene.error().message;
  ASSERT_EQ(scene.error().details.size(), 1u);
  EXPECT_EQ(scene.error().details[0].source, "settings");
  EXPECT_EQ(scene.error().details[0].pointer, "/sky/map");
  ASSERT_EQ(checked.has_value(), !by_header) << words;
  if (!checked) {
    EXPECT_EQ(checked.error().message, scene.error().message);
  }
}

TEST(SkyMap, ReadsEveryKindOfOpenExr) {
  const SkyPicture sky = picture();
  for (const bool half : {false, true})
    for (const bool tiled : {false, true})
      for (int compression = 0; compression <= 4; ++compression) {
        ExrStorage storage{half, tiled, compression};
        storage.channels = {"R", "G", "B", "A", "depth.Z"};
        const auto scene = import_sky(exr_file(sky, storage));
        ASSERT_TRUE(scene) << compression << ": " << scene.error().message;
        EXPECT_EQ(scene->sky_map.width, sky.width);
        EXPECT_EQ(scene->sky_map.height, sky.height);
        EXPECT_EQ(scene->sky_map.texels, sky.pixels) << half << tiled << compression;
      }
}

TEST(SkyMap, ReadsOpenExrThatRounds) {
  const SkyPicture sky = picture();
  for (const int compression : {5, 6, 7, 8, 9}) {  // PXR24, B44, B44A, DWAA, DWAB
    const auto scene = import_sky(exr_file(sky, {compression != 5, false, compression}));
    ASSERT_TRUE(scene) << compression << ": " << scene.error().message;
    double off = 0, all = 0;
    for (std::size_t i = 0; i < sky.pixels.size(); ++i) {
      off += std::abs(double(scene->sky_map.texels[i].g) - sky.pixels[i].g);
      all += sky.pixels[i].g;
    }
    EXPECT_LT(off, 0.02 * all) << compression;
  }
}

TEST(SkyMap, ReadsEveryKindOfRadiance) {
  SkyPicture sky = picture();
  for (math::Rgb& c : sky.pixels) c = test::hdr_rounded(c);
  for (const HdrRows rows : {HdrRows::kPacked, HdrRows::kPlain, HdrRows::kRepeated}) {
    const auto scene = import_sky(hdr_file(sky, rows));
    ASSERT_TRUE(scene) << scene.error().message;
    EXPECT_EQ(scene->sky_map.width, sky.width);
    EXPECT_EQ(scene->sky_map.texels, sky.pixels);
  }
  // What was multiplied into the pixels is taken out again.
  const auto exposed = import_sky(hdr_file(sky, HdrRows::kPacked, "EXPOSURE=2\nEXPOSURE= 4.0\n"));
  ASSERT_TRUE(exposed);
  for (std::size_t i = 0; i < sky.pixels.size(); ++i)
    EXPECT_EQ(exposed->sky_map.texels[i], sky.pixels[i] * 0.125f);
}

TEST(SkyMap, BothFormatsShowTheSameWayUp) {
  const SkyPicture sky(8, [](math::Vec3 d) -> math::Rgb {
    return {d.x > 0.5f ? 1.f : 0.f, d.y > 0.5f ? 1.f : 0.f, d.z > 0.5f ? 1.f : 0.f};
  });
  const auto exr = import_sky(exr_file(sky)), hdr = import_sky(hdr_file(sky));
  ASSERT_TRUE(exr && hdr);
  EXPECT_EQ(exr->sky_map.texels, sky.pixels);
  EXPECT_EQ(hdr->sky_map.texels, sky.pixels);
}

// ACEScg, whose matrix to linear Rec. 709 (D60 to D65 by Bradford) is published with ACES.
const std::vector<float> kAcesCg{0.713f, 0.293f, 0.165f, 0.83f, 0.128f, 0.044f, 0.32168f, 0.33767f};
constexpr float kAcesCgToRec709[3][3]{{1.70505f, -0.62179f, -0.08326f},
                                      {-0.13026f, 1.14080f, -0.01055f},
                                      {-0.02400f, -0.12897f, 1.15297f}};

TEST(SkyMap, ColorsAreReadByTheFilesPrimaries) {
  SkyPicture sky = picture();
  for (math::Rgb& c : sky.pixels) c = test::hdr_rounded(c);
  sky.pixels[7] = {0, 64, 0};  // a green that Rec. 709 has not
  sky.pixels[8] = {64, 64, 64};
  std::string line = "PRIMARIES=";
  for (const float v : kAcesCg) line += " " + std::to_string(v);
  const auto exr = import_sky(exr_file(sky, {.chromaticities = kAcesCg}));
  const auto hdr = import_sky(hdr_file(sky, HdrRows::kPacked, line + "\n"));
  ASSERT_TRUE(exr) << exr.error().message;
  ASSERT_TRUE(hdr) << hdr.error().message;
  for (const scene::Scene* scene : {&*exr, &*hdr}) {
    for (std::size_t i = 0; i < sky.pixels.size(); ++i) {
      const math::Rgb in = sky.pixels[i], out = scene->sky_map.texels[i];
      const auto expected = [&](int row) {
        const float* m = kAcesCgToRec709[row];
        return std::max(0.f, m[0] * in.r + m[1] * in.g + m[2] * in.b);
      };
      const float close = 2e-5f * max_channel(in);
      ASSERT_NEAR(out.r, expected(0), close);
      ASSERT_NEAR(out.g, expected(1), close);
      ASSERT_NEAR(out.b, expected(2), close);
    }
    const math::Rgb white = scene->sky_map.texels[8];
    EXPECT_NEAR(white.r, 64, 1e-4);
    EXPECT_NEAR(white.g, 64, 1e-4);
    EXPECT_NEAR(white.b, 64, 1e-4);
    EXPECT_EQ(scene->sky_map.texels[7].r, 0);
    EXPECT_EQ(warning_codes(*scene), std::vector<std::string>{"sky_map_negative"});
  }
}

TEST(SkyMap, PrimariesOfRec709ChangeNoBit) {
  const SkyPicture sky = picture();
  const auto exr = import_sky(exr_file(
      sky, {.chromaticities = {0.64f, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.31271f, 0.32902f}}));
  ASSERT_TRUE(exr);
  EXPECT_EQ(exr->sky_map.texels, sky.pixels);
}

TEST(SkyMap, RefusesPrimariesThatMakeNoWhite) {
  const float inf = std::numeric_limits<float>::infinity();
  const std::string no_white = "no mixture of the primaries";
  for (const std::vector<float>& odd : {
           std::vector<float>{0, 0, 0, 0, 0, 0, 0, 0},
           {0.64f, 0.33f, 0.64f, 0.33f, 0.15f, 0.06f, 0.3127f, 0.329f},  // two are one
           {0.64f, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.9f, 0.05f},        // white beyond them
           {0.64f, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.3127f, 0},
           {inf, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.3127f, 0.329f},
           {0.64f, std::nanf(""), 0.3f, 0.6f, 0.15f, 0.06f, 0.3127f, 0.329f},
       })
    expect_refused(exr_file(picture(), {.chromaticities = odd}), "invalid_image", no_white);
  const auto line = [](const char* text) {
    return hdr_file(picture(), HdrRows::kPacked, std::string(text) + "\n");
  };
  expect_refused(line("PRIMARIES=0 0 0 0 0 0 0 0"), "invalid_image", no_white);
  for (const char* text :
       {"PRIMARIES=", "PRIMARIES=.64 .33 .3 .6 .15 .06 .3127",
        "PRIMARIES=.64 .33 .3 .6 .15 .06 .3127 .329 1", "PRIMARIES=.64 .33 .3 .6 .15 .06 .3127 x"})
    expect_refused(line(text), "invalid_image", "PRIMARIES are not eight numbers");
}

TEST(SkyMap, IsFoundByItsNameAmongTheSideFiles) {
  const std::string bytes = hdr_file(picture());
  const Upload upload(test::triangle_builder().glb(), {{"skies/noon 4k.hdr", bytes}, {"a", ""}});
  EXPECT_TRUE(import_scene(upload.files, with_map("skies/noon 4k.hdr")));
  EXPECT_TRUE(import_scene(upload.files, with_map("noon 4k.hdr")));
  EXPECT_TRUE(check_scene(upload.files, with_map("noon 4k.hdr")));
  for (const char* name : {"noon.hdr", "/etc/passwd", "../skies", ""}) {
    const auto checked = check_scene(upload.files, with_map(name));
    const auto scene = import_scene(upload.files, with_map(name));
    ASSERT_FALSE(checked || scene) << name;
    EXPECT_EQ(checked.error().code, "missing_file");
    EXPECT_EQ(checked.error().details.at(0).pointer, "/sky/map");
    EXPECT_EQ(scene.error().message, checked.error().message);
  }
}

TEST(SkyMap, TheSettingsTurnAndScaleIt) {
  const Upload upload(test::triangle_builder().glb(), {{"sky", hdr_file(picture())}});
  proto::BakeSettings settings = with_map();
  settings.sky.radiance = {1, 2, 3};
  settings.sky.scale = 50;
  settings.sky.rotation = 90;
  const auto scene = import_scene(upload.files, settings);
  ASSERT_TRUE(scene);
  EXPECT_EQ(scene->sky, (math::Rgb{1, 2, 3}));
  EXPECT_EQ(scene->sky_map.scale, 50);
  EXPECT_FLOAT_EQ(scene->sky_map.rotation, math::kPi / 2);
  settings.sky.scale = 0;
  EXPECT_TRUE(import_scene(upload.files, settings)->sky_map.empty()) << "gives no light";
  settings.sky.map.reset();
  EXPECT_TRUE(import_scene(upload.files, settings)->sky_map.empty());
  settings.sky.scale = 1e9f;
  settings.sky.map = "sky";
  EXPECT_TRUE(import_scene(upload.files, settings));
  SkyPicture bright = picture();
  bright.pixels[5] = {1e9f, 0, 0};
  const Upload too_bright(test::triangle_builder().glb(), {{"sky", exr_file(bright)}});
  const auto refused = import_scene(too_bright.files, settings);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, "invalid_settings");
  EXPECT_EQ(refused.error().details.at(0).pointer, "/sky/scale");
}

TEST(SkyMap, LightsASceneUnlessItIsBlack) {
  const SkyPicture black(4, [](math::Vec3) { return math::Rgb{}; });
  proto::BakeSettings settings = with_map();
  settings.allow_dark = false;
  const Upload lit(test::triangle_builder().glb(), {{"sky", hdr_file(picture())}}),
      unlit(test::triangle_builder().glb(), {{"sky", hdr_file(black)}});
  EXPECT_TRUE(import_scene(lit.files, settings));
  EXPECT_TRUE(check_scene(lit.files, settings));
  EXPECT_EQ(import_scene(unlit.files, settings).error().code, "no_light");
  settings.sky.scale = 0;
  EXPECT_EQ(import_scene(lit.files, settings).error().code, "no_light");
  EXPECT_EQ(check_scene(lit.files, settings).error().code, "no_light");
}

TEST(SkyMap, ValuesThatAreNoRadiance) {
  const auto with = [](float value) {
    SkyPicture sky = picture();
    sky.pixels[3 * sky.width + 5].g = value;
    return exr_file(sky);
  };
  const float inf = std::numeric_limits<float>::infinity();
  for (const float value : {inf, -inf, 2e12f})
    expect_refused(with(value), "invalid_image", "the pixel (5, 3) is infinite", false);
  expect_refused(with(std::nanf("")), "invalid_image", "the pixel (5, 3) is no number", false);
  const auto scene = import_sky(with(-0.5f));
  ASSERT_TRUE(scene);
  EXPECT_EQ(scene->sky_map.texels[3 * scene->sky_map.width + 5].g, 0);
  EXPECT_EQ(warning_codes(*scene), std::vector<std::string>{"sky_map_negative"});
  EXPECT_EQ(scene->warnings[0].pointer, "/sky/map");
}

TEST(SkyMap, RefusesOtherShapesAndFormats) {
  SkyPicture square = picture();
  square.width /= 2;
  square.pixels.resize(square.pixels.size() / 2);
  expect_refused(exr_file(square), "invalid_image", "24 x 24 pixels");
  expect_refused(hdr_file(square), "invalid_image", "24 x 24 pixels");
  expect_refused("", "invalid_image", "neither OpenEXR nor Radiance");
  expect_refused("\x89PNG\r\n\x1a\n", "invalid_image", "neither OpenEXR nor Radiance");
  expect_refused(exr_file(picture(), {.channels = {"R", "G"}}), "invalid_image", "no channel B");
  files::ImportLimits few;
  few.image_pixels = 48 * 24 - 1;
  expect_refused(exr_file(picture()), "limit_exceeded", "image_pixels", true, few);
  few = {};
  few.all_image_pixels = 48 * 24 - 1;
  expect_refused(hdr_file(picture()), "limit_exceeded", "all_image_pixels", false, few);
  few = {};
  few.file_bytes = 3000;
  expect_refused(hdr_file(picture(), HdrRows::kPlain), "limit_exceeded", "", true, few);
}

TEST(SkyMap, RefusesRadianceThatIsOdd) {
  std::string hdr = hdr_file(picture());
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string changed = hdr;
    return changed.replace(changed.find(from), from.size(), to);
  };
  expect_refused(with("rgbe", "xyze"), "invalid_image", "not RGBE");
  expect_refused(with("-Y 24 +X 48", "+Y 24 +X 48"), "invalid_image", "from the top");
  expect_refused(with("-Y 24 +X 48", "-Y 24 -X 48"), "invalid_image", "from the top");
  expect_refused(with("-Y 24 +X 48", "-Y 24 +X 4x"), "invalid_image", "from the top");
  expect_refused(with("-Y 24 +X 48", "-Y 0 +X 0"), "invalid_image", "0 x 0");
  expect_refused(with("-Y 24 +X 48", "-Y 99999999999 +X 48"), "invalid_image", "from the top");
  expect_refused(with("# a comment", "EXPOSURE=0"), "invalid_image", "EXPOSURE");
  expect_refused(with("# a comment", "EXPOSURE=inf"), "invalid_image", "EXPOSURE");
  expect_refused(with("# a comment", "EXPOSURE=1e200\nEXPOSURE=1e200"), "invalid_image",
                 "product of its EXPOSUREs");
  expect_refused(with("# a comment", "EXPOSURE=1e-200\nEXPOSURE=1e-200"), "invalid_image",
                 "product of its EXPOSUREs");
  expect_refused(with("# a comment", "COLORCORR=1 1 1"), "invalid_image", "COLORCORR");
  expect_refused("#?RADIANCE\nA=B\n", "invalid_image", "no end");
  // A size for which the file is far too short takes no memory.
  expect_refused(with("-Y 24 +X 48", "-Y 8192 +X 16384"), "invalid_image", "ends too early");
  for (const char* size : {"-Y 900000 +X 900000", "-Y 1000000000 +X 2000000000"})
    expect_refused(with("-Y 24 +X 48", size), "limit_exceeded", "image_pixels");
}

/// Where an attribute's value begins in an OpenEXR file.
std::size_t attribute(const std::string& exr, const std::string& name) {
  const std::size_t type = exr.find(name + '\0') + name.size() + 1;
  return exr.find('\0', type) + 5;
}

std::string with_value(std::string exr, std::size_t at, std::int32_t value) {
  std::memcpy(&exr.at(at), &value, sizeof value);
  return exr;
}

TEST(SkyMap, RefusesOpenExrThatIsOdd) {
  const std::string exr = exr_file(picture()), tiled = exr_file(picture(), {.tiled = true});
  const std::size_t window = attribute(exr, "dataWindow"),
                    display = attribute(exr, "displayWindow");
  const std::size_t tiles = attribute(tiled, "tiles"), channels = attribute(exr, "channels");
  for (const int flag : {0x800, 0x1000, 0x1800, 0x10000})
    expect_refused(with_value(exr, 4, 2 | flag), "invalid_image", "several parts or deep");
  expect_refused(with_value(exr, 4, 3), "invalid_image", "version");
  expect_refused(with_value(exr, window, -1), "invalid_image", "display window");
  expect_refused(with_value(exr, window, 2'000'000'000), "invalid_image", "window");
  // Both windows lie alike.
  const auto both = [&](std::size_t field, std::int32_t value) {
    return with_value(with_value(exr, window + field, value), display + field, value);
  };
  expect_refused(both(8, -1), "invalid_image", "window is empty");
  expect_refused(both(8, 0x7fffffff), "invalid_image", "window can't be right");
  const auto sized = [&](std::int32_t width, std::int32_t height) {
    return with_value(with_value(both(8, width - 1), window + 12, height - 1), display + 12,
                      height - 1);
  };
  expect_refused(sized(16384, 8192), "invalid_image", "ends too early");
  expect_refused(sized(900'000, 900'000), "limit_exceeded", "image_pixels");
  expect_refused(sized(1 << 24, 1 << 23), "limit_exceeded", "image_pixels");
  expect_refused(with_value(tiled, tiles, 0), "invalid_image", "tiles");
  expect_refused(with_value(tiled, tiles, 0x7fffffff), "invalid_image", "tiles");
  expect_refused(with_value(tiled, tiles + 4, -1), "invalid_image", "tiles");
  expect_refused(with_value(with_value(tiled, tiles, 16384), tiles + 4, 16384), "invalid_image",
                 "chunks are too large");
  std::string primaries = exr_file(picture(), {.chromaticities = kAcesCg});
  primaries[primaries.find("chromaticities") + 15] = 'X';  // of another type
  expect_refused(primaries, "invalid_image", "chromaticities");
  expect_refused(with_value(exr, channels + 2, 0), "invalid_image", "neither half nor float");
  expect_refused(with_value(exr, channels + 2, 7), "invalid_image", "channels");
  expect_refused(with_value(exr, channels + 10, 2), "invalid_image", "subsampled");
  std::string twice = exr;
  twice[exr.find("displayWindow", 0)] = 'D';  // an attribute that is missing
  expect_refused(twice, "invalid_image", "display window");
  std::string unknown = exr;
  unknown[attribute(exr, "compression")] = 77;
  expect_refused(unknown, "invalid_image", "compression");
}

/// Whatever it is, an import ends, with an error of the map or with values that a sky may have.
void expect_harmless(const std::string& bytes, const std::string& what) {
  const std::vector<char> exact(bytes.begin(), bytes.end());  // so that sanitizers see its end
  files::SceneFiles files;
  auto opened = std::make_shared<files::OpenedFiles>();
  const std::string glb = test::triangle_builder().glb();
  opened->emplace("main", files::MappedFile::view(glb));
  opened->emplace("side", files::MappedFile::view({exact.data(), exact.size()}));
  files.main = "main";
  files.side["sky"] = "side";
  files.opened = opened;
  files::ImportLimits limits;
  limits.image_pixels = 1 << 16;
  const auto scene = import_scene(files, with_map(), limits);
  if (!scene) {
    EXPECT_TRUE(scene.error().code == "invalid_image" || scene.error().code == "limit_exceeded")
        << what << scene.error().code;
    return;
  }
  for (const math::Rgb c : scene->sky_map.texels)
    ASSERT_TRUE(c.r >= 0 && c.g >= 0 && c.b >= 0 && max_channel(c) <= scene::kMaxSkyValue) << what;
}

TEST(SkyMap, BrokenBytesAreHarmless) {
  const SkyPicture sky = picture(8);
  std::vector<std::string> files{hdr_file(sky), hdr_file(sky, HdrRows::kRepeated)};
  for (const int compression : {0, 1, 3, 4, 5, 7, 9})
    files.push_back(exr_file(sky, {compression >= 7, compression == 4, compression}));
  std::uint32_t random = 1;
  for (const std::string& file : files) {
    for (std::size_t n = 0; n < file.size(); n += 1 + file.size() / 200) {
      const std::string cut = file.substr(0, n);
      expect_harmless(cut, "cut at " + std::to_string(n) + ": ");
      EXPECT_FALSE(import_sky(cut)) << "cut at " << n;
    }
    for (int i = 0; i < 400; ++i) {
      std::string flipped = file;
      for (int k = 0; k <= i % 3; ++k) {
        random = random * 1664525 + 1013904223;
        flipped[(random >> 8) % file.size()] ^= char(1 << (random & 7));
      }
      expect_harmless(flipped, "flip " + std::to_string(i) + ": ");
    }
  }
}

TEST(SkyMap, ImportsWithoutTheMapAreNotTakenForOthers) {
  const Upload upload(test::triangle_builder().glb(), {{"sky", hdr_file(picture())}});
  auto scene = import_files(upload.files);
  ASSERT_TRUE(scene);
  EXPECT_TRUE(scene->sky_map.empty());
  const auto applied = apply_settings(*scene, with_map());
  ASSERT_FALSE(applied);
  EXPECT_EQ(applied.error().code, "missing_file");
}

TEST(SkyMap, StopsOnRequest) {
  const Upload upload(test::triangle_builder().glb(), {{"sky", exr_file(picture())}});
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(import_scene(upload.files, with_map(), {}, stop.get_token()).error().code, "canceled");
  auto scene = import_scene(upload.files, with_map());
  ASSERT_TRUE(scene);
  const auto applied = apply_settings(*scene, with_map(), stop.get_token());
  ASSERT_FALSE(applied);
  EXPECT_EQ(applied.error().code, "canceled");
}

}  // namespace
}  // namespace kiln::import
