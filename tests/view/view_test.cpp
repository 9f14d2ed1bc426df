// Pictures of scenes whose colors are known.
#include "baker/view/view.h"

#include <cmath>
#include <set>

#include "baker/bake.h"
#include "baker/generate/generate.h"
#include "baker/output/post.h"
#include "tests/support/ready_scene.h"
#include "tests/view/baked_folder.h"

namespace kiln::view {
namespace {

constexpr Code kBackground{40, 44, 52};

TEST(View, ASquareShowsItsTexels) {
  const auto page = page_of(4, [](auto x, auto y) {
    return math::Rgb{float(x) / 5, float(y) / 5, 1};
  });
  const scene::Scene scene = test::SceneBuilder().part(unit_square()).build();
  const auto picture =
      BakedFolder("validity", {page}).nodes({0}).draw(scene, square_request("validity"));
  ASSERT_TRUE(picture) << picture.error().message;
  for (std::uint32_t y = 0; y < 4; ++y)
    for (std::uint32_t x = 0; x < 4; ++x)  // the page's first row is at v = 0, where y is 0
      EXPECT_EQ(pixel(*picture, x, y),
                (Code{std::uint8_t(51 * x), std::uint8_t(51 * (3 - y)), 255}))
          << x << " " << y;
}

TEST(View, BilinearLooksBlend) {
  const auto page = page_of(4, [](auto x, auto) { return math::Rgb{float(x) / 4, 0, 0}; });
  const scene::Scene scene = test::SceneBuilder().part(unit_square()).build();
  Request request = square_request("validity");
  request.nearest = false;
  request.size = {16, 16};
  const auto picture = BakedFolder("validity", {page}).nodes({0}).draw(scene, request);
  ASSERT_TRUE(picture) << picture.error().message;
  for (std::uint32_t x = 3; x < 13; ++x) {  // away from the page's edges: a ramp
    const float texel = (float(x) + 0.5f) / 4 - 0.5f;
    EXPECT_NEAR(pixel(*picture, x, 8)[0], 255 * texel / 4, 1) << x;
  }
}

TEST(View, BilinearLooksTakeLitTexelsOnly) {
  auto page = page_of(4, [](auto x, auto) {
    return x < 2 ? math::Rgb{0.8f, 0.8f, 0.8f} : math::Rgb{};
  });
  for (std::size_t i = 0; i < 16; ++i) page.coverage[i] = i % 4 < 2 ? 1 : 0;
  // The square covers the lit half of the page, up to the border of the other.
  const auto half = test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0}, {0.5f, 1});
  const scene::Scene scene = test::SceneBuilder().part(half).build();
  Request request = square_request("validity");
  request.nearest = false;
  request.size = {32, 32};
  const auto picture = BakedFolder("validity", {page}).nodes({0}).draw(scene, request);
  ASSERT_TRUE(picture) << picture.error().message;
  for (const Code& code : picture->pixels) EXPECT_EQ(code, (Code{204, 204, 204}));
}

TEST(View, SurfacesAreNotSeenFromBehindUnlessTheyHaveTwoSides) {
  // Two squares, one behind the other; the front one faces away from the camera.
  const auto away = test::quad({0, 0, 1}, {0, 1, 0}, {1, 0, 0});
  for (const bool double_sided : {false, true}) {
    test::SceneBuilder builder;
    scene::Material material{{0.5f, 0.5f, 0.5f}, {}, {}, {}};
    const auto plain = builder.material(material);
    material.double_sided = double_sided;
    const auto front = builder.material(material);
    builder.instance().part(unit_square(), plain).instance().part(away, front);
    const auto picture = BakedFolder("validity", {plain_page({1, 0, 0}), plain_page({0, 1, 0})})
                             .nodes({0, 1})
                             .draw(builder.build(), square_request("validity"));
    ASSERT_TRUE(picture) << picture.error().message;
    EXPECT_EQ(pixel(*picture, 1, 1), double_sided ? (Code{0, 255, 0}) : (Code{255, 0, 0}));
  }
}

