// Albedo and emission of imported scenes: factors, textures, colors, and how images are decoded.
#include <gtest/gtest.h>
#include <webp/encode.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "tests/import/import_helpers.h"
#include "tests/support/png_builder.h"

namespace kiln::import {
namespace {

using test::PngBuilder;

/// 2 x 2 pixels: red, green / blue, white.
std::string four_colors() {
  return PngBuilder::encode(2, 2, 8, 2, std::string("\xff\0\0\0\xff\0\0\0\xff\xff\xff\xff", 12));
}

/// A triangle whose TEXCOORD_0 is `uv` at all corners, with one material made by `edit`, which gets
/// the builder and the index of a texture of `png`.
scene::Scene textured(const std::string& png, math::Vec2 uv,
                      const std::function<void(GltfBuilder&, nlohmann::json& material)>& edit) {
  GltfBuilder b;
  const int positions = b.accessor(test::triangle_positions(), 3);
  const int coordinates = b.accessor(std::vector<float>{uv.x, uv.y, uv.x, uv.y, uv.x, uv.y}, 2);
  b.add("samplers", {{"magFilter", 9728}});
  b.add("textures", {{"source", b.image(png, "image/png")}, {"sampler", 0}});
  nlohmann::json material = {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}};
  edit(b, material);
  b.material(material);
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", positions}, {"TEXCOORD_0", coordinates}}},
                           {"material", 0}})}});
  return imported(b);
}
scene::Scene textured(const std::string& png, math::Vec2 uv) {
  return textured(png, uv, [](GltfBuilder&, nlohmann::json&) {});
}

math::Rgb albedo(const scene::Scene& scene) {
  return scene.triangles.empty() ? math::Rgb{-1, -1, -1} : albedo_at(scene, 0, {0.25f, 0.25f});
}

void expect_rgb(math::Rgb actual, math::Rgb expected) {
  EXPECT_NEAR(actual.r, expected.r, 1e-6f);
  EXPECT_NEAR(actual.g, expected.g, 1e-6f);
  EXPECT_NEAR(actual.b, expected.b, 1e-6f);
}

const math::Rgb kRed{1, 0, 0}, kGreen{0, 1, 0}, kBlue{0, 0, 1}, kWhite{1, 1, 1};

TEST(Materials, DefaultIsWhiteAndDark) {
  const scene::Scene scene = imported(test::triangle_builder());
  EXPECT_EQ(albedo(scene), kWhite);
  EXPECT_FALSE(is_emissive(scene, 0));
  EXPECT_EQ(scene.materials.at(0).source, -1);
}

TEST(Materials, RowZeroIsTheTopOfTheImage) {
  EXPECT_EQ(albedo(textured(four_colors(), {0.25f, 0.25f})), kRed);
  EXPECT_EQ(albedo(textured(four_colors(), {0.75f, 0.25f})), kGreen);
  EXPECT_EQ(albedo(textured(four_colors(), {0.25f, 0.75f})), kBlue);
}

TEST(Materials, WrapModes) {
  const auto with_wrap = [](int s, math::Vec2 uv) {
    return albedo(textured(four_colors(), uv, [&](GltfBuilder& b, nlohmann::json&) {
      b.json["samplers"][0]["wrapS"] = s;
    }));
  };
  EXPECT_EQ(with_wrap(10497, {1.25f, 0.25f}), kRed);  // repeat
  EXPECT_EQ(with_wrap(10497, {-0.25f, 0.25f}), kGreen);
  EXPECT_EQ(with_wrap(33071, {1.25f, 0.25f}), kGreen);  // clamp
  EXPECT_EQ(with_wrap(33071, {-0.25f, 0.25f}), kRed);
  EXPECT_EQ(with_wrap(33648, {1.25f, 0.25f}), kGreen);  // mirror
  EXPECT_EQ(with_wrap(33648, {-0.75f, 0.25f}), kGreen);
}

TEST(Materials, BilinearUnlessNearestIsAskedFor) {
  const auto gray = [](const char* filter) {
    return albedo(textured(PngBuilder::encode(2, 1, 8, 0, std::string("\0\xff", 2)), {0.5f, 0.5f},
                           [&](GltfBuilder& b, nlohmann::json&) {
                             if (filter == nullptr) b.json["samplers"][0].erase("magFilter");
                           }))
        .r;
  };
  EXPECT_NEAR(gray(nullptr), 0.5f, 1e-6f);  // the mean of the linear values
  EXPECT_EQ(gray("nearest"), 1.f);
}

