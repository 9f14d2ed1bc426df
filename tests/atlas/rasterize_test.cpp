#include <gtest/gtest.h>

#include <cstring>
#include <numeric>

#include "baker/atlas/atlas.h"
#include "baker/atlas/texture_group.h"
#include "baker/exec/thread_pool.h"
#include "tests/support/scenes.h"

namespace kiln::atlas {
namespace {

using test::Mesh;
using test::quad;
using test::SceneBuilder;

/// The scene's own layout on one page, unchecked: what the rasterizer sees of valid TEXCOORD_1.
Atlas as_is(const scene::Scene& scene, std::uint32_t page_size) {
  Atlas atlas;
  atlas.page_size = page_size;
  atlas.page_count = 1;
  for (std::uint32_t v = 0; v < scene.positions.size(); ++v) {
    atlas.vertices.push_back({v, scene.lightmap_uv[v] * float(page_size)});
  }
  atlas.triangles = scene.triangles;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    atlas.triangle_chart.push_back(scene.triangle_part[t]);
  }
  atlas.charts.resize(scene.parts.size());
  return atlas;
}

double sum(const std::vector<float>& v) {
  return std::accumulate(v.begin(), v.end(), 0.0);
}

double surface_area(const scene::Scene& scene) {
  double sum = 0;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    sum += double(triangle_area(scene, t));
  }
  return sum;
}

/// Every point lies in its triangle, in its texel's square, and on its texel's chart.
void expect_points_inside(const Atlas& atlas, const TextureGroup& group) {
  for (std::uint32_t t = 0; t < group.size(); ++t) {
    for (const SamplePoint& p : group.points_of(t)) {
      ASSERT_LE(unsigned(p.u) + p.v, 65535u);
      ASSERT_EQ(atlas.triangle_chart[p.triangle], group.chart[t]);
      const math::Vec2 at = atlas.uv_at(p.triangle, p.bary());
      // 1/65535 of the triangle's size on the page, at most the page's diagonal, and float
      // rounding.
      const float slack = 2.f * float(atlas.page_size) / 65535.f + 1e-3f;
      ASSERT_GE(at.x, float(group.x[t]) - slack);
      ASSERT_LE(at.x, float(group.x[t] + 1) + slack);
      ASSERT_GE(at.y, float(group.y[t]) - slack);
      ASSERT_LE(at.y, float(group.y[t] + 1) + slack);
    }
  }
}

TEST(Rasterize, QuadOnWholeTexelsCoversExactlyThese) {
  const scene::Scene scene =
      SceneBuilder()
          .part(test::quad({0, 0, 0}, {2, 0, 0}, {0, 3, 0}, {0.25f, 0.5f}, {0.75f, 1}))
          .build();
  const auto group = rasterize(scene, as_is(scene, 16));
  ASSERT_TRUE(group);
  EXPECT_EQ(group->size(), 8u * 8u);
  EXPECT_EQ(group->front_count, group->size());
  for (std::uint32_t t = 0; t < group->size(); ++t) {
    EXPECT_GE(group->x[t], 4);
    EXPECT_LT(group->x[t], 12);
    EXPECT_GE(group->y[t], 8);
    EXPECT_NEAR(group->coverage[t], 1, 1e-6);
    EXPECT_NEAR(group->area_m2[t], 6.0 / 64, 1e-6);
    EXPECT_EQ(group->shading_normal[t], (math::Vec3{0, 0, 1}));
    // Texel (4, 8) is the corner with uv_min, where the quad's corner lies.
    EXPECT_NEAR(group->position[t].x, (group->x[t] - 4 + 0.5) / 8 * 2, 1e-3);
    EXPECT_NEAR(group->position[t].y, (group->y[t] - 8 + 0.5) / 8 * 3, 1e-3);
    const std::size_t at = std::size_t(group->y[t]) * 16 + group->x[t];
    EXPECT_EQ(group->pages[0].texel_at[at], std::int32_t(t));
  }
}