TEST(View, WhatShowsNothingIsBackground) {
  const scene::Scene scene = test::SceneBuilder().part(unit_square()).build();
  BakedFolder baked("validity", {plain_page({1, 1, 1})});
  baked.nodes({0});
  Request request = square_request("validity");
  request.camera = "0.5,0.5,2:0.5,0.5,0:2";  // twice as high as the square
  const auto picture = baked.draw(scene, request);
  ASSERT_TRUE(picture) << picture.error().message;
  EXPECT_EQ(pixel(*picture, 0, 0), kBackground);
  EXPECT_EQ(pixel(*picture, 1, 1), (Code{255, 255, 255}));
  request.camera = "0.5,0.5,2:0.5,0.5,9:2";  // it looks the other way
  const auto away = baked.draw(scene, request);
  ASSERT_TRUE(away) << away.error().message;
  for (const Code& code : away->pixels) EXPECT_EQ(code, kBackground);
}

TEST(View, ShadedIsTheLightThatLeavesTheSurface) {
  test::SceneBuilder builder;
  const auto material =
      builder.material({{0.5f, 0.25f, 1}, {0, 0.5f, 0}, {}, {}});  // the albedo 1 is capped at 0.98
  const scene::Scene scene = builder.part(unit_square(), material).build();
  Request request = square_request("irradiance");
  request.shaded = true;
  request.exposure = 0.5f;
  const auto picture = BakedFolder("irradiance", {plain_page({math::kPi, math::kPi, math::kPi})})
                           .nodes({0})
                           .draw(scene, request);
  ASSERT_TRUE(picture) << picture.error().message;
  const image::PageImage expected{1, 1, {{0.5f, 0.75f, 0.98f}}, {1}};
  EXPECT_EQ(pixel(*picture, 2, 2), output::tone_map(expected, {0.5f}).at(0));
  EXPECT_EQ(picture->exposure, 0.5f);
}

TEST(View, LightHasTheToneCurveOfTheBake) {
  const scene::Scene scene = test::SceneBuilder().part(unit_square()).build();
  BakedFolder baked("irradiance", {page_of(4, [](auto x, auto) {
                      const float e = x < 2 ? 200.f : 20.f;
                      return math::Rgb{e, e, e};
                    })});
  baked.nodes({0}).manifest.settings.output.tone_curve = 0.1f;
  Request request = square_request("irradiance");
  const auto picture = baked.draw(scene, request);
  ASSERT_TRUE(picture) << picture.error().message;
  EXPECT_FLOAT_EQ(picture->exposure, 1 / 200.f) << "the brightest value is 1";
  EXPECT_EQ(pixel(*picture, 0, 1), (Code{232, 232, 232}));  // 1 / 1.1
  EXPECT_EQ(pixel(*picture, 3, 1), (Code{128, 128, 128}));  // 0.1 / 0.2
  request.exposure = 0.01f;
  const auto exposed = baked.draw(scene, request);
  ASSERT_TRUE(exposed) << exposed.error().message;
  const image::PageImage bright{1, 1, {{200, 200, 200}}, {1}};
  EXPECT_EQ(pixel(*exposed, 0, 1), output::tone_map(bright, {0.01f}).at(0)) << "the usual curve";
}

TEST(View, ASourceLiesOnItsPageAsTheManifestSays) {
  const auto page = page_of(4, [](auto x, auto y) {
    return x >= 2 && y >= 2 ? math::Rgb{1, 1, 0} : math::Rgb{0, 0, 1};
  });
  const scene::Scene scene = test::SceneBuilder().part(unit_square()).build();
  BakedFolder baked("validity", {page});
  baked.nodes({0});
  baked.manifest.nodes[0].scale = {0.5f, 0.5f};
  baked.manifest.nodes[0].offset = {0.5f, 0.5f};
  const Request request = square_request("validity");
  const auto source = baked.draw(scene, request, SceneKind::kSource);
  ASSERT_TRUE(source) << source.error().message;
  for (const Code& code : source->pixels) EXPECT_EQ(code, (Code{255, 255, 0}));
  EXPECT_EQ(pixel(*baked.draw(scene, request, SceneKind::kLit), 0, 0), (Code{0, 0, 255}));
  baked.manifest.nodes[0].uv_source = "unwrapped";
  const auto unwrapped = baked.draw(scene, request, SceneKind::kSource);
  ASSERT_FALSE(unwrapped);
  EXPECT_EQ(unwrapped.error().code, "invalid_scene");
  EXPECT_NE(unwrapped.error().message.find("lit.glb"), std::string::npos);
}