TEST(Materials, FactorTextureAndVertexColorMultiply) {
  GltfBuilder b;
  const int positions = b.accessor(test::triangle_positions(), 3);
  const int uv = b.accessor(std::vector<float>(6, 0.75f), 2);
  const int colors = b.accessor(std::vector<float>(9, 0.5f), 3);
  b.add("textures",
        {{"source", b.image(PngBuilder::encode(1, 1, 8, 2, "\x80\x80\x80"), "image/png")}});
  b.material({{"pbrMetallicRoughness",
               {{"baseColorFactor", {1, 0.5, 0.25, 1}},
                {"metallicFactor", 1},  // changes nothing: see MaterialSource
                {"baseColorTexture", {{"index", 0}}}}}});
  b.node({{"mesh", b.mesh({{"attributes",
                            {{"POSITION", positions}, {"TEXCOORD_0", uv}, {"COLOR_0", colors}}},
                           {"material", 0}})}});
  const float texel = std::pow((128 / 255.f + 0.055f) / 1.055f, 2.4f);
  expect_rgb(albedo(imported(b)), {0.5f * texel, 0.25f * texel, 0.125f * texel});
}

TEST(Materials, EmissionIsFactorTimesStrengthTimesTexture) {
  const scene::Scene scene =
      textured(four_colors(), {0.75f, 0.25f}, [](GltfBuilder&, nlohmann::json& m) {
        m["emissiveFactor"] = {1, 0.5, 0.25};
        m["emissiveTexture"] = {{"index", 0}};
        m["extensions"] = {{"KHR_materials_emissive_strength", {{"emissiveStrength", 400}}}};
      });
  ASSERT_FALSE(scene.triangles.empty());
  EXPECT_TRUE(is_emissive(scene, 0));
  expect_rgb(emission_at(scene, 0, {0.25f, 0.25f}), {0, 200, 0});
  EXPECT_EQ(scene.images.size(), 1u);  // shared by both textures
}

TEST(Materials, TextureTransformScalesThenTurnsThenMoves) {
  const auto with_transform = [](nlohmann::json transform, math::Vec2 uv) {
    return albedo(textured(four_colors(), uv, [&](GltfBuilder& b, nlohmann::json& m) {
      b.json["extensionsUsed"] = {"KHR_texture_transform"};
      m["pbrMetallicRoughness"]["baseColorTexture"]["extensions"]["KHR_texture_transform"] =
          transform;
    }));
  };
  EXPECT_EQ(with_transform({{"offset", {0.5, 0}}}, {0.25f, 0.25f}), kGreen);
  EXPECT_EQ(with_transform({{"scale", {3, 1}}}, {0.25f, 0.25f}), kGreen);
  // A quarter turn takes (u, v) to (v, -u): (0.25, 0.75) reads (0.75, -0.25), the bottom right.
  EXPECT_EQ(with_transform({{"rotation", std::numbers::pi / 2}}, {0.25f, 0.75f}), kWhite);
  EXPECT_EQ(with_transform({{"rotation", std::numbers::pi / 2}}, {0.25f, 0.25f}), kBlue);
}