TEST(Rasterize, KnownPartialCoverage) {
  // One triangle: the lower left half of the page, cut along texel diagonals.
  Mesh half{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 0}, {1, 0}, {0, 1}}, {{0, 1, 2}}};
  const scene::Scene scene = SceneBuilder().part(half).build();
  const auto group = rasterize(scene, as_is(scene, 8));
  ASSERT_TRUE(group);
  EXPECT_EQ(group->size(), 36u);
  for (std::uint32_t t = 0; t < group->size(); ++t) {
    const bool diagonal = group->x[t] + group->y[t] == 7;
    EXPECT_NEAR(group->coverage[t], diagonal ? 0.5 : 1.0, 1e-6);
    const double third = diagonal ? 1.0 / 3 : 0.5;  // centroid of a half square: a third in
    EXPECT_NEAR(group->position[t].x, (group->x[t] + third) / 8, 1e-4);
    EXPECT_NEAR(group->position[t].y, (group->y[t] + third) / 8, 1e-4);
  }
}

TEST(Rasterize, TexelThatIsOnlyTouchedIsIncluded) {
  // Reaches 1/50 texel into the second column.
  const scene::Scene scene =
      SceneBuilder()
          .part(test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0}, {1.02f / 4, 1}))
          .build();
  const auto group = rasterize(scene, as_is(scene, 4));
  ASSERT_TRUE(group);
  EXPECT_EQ(group->size(), 8u);
  for (std::uint32_t t = 0; t < group->size(); ++t) {
    EXPECT_NEAR(group->coverage[t], group->x[t] == 0 ? 1 : 0.02, 1e-5);
  }
  expect_points_inside(as_is(scene, 4), *group);
}

TEST(Rasterize, AreasSumToTheSurface) {
  // A fan of odd angles, so that texels hold pieces of many triangles.
  Mesh fan;
  fan.positions.push_back({0, 0, 0});
  fan.uv.push_back({0.503f, 0.497f});
  for (int i = 0; i <= 37; ++i) {
    const float a = 2 * math::kPi * float(i) / 37, r = i % 2 ? 0.47f : 0.31f;
    fan.positions.push_back({3 * std::cos(a), 2 * std::sin(a), std::sin(3 * a)});
    fan.uv.push_back({0.503f + r * std::cos(a), 0.497f + r * std::sin(a)});
    if (i > 0) fan.triangles.push_back({0, std::uint32_t(i), std::uint32_t(i + 1)});
  }
  const scene::Scene scene = SceneBuilder().part(fan).build();
  for (const std::uint32_t size : {1u, 7u, 64u, 301u}) {
    const Atlas atlas = as_is(scene, size);
    const auto group = rasterize(scene, atlas);
    ASSERT_TRUE(group);
    EXPECT_NEAR(sum(group->area_m2) / surface_area(scene), 1, 1e-6) << size;
    expect_points_inside(atlas, *group);
  }
}

TEST(Rasterize, PointsAreSpreadByArea) {
  // Mean over the points of a linear function is near its mean over the footprint. For 16 points
  // stratified one by one the error of a mean over a unit length is at most 1/16 on one axis.
  const scene::Scene scene =
      SceneBuilder().part(test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0})).build();
  const Atlas atlas = as_is(scene, 32);
  const auto group = rasterize(scene, atlas);
  ASSERT_TRUE(group);
  double worst = 0, total = 0;
  for (std::uint32_t t = 0; t < group->size(); ++t) {
    math::Vec2 mean;
    for (const SamplePoint& p : group->points_of(t))
      mean = mean + atlas.uv_at(p.triangle, p.bary());
    mean = mean * (1.f / 16);
    const double dx = double(mean.x) - group->x[t] - 0.5, dy = double(mean.y) - group->y[t] - 0.5;
    worst = std::max({worst, std::abs(dx), std::abs(dy)});
    total += dx + dy;
  }
  EXPECT_LE(worst, 1.0 / 32 + 1e-3);  // each point is within half a stratum of its middle
  // Each of 2*1024 means has variance 1/(12 * 16^3).
  EXPECT_LE(std::abs(total), 5 * std::sqrt(2 * 1024 / (12.0 * 4096)) + 2048 * 2e-5);
}