TEST(View, OtherScenesAreRefused) {
  const Request request = square_request("validity");
  BakedFolder baked("validity", {plain_page({1, 1, 1})});
  baked.nodes({0});
  test::Mesh bare = unit_square();
  bare.uv.clear();
  const auto no_uv = baked.draw(test::SceneBuilder().part(bare).build(), request);
  ASSERT_FALSE(no_uv);
  EXPECT_EQ(no_uv.error().code, "invalid_scene");
  test::SceneBuilder two;
  two.instance().part(unit_square()).instance().part(unit_square(), 0, {2, 0, 0});
  const auto more = baked.draw(two.build(), request);
  ASSERT_FALSE(more);
  EXPECT_EQ(more.error().details.at(0).pointer, "/nodes/1");
}

TEST(View, DamagedResultsAreErrors) {
  const scene::Scene scene = test::SceneBuilder().part(unit_square()).build();
  const Request request = square_request("validity");
  BakedFolder baked("validity", {plain_page({1, 1, 1})});
  baked.nodes({0});
  const auto code = [&](const char* what) {
    const auto picture = baked.draw(scene, request);
    EXPECT_FALSE(picture) << what;
    return picture ? "" : picture.error().code;
  };
  const proto::Manifest good = baked.manifest;
  baked.manifest.nodes[0].page = 1;
  EXPECT_EQ(code("a page that is not there"), "bad_document");
  baked.manifest = good;
  baked.manifest.pages[0].width = 5;
  EXPECT_EQ(code("another size"), "bad_document");
  baked.manifest = good;
  baked.manifest.pages[0].exr = "../page_00.exr";
  EXPECT_EQ(code("a name that leads elsewhere"), "bad_document");
  baked.manifest = good;
  baked.folder.write("page_00.exr", "no picture");
  EXPECT_EQ(code("another file"), "invalid_image");
}

TEST(View, WrongRequestsSayWhatIsWrong) {
  const scene::Scene scene = test::SceneBuilder().part(unit_square()).build();
  BakedFolder baked("normal", {plain_page({0, 0, 1})});
  baked.nodes({0});
  const auto expect = [&](const char* code, const char* pointer, auto change, const char* words) {
    Request request = square_request("normal");
    change(request);
    const auto picture = baked.draw(scene, request);
    ASSERT_FALSE(picture) << pointer;
    EXPECT_EQ(picture.error().code, code);
    EXPECT_EQ(picture.error().details.at(0).pointer, pointer);
    EXPECT_NE(picture.error().message.find(words), std::string::npos) << picture.error().message;
  };
  expect(
      "bad_request", "/query/layer", [](Request& r) { r.layer = "normals"; }, "`normal`");
  expect(
      "not_found", "/query/layer", [](Request& r) { r.layer = "area"; }, "`normal`");
  expect(
      "bad_request", "/query/shaded", [](Request& r) { r.shaded = true; }, "irradiance");
  expect(
      "bad_request", "/query/size",
      [](Request& r) {
        r.size = {4097, 1};
      },
      "4096");
  expect(
      "bad_request", "/query/size",
      [](Request& r) {
        r.size = {1, 0};
      },
      "1024x768");
  expect(
      "bad_request", "/query/exposure", [](Request& r) { r.exposure = 0.f; }, "over 0");
  expect(
      "bad_request", "/query/exposure", [](Request& r) { r.exposure = NAN; }, "over 0");
  expect(
      "not_found", "/query/camera", [](Request& r) { r.camera = "door"; }, "none at all");
  expect(
      "bad_request", "/query/camera", [](Request& r) { r.camera = "1,2:3,4,5"; }, "x,y,z");
}

TEST(View, UnlitMaterialsCannotBeShaded) {
  const scene::Scene scene = test::SceneBuilder().part(unit_square()).build();
  BakedFolder baked("irradiance", {plain_page({0, 0, 1})});
  baked.nodes({0});
  baked.manifest.settings.output.glb_mode = proto::GlbMode::kUnlit;
  Request request = square_request("irradiance");
  EXPECT_TRUE(baked.draw(scene, request));
  request.shaded = true;
  const auto picture = baked.draw(scene, request);
  ASSERT_FALSE(picture);
  EXPECT_EQ(picture.error().code, "bad_request");
  EXPECT_EQ(picture.error().details.at(0).pointer, "/query/shaded");
}

TEST(View, SizesAreTwoNumbers) {
  const auto size = parse_size("640x480");
  ASSERT_TRUE(size);
  EXPECT_EQ(size->width, 640u);
  EXPECT_EQ(size->height, 480u);
  for (const char* text : {"", "640", "640x", "x480", "640x480x2", "-1x5", "640 x 480", "640X480",
                           "99999999999x1", "1e3x5"})
    EXPECT_FALSE(parse_size(text)) << text;
}

