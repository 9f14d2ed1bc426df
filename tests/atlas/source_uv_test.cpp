#include <gtest/gtest.h>

#include <limits>

#include "baker/atlas/atlas.h"
#include "baker/atlas/texture_group.h"
#include "tests/atlas/atlas_checks.h"
#include "tests/support/scenes.h"

namespace kiln::atlas {
namespace {

using proto::AtlasSettings;
using test::Mesh;
using test::quad;
using test::SceneBuilder;

proto::AtlasSettings page(std::uint32_t size) {
  AtlasSettings s;
  s.page_size = size;
  return s;
}

Atlas build(const scene::Scene& scene, const AtlasSettings& settings = page(128)) {
  auto atlas = build_atlas(scene, settings);
  EXPECT_TRUE(atlas) << atlas.error().message;
  if (!atlas) return {};
  expect_consistent(scene, *atlas);
  return std::move(*atlas);
}

Mesh floor_at(float height, math::Vec2 uv_min, math::Vec2 uv_max) {
  return test::quad({0, height, 2}, {2, 0, 0}, {0, 0, -2}, uv_min, uv_max);
}
Mesh whole_floor() {
  return floor_at(0, {0, 0}, {1, 1});
}

/// The reason why the mesh's layout is refused; "" when it is used.
std::string refusal(const Mesh& mesh, std::uint32_t page_size = 128) {
  const scene::Scene scene = SceneBuilder().part(mesh).build();
  const Atlas atlas = build(scene, page(page_size));
  EXPECT_EQ(atlas.placements[0].uses_source_uv, atlas.placements[0].reason.empty());
  return atlas.placements[0].reason;
}

TEST(SourceUv, SceneWideLayoutIsUsedAsItIs) {
  SceneBuilder builder;
  builder.instance().part(floor_at(0, {0, 0}, {0.5f, 0.5f}));
  builder.instance().part(floor_at(1, {0.5f, 0.25f}, {1, 0.75f}));
  const scene::Scene scene = builder.build();
  const Atlas atlas = build(scene);
  EXPECT_EQ(atlas.page_count, 1u);
  for (const InstancePlacement& p : atlas.placements) {
    EXPECT_TRUE(p.uses_source_uv);
    EXPECT_EQ(p.scale, (math::Vec2{1, 1}));
    EXPECT_EQ(p.offset, (math::Vec2{0, 0}));
  }
  for (const AtlasVertex& v : atlas.vertices) {
    EXPECT_EQ(v.uv, scene.lightmap_uv[v.scene_vertex] * 128.f);
  }
  EXPECT_EQ(atlas.texels_per_metre, 32.f);  // 2 m on 64 texels
}

TEST(SourceUv, LayoutsThatFillThePageEachGetTheirOwnPlace) {
  SceneBuilder builder;
  builder.instance().part(whole_floor());
  builder.instance().part(whole_floor(), 0, {0, 3, 0});
  const scene::Scene scene = builder.build();
  const Atlas atlas = build(scene);
  expect_gutter(atlas, 4);
  for (const AtlasVertex& v : atlas.vertices) {
    const auto& p = atlas.placements[v.scene_vertex / 4];
    const math::Vec2 uv = scene.lightmap_uv[v.scene_vertex];
    EXPECT_TRUE(p.uses_source_uv);
    EXPECT_NEAR(v.uv.x / 128, uv.x * p.scale.x + p.offset.x, 1e-6);
    EXPECT_NEAR(v.uv.y / 128, uv.y * p.scale.y + p.offset.y, 1e-6);
  }
}

TEST(SourceUv, RectanglesFollowTheSurfacesDensity) {
  SceneBuilder builder;
  builder.instance().part(whole_floor());  // 2 m
  builder.instance().part(test::quad({0, 5, 8}, {8, 0, 0}, {0, 0, -8}));
  const Atlas atlas = build(builder.build());
  const auto width = [&](int i) { return atlas.charts[i].max.x - atlas.charts[i].min.x; };
  EXPECT_NEAR(width(1) / width(0), 4, 0.2);
}

TEST(SourceUv, MirroredPiecesAreValid) {
  EXPECT_EQ(refusal(floor_at(0, {0, 1}, {1, 0})), "");
  Mesh both = floor_at(0, {0, 1}, {0.5f, 0});
  both.append(floor_at(1, {0.5f, 0}, {1, 1}));
  EXPECT_EQ(refusal(both), "");
}

TEST(SourceUv, RoundingBeyondThePageIsClamped) {
  EXPECT_EQ(refusal(floor_at(0, {-5e-5f, 0}, {1, 1.00005f})), "");
}

TEST(SourceUv, RefusesWhatLeavesThePage) {
  EXPECT_NE(refusal(floor_at(0, {0, 0}, {1, 1.5f})).find("leaves [0, 1]"), std::string::npos);
  EXPECT_NE(refusal(floor_at(0, {-0.01f, 0}, {1, 1})).find("leaves [0, 1]"), std::string::npos);
}

TEST(SourceUv, RefusesWhatIsNotFinite) {
  Mesh mesh = whole_floor();
  mesh.uv[2].x = std::numeric_limits<float>::quiet_NaN();
  EXPECT_NE(refusal(mesh).find("not finite"), std::string::npos);
  mesh.uv[2].x = std::numeric_limits<float>::infinity();
  EXPECT_NE(refusal(mesh).find("not finite"), std::string::npos);
}

TEST(SourceUv, RefusesOverlap) {
  Mesh mesh = floor_at(0, {0, 0}, {0.5f, 1});
  mesh.append(floor_at(1, {0.5f, 0}, {1, 1}));
  EXPECT_EQ(refusal(mesh), "");
  Mesh over = floor_at(0, {0, 0}, {0.5f, 1});
  over.append(floor_at(1, {0.48f, 0}, {1, 1}));  // 2.5 texels of 128
  EXPECT_NE(refusal(over).find("overlap"), std::string::npos);
  Mesh rounding = floor_at(0, {0, 0}, {0.5f, 1});
  rounding.append(floor_at(1, {0.4995f, 0}, {1, 1}));  // 1/16 texel
  EXPECT_EQ(refusal(rounding), "");
}

TEST(SourceUv, RefusesCoveringTwiceWithFacesSmallerThanATexel) {
  Mesh fine;
  const std::uint32_t n = 300;
  for (std::uint32_t i = 0; i < (n + 1) * (n + 1); ++i) {
    const float u = float(i % (n + 1)) / float(n), v = float(i / (n + 1)) / float(n);
    fine.positions.push_back({u, 0, -v});
    fine.uv.push_back({u, v});
    if (i % (n + 1) == n || i / (n + 1) == n) continue;
    fine.triangles.push_back({i, i + 1, i + n + 2});
    fine.triangles.push_back({i, i + n + 2, i + n + 1});
  }
  EXPECT_EQ(refusal(fine, 64), "");
  Mesh twice = fine;
  for (math::Vec3& p : fine.positions) p.y = 1;
  twice.append(fine);
  EXPECT_NE(refusal(twice, 64).find("overlap"), std::string::npos);
}

TEST(SourceUv, RefusesFacesWithoutArea) {
  Mesh mesh = whole_floor();
  mesh.append(floor_at(1, {0.5f, 0.5f}, {0.5f, 0.5f}));
  EXPECT_NE(refusal(mesh).find("no area"), std::string::npos);
  // A sliver between two real faces is not worth a new layout.
  Mesh sliver = whole_floor();
  sliver.positions.push_back({1, 0, 2.0005f});
  sliver.uv.push_back({0.5f, 0});
  sliver.triangles.push_back({0, 4, 1});
  EXPECT_EQ(refusal(sliver), "");
}

TEST(SourceUv, RefusesFolds) {
  // A strip of two quads whose second half is laid back over the first.
  Mesh strip{{{0, 0, 0}, {0, 0, -1}, {1, 0, 0}, {1, 0, -1}, {2, 0, 0}, {2, 0, -1}},
             {{0, 0}, {0, 1}, {0.8f, 0}, {0.8f, 1}, {0.2f, 0}, {0.2f, 1}},
             {{0, 2, 1}, {1, 2, 3}, {2, 4, 3}, {3, 4, 5}}};
  EXPECT_NE(refusal(strip).find("folds"), std::string::npos);
}

TEST(SourceUv, OtherInstancesAreUnwrappedBesideValidOnes) {
  SceneBuilder builder;
  builder.instance().part(floor_at(0, {0, 0}, {0.5f, 0.5f}));
  builder.instance().part(test::cube(1), 0, {1, 2, -1});
  builder.instance().part(floor_at(4, {0.5f, 0}, {1, 0.5f}));
  const scene::Scene scene = builder.build();
  const Atlas atlas = build(scene);
  expect_gutter(atlas, 0);
  EXPECT_EQ(atlas.page_count, 1u);
  EXPECT_TRUE(atlas.placements[0].uses_source_uv);
  EXPECT_FALSE(atlas.placements[1].uses_source_uv);
  EXPECT_EQ(atlas.placements[1].reason, "primitive 0 has no TEXCOORD_1");
  // The two valid ones stay one layout.
  EXPECT_EQ(atlas.placements[0].scale, atlas.placements[2].scale);
  EXPECT_EQ(atlas.placements[0].offset, atlas.placements[2].offset);
  for (const AtlasVertex& v : atlas.vertices) {
    const std::uint32_t instance = v.scene_vertex < 4 ? 0 : v.scene_vertex < 28 ? 1 : 2;
    if (instance == 1) continue;
    const auto& p = atlas.placements[instance];
    const math::Vec2 uv = scene.lightmap_uv[v.scene_vertex];
    EXPECT_NEAR(v.uv.x / 128, uv.x * p.scale.x + p.offset.x, 1e-6);
    EXPECT_NEAR(v.uv.y / 128, uv.y * p.scale.y + p.offset.y, 1e-6);
  }
}

TEST(SourceUv, ExistingOrNothing) {
  SceneBuilder builder;
  builder.instance(7).part(whole_floor());
  builder.instance(9).part(whole_floor()).part(test::cube(1));
  AtlasSettings settings = page(64);
  settings.unwrap = proto::Unwrap::kExisting;
  const auto atlas = build_atlas(builder.scene(), settings);
  ASSERT_FALSE(atlas);
  EXPECT_EQ(atlas.error().code, "invalid_lightmap_uv");
  ASSERT_EQ(atlas.error().details.size(), 1u);
  EXPECT_EQ(atlas.error().details[0].source, "scene");
  EXPECT_EQ(atlas.error().details[0].pointer, "/meshes/9/primitives/1/attributes/TEXCOORD_1");
  EXPECT_EQ(atlas.error().details[0].detail, "primitive 1 has no TEXCOORD_1");
}

TEST(SourceUv, InstancesOfOneBadMeshAreAllRefused) {
  Mesh over = floor_at(0, {0, 0}, {0.5f, 1});
  over.append(floor_at(1, {0.25f, 0}, {1, 1}));
  SceneBuilder builder;
  builder.instance(3).part(over);
  builder.instance(3).part(over, 0, {9, 0, 0});
  const Atlas atlas = build(builder.build());
  EXPECT_EQ(atlas.placements[0].reason, atlas.placements[1].reason);
  EXPECT_NE(atlas.placements[1].reason.find("overlap"), std::string::npos);
}

TEST(SourceUv, AlwaysUnwrapsWhenTold) {
  AtlasSettings settings = page(64);
  settings.unwrap = proto::Unwrap::kAlways;
  const Atlas atlas = build(SceneBuilder().part(whole_floor()).build(), settings);
  EXPECT_FALSE(atlas.placements[0].uses_source_uv);
  EXPECT_EQ(atlas.placements[0].reason, "atlas.unwrap is \"always\"");
}

TEST(SourceUv, ChartsAreConnectedPieces) {
  Mesh room = floor_at(0, {0, 0}, {0.4f, 0.4f});
  // A wall that shares the floor's rear edge in space and on the page, and one that does in space.
  room.append(test::quad({0, 0, 0}, {2, 0, 0}, {0, 2, 0}, {0, 0.4f}, {0.4f, 0.8f}));
  room.append(test::quad({0, 0, 2}, {0, 0, -2}, {0, 2, 0}, {0.5f, 0}, {0.9f, 0.4f}));
  const Atlas atlas = build(SceneBuilder().part(room).build());
  EXPECT_EQ(atlas.triangle_chart, (std::vector<std::uint32_t>{0, 0, 0, 0, 1, 1}));
}

}  // namespace
}  // namespace kiln::atlas