TEST(Rasterize, TexelOfTwoChartsGoesToTheOneThatCoversMost) {
  SceneBuilder builder;
  builder.part(test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0}, {0.55f, 1}));
  builder.part(test::quad({0, 0, 5}, {4, 0, 0}, {0, 1, 0}, {0.55f, 0}, {1, 1}));
  const scene::Scene scene = builder.build();
  const Atlas atlas = as_is(scene, 2);  // chart 0 takes column 0 and 10 % of column 1
  const auto group = rasterize(scene, atlas);
  ASSERT_TRUE(group);
  ASSERT_EQ(group->size(), 4u);
  for (std::uint32_t t = 0; t < 4; ++t) EXPECT_EQ(group->chart[t], group->x[t] == 0 ? 0u : 1u);
  // What chart 0 loses falls to its nearest texel: nothing of either surface is lost.
  for (std::uint32_t t = 0; t < 4; ++t) {
    EXPECT_NEAR(group->area_m2[t], group->x[t] == 0 ? 0.5 : 2.0, 1e-6);
    EXPECT_NEAR(group->coverage[t], group->x[t] == 0 ? 1.0 : 0.9, 1e-6);
  }
  expect_points_inside(atlas, *group);
}

TEST(Rasterize, FlatTriangleGivesItsAreaToItsChart) {
  Mesh mesh = test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  mesh.positions.push_back({0.5f, -1, 0});  // below the lower edge, squeezed onto it in uv
  mesh.uv.push_back({0.5f, 0});
  mesh.triangles.push_back({0, 4, 1});
  const scene::Scene scene = SceneBuilder().part(mesh).build();
  const auto group = rasterize(scene, as_is(scene, 8));
  ASSERT_TRUE(group);
  EXPECT_EQ(group->size(), 64u);
  EXPECT_NEAR(sum(group->area_m2), 1.5, 1e-5);
}

TEST(Rasterize, DoubleSidedSurfacesHaveTwins) {
  SceneBuilder builder;
  scene::Material one, two;
  one.base_color = {0.3f, 0.3f, 0.3f};
  two.base_color = {1, 0.5f, 0.25f};
  two.double_sided = true;
  builder.material(one), builder.material(two);
  builder.part(test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0}, {0.5f, 1}), 0);
  builder.part(test::quad({0, 0, 5}, {1, 0, 0}, {0, 1, 0}, {0.5f, 0}, {1, 1}), 1);
  const scene::Scene scene = builder.build();
  const auto group = rasterize(scene, as_is(scene, 8));
  ASSERT_TRUE(group);
  EXPECT_EQ(group->front_count, 64u);
  EXPECT_EQ(group->size(), 96u);
  EXPECT_EQ(group->albedo_capped, 32u);  // the twins are not counted again
  std::uint32_t twins = 0;
  for (std::uint32_t t = 0; t < group->front_count; ++t) {
    EXPECT_EQ(group->back[t] >= 0, group->chart[t] == 1);
    if (group->back[t] < 0) continue;
    const auto b = std::uint32_t(group->back[t]);
    ++twins;
    EXPECT_TRUE(group->is_back(b));
    EXPECT_EQ(group->back[b], -1);
    EXPECT_EQ(group->shading_normal[b], -group->shading_normal[t]);
    EXPECT_EQ(group->position[b], group->position[t]);
    EXPECT_EQ(group->albedo[b], group->albedo[t]);
    EXPECT_EQ(group->albedo[b].r, scene::kMaxAlbedo);
    EXPECT_NEAR(group->albedo[b].b, 0.25f, 1e-6);
    EXPECT_EQ(group->area_m2[b], group->area_m2[t]);
    EXPECT_EQ(group->points_of(b)[15].u, group->points_of(t)[15].u);
  }
  EXPECT_EQ(twins, 32u);
  EXPECT_EQ(group->points.size(), 96u * 16);
}