TEST(Materials, TextureTransformMayNameAnotherSet) {
  const scene::Scene scene =
      textured(four_colors(), {0.25f, 0.25f}, [](GltfBuilder&, nlohmann::json& m) {
        m["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = 3;
        m["pbrMetallicRoughness"]["baseColorTexture"]["extensions"]["KHR_texture_transform"]
         ["texCoord"] = 0;
      });
  EXPECT_EQ(albedo(scene), kRed);
  EXPECT_TRUE(scene.warnings.empty());
}

TEST(Materials, MissingTextureCoordinatesAreAWarning) {
  const scene::Scene scene =
      textured(four_colors(), {0.75f, 0.75f}, [](GltfBuilder&, nlohmann::json& m) {
        m["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = 1;
      });
  EXPECT_EQ(albedo(scene), kRed);
  EXPECT_EQ(warning_codes(scene), std::vector<std::string>{"texcoord_missing"});
}

TEST(Materials, SpecularGlossinessReplacesTheBaseColor) {
  const scene::Scene scene =
      textured(four_colors(), {0.25f, 0.25f}, [](GltfBuilder& b, nlohmann::json& m) {
        b.json["extensionsUsed"] = {"KHR_materials_pbrSpecularGlossiness"};
        m["extensions"]["KHR_materials_pbrSpecularGlossiness"] = {
            {"diffuseFactor", {0.5, 0.25, 0.125, 1}}};
      });
  EXPECT_EQ(albedo(scene), (math::Rgb{0.5f, 0.25f, 0.125f}));
}

TEST(Materials, DoubleSidedAndAlpha) {
  const scene::Scene scene = textured(four_colors(), {0, 0}, [](GltfBuilder&, nlohmann::json& m) {
    m["doubleSided"] = true;
    m["alphaMode"] = "MASK";
    m["alphaCutoff"] = 0.25;
  });
  EXPECT_TRUE(scene.materials.at(0).double_sided);
  EXPECT_EQ(scene.materials.at(0).alpha_mode, scene::AlphaMode::kMask);
  EXPECT_EQ(scene.materials.at(0).alpha_cutoff, 0.25f);
  ASSERT_EQ(scene.warnings.size(), 1u);
  EXPECT_EQ(scene.warnings[0].code, "alpha_ignored");
  EXPECT_EQ(scene.warnings[0].pointer, "/materials/0/alphaMode");
}

TEST(Materials, FactorsOutsideZeroToOneAreClampedWithAWarning) {
  const scene::Scene scene =
      textured(four_colors(), {0.75f, 0.75f}, [](GltfBuilder&, nlohmann::json& m) {
        m["pbrMetallicRoughness"]["baseColorFactor"] = {1.5, -1, 0.5, 1};
      });
  EXPECT_EQ(albedo(scene), (math::Rgb{1, 0, 0.5f}));
  EXPECT_EQ(warning_codes(scene), std::vector<std::string>{"base_color_clamped"});
}

// Images ------------------------------------------------------------------------------------------

std::array<std::uint8_t, 4> first_texel(const std::string& png) {
  const scene::Scene scene = textured(png, {0, 0});
  return scene.image_texels.empty() ? std::array<std::uint8_t, 4>{} : scene.image_texels[0];
}

TEST(Images, PngOfEveryColorTypeAndDepth) {
  using Texel = std::array<std::uint8_t, 4>;
  EXPECT_EQ(first_texel(PngBuilder::encode(1, 1, 8, 0, "\x40")), (Texel{0x40, 0x40, 0x40, 255}));
  EXPECT_EQ(first_texel(PngBuilder::encode(1, 1, 8, 4, "\x40\x80")),
            (Texel{0x40, 0x40, 0x40, 0x80}));
  EXPECT_EQ(first_texel(PngBuilder::encode(1, 1, 8, 2, "\x40\x50\x60")),
            (Texel{0x40, 0x50, 0x60, 255}));
  // Colors are kept as stored, not multiplied by alpha.
  EXPECT_EQ(first_texel(PngBuilder::encode(1, 1, 8, 6, "\x40\x50\x60\x10")),
            (Texel{0x40, 0x50, 0x60, 0x10}));
  EXPECT_EQ(first_texel(PngBuilder::encode(1, 1, 16, 2, "\x40\x40\x50\x50\x60\x60")),
            (Texel{0x40, 0x50, 0x60, 255}));
  EXPECT_EQ(first_texel(PngBuilder::encode(1, 1, 1, 0, "\x80")), (Texel{255, 255, 255, 255}));
}

/// Imports a triangle whose base texture is `image`.
proto::Expected<scene::Scene> import_image(const std::string& image,
                                           const files::ImportLimits& limits = {}) {
  GltfBuilder b = test::triangle_builder();
  b.add("textures", {{"source", b.image(image, "image/png")}});
  b.material({{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}});
  b.json["meshes"][0]["primitives"][0]["material"] = 0;
  return import_bytes(b.glb(), dark(), limits);
}

TEST(Images, BrokenImageIsAnErrorWithItsPlace) {
  const std::string png = four_colors();
  for (std::size_t length = 8; length < png.size() - 12; ++length) {
    const auto scene = import_image(png.substr(0, length));
    ASSERT_FALSE(scene) << length;
    EXPECT_EQ(scene.error().code, "invalid_image");
    EXPECT_EQ(scene.error().details.at(0).pointer, "/images/0");
  }
}

TEST(Images, DeclaredSizeIsHeldAgainstTheLimitsBeforeDecoding) {
  files::ImportLimits limits;
  limits.image_pixels = 3;
  const auto scene = import_image(four_colors(), limits);
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().code, "limit_exceeded");
  EXPECT_EQ(scene.error().details.at(0).pointer, "/images/0");
  // The header alone claims 2^31 - 1 pixels square; a progressive JPEG claims 65500 square.
  const std::string huge = PngBuilder::encode(0x7fffffff, 1, 8, 2, "abc");
  EXPECT_EQ(import_image(huge).error().code, "limit_exceeded");
  const std::string jpeg("\xff\xd8\xff\xc2\x00\x11\x08\xff\xdc\xff\xdc\x03", 12);
  EXPECT_EQ(import_image(jpeg).error().code, "limit_exceeded");
}

TEST(Images, AllImagesTogetherHaveALimitToo) {
  GltfBuilder b = test::triangle_builder();
  for (int i = 0; i < 2; ++i) b.add("textures", {{"source", b.image(four_colors(), "image/png")}});
  b.material({{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}},
              {"emissiveFactor", {1, 1, 1}},
              {"emissiveTexture", {{"index", 1}}}});
  b.json["meshes"][0]["primitives"][0]["material"] = 0;
  files::ImportLimits limits;
  limits.all_image_pixels = 7;
  const auto scene = import_bytes(b.glb(), dark(), limits);
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().details.at(0).pointer, "/images/1");
}

