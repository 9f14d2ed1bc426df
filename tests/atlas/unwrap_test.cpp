#include <gtest/gtest.h>

#include <set>

#include "baker/atlas/atlas.h"
#include "tests/atlas/atlas_checks.h"
#include "tests/support/scenes.h"

namespace kiln::atlas {
namespace {

using proto::AtlasSettings;
using test::Mesh;
using test::quad;
using test::SceneBuilder;

proto::AtlasSettings page(std::uint32_t size, std::uint32_t gutter = 4) {
  AtlasSettings s;
  s.page_size = size;
  s.gutter = gutter;
  return s;
}

/// A height field of n x n cells with smooth hills and steep flanks.
Mesh terrain(std::uint32_t n) {
  Mesh m;
  for (std::uint32_t z = 0; z <= n; ++z) {
    for (std::uint32_t x = 0; x <= n; ++x) {
      const float u = float(x) / float(n), v = float(z) / float(n);
      m.positions.push_back({20 * u, 2 * std::sin(9 * u) * std::cos(7 * v) + 3 * u * v, 20 * v});
    }
  }
  for (std::uint32_t z = 0; z < n; ++z) {
    for (std::uint32_t x = 0; x < n; ++x) {
      const std::uint32_t a = z * (n + 1) + x, b = a + 1, c = a + n + 1, d = c + 1;
      m.triangles.push_back({a, c, b});
      m.triangles.push_back({b, c, d});
    }
  }
  return m;
}

/// Loose triangles of random place, size and direction.
Mesh soup(std::uint32_t count) {
  std::uint32_t state = 1;
  const auto random = [&] {
    state = state * 1664525u + 1013904223u;
    return float(state >> 8) * 0x1p-24f;
  };
  Mesh m;
  for (std::uint32_t i = 0; i < count; ++i) {
    const math::Vec3 center{10 * random(), 10 * random(), 10 * random()};
    for (std::uint32_t k = 0; k < 3; ++k) {
      m.positions.push_back(center + math::Vec3{random(), random(), random()});
    }
    m.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  return m;
}

/// A ramp that winds around the y axis `turns` times: seen from above it lies on itself.
Mesh spiral(std::uint32_t turns) {
  Mesh m;
  const std::uint32_t per_turn = 24;
  for (std::uint32_t i = 0; i <= turns * per_turn; ++i) {
    const float a = 2 * math::kPi * float(i) / per_turn, y = 0.02f * float(i);
    m.positions.push_back({std::cos(a), y, -std::sin(a)});
    m.positions.push_back({2 * std::cos(a), y, -2 * std::sin(a)});
    if (i == 0) continue;
    const std::uint32_t b = 2 * i;
    m.triangles.push_back({b - 2, b - 1, b + 1});
    m.triangles.push_back({b - 2, b + 1, b});
  }
  return m;
}

Atlas unwrap(const scene::Scene& scene, const AtlasSettings& settings, double slack = 1e-3) {
  auto atlas = build_atlas(scene, settings);
  EXPECT_TRUE(atlas) << atlas.error().message;
  if (!atlas) return {};
  expect_consistent(scene, *atlas);
  expect_gutter(*atlas, int(settings.gutter), slack);
  return std::move(*atlas);
}

TEST(Unwrap, CubeHasSixCharts) {
  const scene::Scene scene = SceneBuilder().part(test::cube(2)).build();
  const Atlas atlas = unwrap(scene, page(128));
  EXPECT_EQ(atlas.charts.size(), 6u);
  EXPECT_EQ(atlas.page_count, 1u);
  EXPECT_EQ(atlas.placements[0].reason, "primitive 0 has no TEXCOORD_1");
  // Squares of whole texels: six fit side by side, three by two, at (128 - 4 * 4) / 3 texels at
  // most; less would waste more than the packer does.
  for (const Chart& c : atlas.charts) {
    EXPECT_EQ(c.max.x - c.min.x, c.max.y - c.min.y);
    EXPECT_EQ(c.min.x, std::floor(c.min.x));
    EXPECT_NEAR(c.max.x - c.min.x, 37, 1);
  }
  EXPECT_NEAR(atlas.texels_per_metre, 18.5, 0.5);
}

TEST(Unwrap, SphereTerrainAndSoupKeepTheirGutters) {
  unwrap(SceneBuilder().part(test::sphere(1, 24)).build(), page(256));
  unwrap(SceneBuilder().part(terrain(60)).build(), page(256, 2));
  unwrap(SceneBuilder().part(soup(300)).build(), page(256, 1));
  unwrap(SceneBuilder().part(soup(100)).build(), page(128, 0));
}

TEST(Unwrap, SpiralIsCutIntoItsTurns) {
  // The mean normal is not quite the axis, so turns end askew: overlaps under half a texel stay.
  const Atlas atlas = unwrap(SceneBuilder().part(spiral(5)).build(), page(256), 0.5);
  EXPECT_GE(atlas.charts.size(), 5u);
  EXPECT_LE(atlas.charts.size(), 10u);
}

TEST(Unwrap, NoFaceIsFlippedAndFewAreSqueezed) {
  const scene::Scene scene = SceneBuilder().part(test::sphere(1, 24)).part(terrain(40)).build();
  const Atlas atlas = unwrap(scene, page(512));
  for (std::uint32_t t = 0; t < atlas.triangles.size(); ++t) {
    const UvTriangle uv(atlas, t);
    EXPECT_GT(uv.det, 0);
    // At most 65 degrees off the chart's plane: cos 65 of the density in one direction.
    const double density2 = uv.area() / double(triangle_area(scene, t));
    EXPECT_GT(density2, 0.40 * double(atlas.texels_per_metre * atlas.texels_per_metre));
  }
}

TEST(Unwrap, TinyChartsGetATexel) {
  const scene::Scene scene = SceneBuilder()
                                 .part(test::quad({0, 0, 0}, {100, 0, 0}, {0, 100, 0}))
                                 .part(test::quad({0, 0, 9}, {0.01f, 0, 0}, {0, 0.01f, 0}))
                                 .build();
  AtlasSettings settings = page(128);
  settings.unwrap = proto::Unwrap::kAlways;
  const Atlas atlas = unwrap(scene, settings);
  ASSERT_EQ(atlas.charts.size(), 2u);
  EXPECT_EQ(atlas.charts[1].max - atlas.charts[1].min, (math::Vec2{1, 1}));
}

TEST(Unwrap, TwoInstancesOfOneMeshGetTwoPlaces) {
  SceneBuilder builder;
  builder.instance(0).part(test::cube(1));
  builder.instance(0).part(test::cube(1), 0, {5, 0, 0});
  const Atlas atlas = unwrap(builder.build(), page(128));
  EXPECT_EQ(atlas.charts.size(), 12u);
}

TEST(Unwrap, DensityFillsPagesAsNeeded) {
  SceneBuilder builder;
  for (int i = 0; i < 10; ++i) builder.instance().part(test::cube(1), 0, {2.f * float(i), 0, 0});
  const scene::Scene scene = builder.build();
  AtlasSettings settings = page(128);
  settings.texels_per_metre = 20.f;  // six charts of 20 x 20 and gutters: 3456 of 15376 texels
  const Atlas atlas = unwrap(scene, settings);
  EXPECT_EQ(atlas.page_count, 3u);
  EXPECT_EQ(atlas.texels_per_metre, 20.f);
  settings.max_pages = 2;
  const auto refused = build_atlas(scene, settings);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, "atlas_full");
  EXPECT_EQ(refused.error().details.at(0).pointer, "/atlas/texels_per_metre");
  // The density that the error names does fit.
  const std::string& text = refused.error().message;
  settings.texels_per_metre = std::stof(text.substr(text.find("; ") + 2));
  EXPECT_LT(*settings.texels_per_metre, 20.f);
  EXPECT_GT(*settings.texels_per_metre, 12.f);
  EXPECT_EQ(unwrap(scene, settings).page_count, 2u);
}

/// The number behind `name` in the error of an atlas that is too small; 0 where it has none.
std::uint32_t advised(const scene::Scene& scene, const AtlasSettings& settings,
                      const std::string& name) {
  const auto refused = build_atlas(scene, settings);
  EXPECT_FALSE(refused);
  if (refused) return 0;
  EXPECT_EQ(refused.error().code, "atlas_full");
  EXPECT_EQ(refused.error().details.at(0).detail, refused.error().message);
  const auto at = refused.error().message.rfind("; ");
  const auto found = refused.error().message.find(name + " ", at);
  return found == std::string::npos
             ? 0
             : std::uint32_t(std::stoul(refused.error().message.substr(found + name.size())));
}

bool fits(const scene::Scene& scene, AtlasSettings settings, std::uint32_t page_size,
          std::uint32_t max_pages) {
  settings.page_size = page_size;
  settings.max_pages = max_pages;
  return bool(build_atlas(scene, settings));
}

TEST(Unwrap, TooManyChartsIsAnErrorThatSaysWhatWouldDo) {
  const scene::Scene scene = SceneBuilder().part(soup(2000)).build();
  const auto atlas = build_atlas(scene, page(64));
  ASSERT_FALSE(atlas);
  EXPECT_NE(atlas.error().message.find("2000 charts"), std::string::npos);
  // All of one node, so that more pages are of no use.
  EXPECT_EQ(advised(scene, page(64), "atlas.max_pages"), 0u);
  EXPECT_EQ(advised(scene, page(64), "atlas.page_size"), 256u);
  EXPECT_TRUE(fits(scene, page(64), 256, 8));
  EXPECT_FALSE(fits(scene, page(64), 128, 8));
}

TEST(Unwrap, AnErrorNamesTheFewestPagesThatWouldDo) {
  SceneBuilder builder;
  for (int i = 0; i < 40; ++i) builder.instance().part(soup(10), 0, {12.f * float(i), 0, 0});
  const scene::Scene scene = builder.build();
  AtlasSettings settings = page(64);
  for (const std::optional<float> density : {std::optional<float>(), {2.f}, {20.f}}) {
    settings.texels_per_metre = density;
    settings.max_pages = 1;
    const auto pages = advised(scene, settings, "atlas.max_pages"),
               size = advised(scene, settings, "atlas.page_size");
    ASSERT_GT(pages, 1u);
    EXPECT_TRUE(fits(scene, settings, 64, pages));
    EXPECT_FALSE(fits(scene, settings, 64, pages - 1));
    ASSERT_GT(size, 64u);
    EXPECT_TRUE(fits(scene, settings, size, 1));
    EXPECT_FALSE(fits(scene, settings, size / 2, 1));
  }
}

TEST(Unwrap, ADensityThatNoPageHoldsIsBestLeftOut) {
  const scene::Scene scene = SceneBuilder().part(soup(2000)).build();
  AtlasSettings settings = page(64);
  settings.texels_per_metre = 1e5f;
  const auto refused = build_atlas(scene, settings);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("; without atlas.texels_per_metre, atlas.page_size 256"),
            std::string::npos)
      << refused.error().message;
  settings.gutter = 0;
  settings.page_size = 16;
  settings.texels_per_metre.reset();
  EXPECT_EQ(advised(scene, settings, "atlas.page_size"), 64u);
}

TEST(Unwrap, SpillsOntoMorePagesOnlyWhenOneCannotHoldTheCharts) {
  SceneBuilder builder;
  for (int i = 0; i < 40; ++i) builder.instance().part(soup(10), 0, {12.f * float(i), 0, 0});
  const Atlas atlas = unwrap(builder.build(), page(64));  // at most 144 charts of one texel a page
  EXPECT_EQ(atlas.page_count, 3u);
}

TEST(Unwrap, ChartsDoNotMixSidedness) {
  SceneBuilder builder;
  scene::Material one, two;
  two.double_sided = true;
  builder.material(one), builder.material(two);
  builder.part(test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}), 0);
  builder.part(test::quad({1, 0, 0}, {1, 0, 0}, {0, 1, 0}), 1);
  builder.part(test::quad({2, 0, 0}, {1, 0, 0}, {0, 1, 0}), 1);
  const scene::Scene scene = builder.build();
  AtlasSettings settings = page(64);
  settings.unwrap = proto::Unwrap::kAlways;
  EXPECT_EQ(unwrap(scene, settings).charts.size(), 2u);
}

TEST(Unwrap, SameInputSameAtlas) {
  const scene::Scene scene = SceneBuilder().part(test::sphere(1, 16)).part(soup(100)).build();
  const auto a = build_atlas(scene, page(256)), b = build_atlas(scene, page(256));
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->triangle_chart, b->triangle_chart);
  ASSERT_EQ(a->vertices.size(), b->vertices.size());
  for (std::size_t i = 0; i < a->vertices.size(); ++i) {
    EXPECT_EQ(a->vertices[i].uv, b->vertices[i].uv);
  }
}

TEST(Unwrap, StopsWhenTold) {
  std::stop_source stop;
  stop.request_stop();
  const auto atlas =
      build_atlas(SceneBuilder().part(test::cube(1)).build(), page(64), stop.get_token());
  ASSERT_FALSE(atlas);
  EXPECT_EQ(atlas.error().code, proto::kCanceledCode);
}

}  // namespace
}  // namespace kiln::atlas