TEST(Rasterize, TexelsAreSortedByBlocks) {
  const scene::Scene scene =
      SceneBuilder().part(test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0})).build();
  const auto group = rasterize(scene, as_is(scene, 20));
  ASSERT_TRUE(group);
  const auto key = [&](std::uint32_t t) {
    const std::uint32_t x = group->x[t], y = group->y[t];
    return std::tuple(y / 8, x / 8, y % 8, x % 8);
  };
  ASSERT_EQ(group->size(), 400u);
  for (std::uint32_t t = 1; t < group->size(); ++t) EXPECT_LT(key(t - 1), key(t));
}

TEST(Rasterize, StopsWhenTold) {
  const scene::Scene scene =
      SceneBuilder().part(test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0})).build();
  std::stop_source stop;
  stop.request_stop();
  const auto group = rasterize(scene, as_is(scene, 64), stop.get_token());
  ASSERT_FALSE(group);
  EXPECT_EQ(group.error().code, proto::kCanceledCode);
}

// Textures ----------------------------------------------------------------------------------------

using Texel8 = std::array<std::uint8_t, 4>;

/// Red in every other column, green in every other row, blue without a pattern.
Texel8 pattern(std::uint32_t x, std::uint32_t y) {
  return {std::uint8_t(x % 2 ? 255 : 0), std::uint8_t(y % 2 ? 255 : 0),
          std::uint8_t((x * 37 + y * 101) % 256), 255};
}

/// Adds an image of side x side pixels to the scene, seen without interpolation.
scene::Texture add_image(scene::Scene& scene, std::uint32_t side,
                         Texel8 (*color)(std::uint32_t, std::uint32_t)) {
  scene.images.push_back({side, side, scene.image_texels.size()});
  for (std::uint32_t y = 0; y < side; ++y) {
    for (std::uint32_t x = 0; x < side; ++x) scene.image_texels.push_back(color(x, y));
  }
  return {std::int32_t(scene.images.size() - 1), scene::Wrap::kRepeat, scene::Wrap::kRepeat, true};
}

/// Mean of the 2 x 2 pixels that lie under a texel.
math::Rgb pattern_mean(std::uint32_t x, std::uint32_t y) {
  math::Rgb sum;
  for (std::uint32_t i = 0; i < 4; ++i) {
    const Texel8 c = pattern(2 * x + i % 2, 2 * y + i / 2);
    sum += math::Rgb{scene::srgb_to_linear(c[0]), scene::srgb_to_linear(c[1]),
                     scene::srgb_to_linear(c[2])};
  }
  return sum * 0.25f;
}

void expect_color(math::Rgb actual, math::Rgb expected) {
  EXPECT_NEAR(actual.r, expected.r, 1e-5f * std::max(1.f, expected.r));
  EXPECT_NEAR(actual.g, expected.g, 1e-5f * std::max(1.f, expected.g));
  EXPECT_NEAR(actual.b, expected.b, 1e-5f * std::max(1.f, expected.b));
}

/// Makes a parallelogram, slanted by `slant`, with a texture of `side` pixels over its lightmap
/// UVs.
scene::Scene textured_quad(float slant, math::Rgb color, std::uint32_t side) {
  SceneBuilder b;
  b.part(test::quad({0, 0, 0}, {1, 0, 0}, {slant, 1, 0}));
  scene::Scene scene = b.build();
  scene.base_uv = scene.lightmap_uv;
  scene.materials[0].base_color = color;
  scene.materials[0].base_texture = add_image(scene, side, pattern);
  return scene;
}

// Four pixels to a texel, and sixteen points of which each pixel gets four: the mean is exact.
TEST(Rasterize, AlbedoIsTheTexturesMeanOverTheFootprint) {
  const scene::Scene scene = textured_quad(0, {0.9f, 0.5f, 0.25f}, 16);
  const auto group = rasterize(scene, as_is(scene, 8));
  ASSERT_TRUE(group);
  ASSERT_EQ(group->size(), 64u);
  for (std::uint32_t t = 0; t < group->size(); ++t)
    expect_color(group->albedo[t],
                 math::Rgb{0.9f, 0.5f, 0.25f} * pattern_mean(group->x[t], group->y[t]));
}