TEST(Images, OtherFormatsAreLeftOutWithAWarning) {
  const auto scene = import_image("GIF89a and so on");
  ASSERT_TRUE(scene);
  EXPECT_EQ(scene->images.size(), 0u);
  EXPECT_EQ(albedo(*scene), kWhite);
  EXPECT_EQ(warning_codes(*scene), (std::vector<std::string>{"texcoord_missing", "image_ignored"}));
}

TEST(Images, WebpIsReadWhereItsExtensionNamesIt) {
  const std::vector<std::uint8_t> red{255, 0, 0, 255};
  std::uint8_t* bytes = nullptr;
  const std::size_t size = WebPEncodeLosslessRGBA(red.data(), 1, 1, 4, &bytes);
  const std::string webp(reinterpret_cast<const char*>(bytes), size);
  WebPFree(bytes);
  const std::string green = PngBuilder::encode(1, 1, 8, 2, std::string("\x00\xff\x00", 3));
  for (const bool fallback : {false, true}) {
    GltfBuilder b = test::triangle_builder();
    nlohmann::json texture{
        {"extensions", {{"EXT_texture_webp", {{"source", b.image(webp, "image/webp")}}}}}};
    if (fallback) texture["source"] = b.image(green, "image/png");
    b.add("textures", texture);
    b.material({{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}});
    b.json["meshes"][0]["primitives"][0]["material"] = 0;
    b.json["extensionsUsed"] = b.json["extensionsRequired"] = {"EXT_texture_webp"};
    const scene::Scene scene = imported(b);
    ASSERT_EQ(scene.image_texels.size(), 1u);
    EXPECT_EQ(scene.image_texels[0], (std::array<std::uint8_t, 4>{255, 0, 0, 255}));
    EXPECT_EQ(warning_codes(scene), (std::vector<std::string>{"texcoord_missing"}));
  }
  for (const std::size_t length : {size / 2, std::size_t{12}}) {
    const auto cut = import_image(webp.substr(0, length));
    ASSERT_FALSE(cut) << length;
    EXPECT_EQ(cut.error().code, "invalid_image");
  }
}

TEST(Images, UnusedImagesAreNotLookedFor) {
  GltfBuilder b = test::triangle_builder();
  b.add("images", {{"uri", "normal.png"}});
  b.add("textures", {{"source", 0}});
  b.material({{"normalTexture", {{"index", 0}}}});
  b.json["meshes"][0]["primitives"][0]["material"] = 0;
  EXPECT_EQ(imported(b).triangles.size(), 1u);
}

TEST(Images, MissingFileIsFoundByTheCheck) {
  GltfBuilder b = test::triangle_builder();
  b.add("images", {{"uri", "wood.png"}});
  b.add("textures", {{"source", 0}});
  b.material({{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}});
  b.json["meshes"][0]["primitives"][0]["material"] = 0;
  const Upload upload(b.glb());
  const auto checked = check_scene(upload.files, dark());
  ASSERT_FALSE(checked);
  EXPECT_EQ(checked.error().code, "missing_file");
  EXPECT_EQ(checked.error().details.at(0).pointer, "/images/0/uri");
  const Upload whole(b.glb(), {{"textures/wood.png", four_colors()}});
  EXPECT_TRUE(check_scene(whole.files, dark()));
  EXPECT_TRUE(import_scene(whole.files, dark()));
}

}  // namespace
}  // namespace kiln::import