/// A Cornell box baked in the folder, with some layers.
struct BakedBox {
  test::TempFolder folder;
  proto::Manifest manifest;
  scene::Scene scene;

  BakedBox() {
    baker::BakeInput in;
    in.files.main = folder.write("c.glb", generate::generate_glb("cornell").value());
    in.settings.atlas.page_size = 64;
    in.settings.solver.samples = in.settings.solver.direct_samples = 8;
    in.settings.solver.bounces = 1;
    in.settings.output.layers = {"irradiance", "normal", "albedo"};
    in.output_dir = folder.path();
    exec::ThreadPool pool(2);
    baker::BakeObserver quiet;
    manifest = test::must(baker::bake(in, pool, {}, quiet));
    scene = test::must(import::import_files({folder.path() / "lit.glb", {}}));
  }
  Picture draw(const Request& request, unsigned threads = 2) const {
    exec::ThreadPool pool(threads);
    return test::must(view::draw(folder.path(), test::must(read_manifest(folder.path())), scene,
                                 SceneKind::kLit, request, pool, {}));
  }
};

TEST(View, ACornellBoxHasTheColorsOfItsWalls) {
  const BakedBox box;
  Request request;
  request.layer = "normal";
  request.size = {64, 64};
  request.camera = "0,4.4,8:0,4.4,0:40";  // over the blocks
  const Picture normal = box.draw(request);
  const std::pair<std::pair<unsigned, unsigned>, Code> walls[] = {
      {{2, 32}, {255, 128, 128}},   // left, towards +X
      {{61, 32}, {0, 128, 128}},    // right
      {{32, 32}, {128, 128, 255}},  // back
      {{32, 18}, {128, 0, 128}}};   // ceiling
  for (const auto& [at, code] : walls)
    for (std::size_t c = 0; c < 3; ++c)
      EXPECT_NEAR(pixel(normal, at.first, at.second)[c], code[c], 1)
          << at.first << " " << at.second << " " << c;
  request.layer = "albedo";
  const Picture albedo = box.draw(request);
  const std::pair<std::pair<unsigned, unsigned>, math::Rgb> paints[] = {
      {{2, 32}, {0.63f, 0.065f, 0.05f}}, {{61, 32}, {0.14f, 0.45f, 0.091f}}};
  for (const auto& [at, paint] : paints) {
    const Code code = pixel(albedo, at.first, at.second);
    EXPECT_NEAR(code[0], output::encode_srgb(paint.r), 1);
    EXPECT_NEAR(code[1], output::encode_srgb(paint.g), 1);
    EXPECT_NEAR(code[2], output::encode_srgb(paint.b), 1);
  }
}

TEST(View, AnyNumberOfThreadsDrawsTheSame) {
  const BakedBox box;
  Request request;
  request.size = {200, 131};  // not whole tiles, nor whole blocks
  const Picture one = box.draw(request, 1);
  for (const unsigned threads : {2u, 3u, 8u}) {
    const Picture other = box.draw(request, threads);
    EXPECT_EQ(other.pixels, one.pixels) << threads;
    EXPECT_EQ(other.exposure, one.exposure);
  }
  std::set<Code> colors(one.pixels.begin(), one.pixels.end());
  EXPECT_GT(colors.size(), 100u);
}

TEST(View, StopsWhenTold) {
  const scene::Scene scene = test::SceneBuilder().part(unit_square()).build();
  std::stop_source stop;
  stop.request_stop();
  const auto picture =
      BakedFolder("validity", {plain_page({1, 1, 1})})
          .nodes({0})
          .draw(scene, square_request("validity"), SceneKind::kLit, 2, stop.get_token());
  ASSERT_FALSE(picture);
  EXPECT_EQ(picture.error().code, proto::kCanceledCode);
}

TEST(View, TheManifestMustBeThere) {
  const test::TempFolder folder;
  const auto none = read_manifest(folder.path());
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, "not_found");
  folder.write("manifest.json", "{");
  EXPECT_EQ(read_manifest(folder.path()).error().code, "bad_document");
  folder.write("manifest.json", "{}");
  EXPECT_EQ(read_manifest(folder.path()).error().code, "bad_document");
}

}  // namespace
}  // namespace kiln::view