template <class T>
void expect_same_bytes(const std::vector<T>& a, const std::vector<T>& b) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(T)), 0);
}

TEST(Rasterize, AnyNumberOfThreadsGivesTheSameBits) {
  const scene::Scene scene = textured_quad(0.3f, {1, 1, 1}, 64);
  const Atlas atlas = as_is(scene, 150);
  const auto alone = rasterize(scene, atlas);
  ASSERT_TRUE(alone);
  EXPECT_GT(alone->albedo_capped, 0u);
  for (const unsigned threads : {1u, 4u}) {
    exec::ThreadPool pool(threads);
    const auto group = rasterize(scene, atlas, {}, kMaxBandPieces, &pool);
    ASSERT_TRUE(group);
    EXPECT_EQ(group->front_count, alone->front_count);
    EXPECT_EQ(group->albedo_capped, alone->albedo_capped);
    expect_same_bytes(group->position, alone->position);
    expect_same_bytes(group->shading_normal, alone->shading_normal);
    expect_same_bytes(group->albedo, alone->albedo);
    expect_same_bytes(group->area_m2, alone->area_m2);
    expect_same_bytes(group->coverage, alone->coverage);
    expect_same_bytes(group->triangle, alone->triangle);
    expect_same_bytes(group->chart, alone->chart);
    expect_same_bytes(group->x, alone->x);
    expect_same_bytes(group->y, alone->y);
    expect_same_bytes(group->points, alone->points);
  }
}

// A texel that two materials share holds the mean of both, by area.
TEST(Rasterize, TexelOfATexturedAndAPlainFaceMixesThem) {
  SceneBuilder b;
  b.part(test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0}, {0.5f, 1}));
  const auto plain = b.material({{0.2f, 0.2f, 0.2f}, {40, 40, 40}, {}, {}});
  b.part(test::quad({1, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0.5f, 0}, {1, 1}), plain);
  scene::Scene scene = b.build();
  scene.base_uv = scene.lightmap_uv;
  scene.materials[0].base_color = {1, 1, 1};
  scene.materials[0].base_texture =
      add_image(scene, 2, [](std::uint32_t, std::uint32_t y) -> Texel8 {
        return y == 0 ? Texel8{255, 255, 255, 255} : Texel8{0, 0, 0, 255};
      });
  Atlas atlas = as_is(scene, 1);
  atlas.triangle_chart.assign(4, 0);  // one chart of two parts
  atlas.charts.resize(1);
  const auto group = rasterize(scene, atlas);
  ASSERT_TRUE(group);
  ASSERT_EQ(group->size(), 1u);
  expect_color(group->albedo[0], math::Rgb{1, 1, 1} * (0.25f * 1 + 0.25f * 0 + 0.5f * 0.2f));
}

TEST(Rasterize, AlbedoOverTheCapIsCutAndCounted) {
  scene::Scene scene = SceneBuilder().part(test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0})).build();
  scene.materials[0].base_color = {1, 0.5f, 1};
  const auto group = rasterize(scene, as_is(scene, 4));
  ASSERT_TRUE(group);
  EXPECT_EQ(group->albedo_capped, 16u);
  expect_color(group->albedo[0], {scene::kMaxAlbedo, 0.5f, scene::kMaxAlbedo});
}

TEST(Rasterize, TooManyTrianglesInAFewRowsAreRefused) {
  SceneBuilder b;
  for (int i = 0; i < 10; ++i) b.part(test::quad({0, 0, float(i)}, {1, 0, 0}, {0, 1, 0}));
  const scene::Scene scene = b.build();
  const Atlas atlas = as_is(scene, 16);
  // Eight rows of 16 texels, ten times; those on a quad's diagonal hold pieces of two triangles.
  const std::size_t pieces = 10 * (8 * 16 + 8);
  EXPECT_TRUE(rasterize(scene, atlas, {}, pieces));
  const auto refused = rasterize(scene, atlas, {}, pieces - 1);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, "limit_exceeded");
}

}  // namespace
}  // namespace kiln::atlas
