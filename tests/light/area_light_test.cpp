#include "baker/light/area_light.h"

#include <gtest/gtest.h>

#include "tests/support/quad_scene.h"

namespace kiln::light {
namespace {

constexpr math::Rgb kBright{3, 2, 1};

TEST(AreaLights, TrianglesOfARectangleBecomeOneLight) {
  solver::QuadScene scene(32);
  scene.add({{0, 0, 0}, {0.3f, 0.4f, 0}, {0, 0, 2}, {}, kBright});
  scene.build();
  const auto lights = find_area_lights(scene.scene());
  ASSERT_EQ(lights.size(), 1u);
  EXPECT_EQ(lights[0].corners, 4u);
  EXPECT_NEAR(lights[0].area_m2, 1, 1e-6);
  EXPECT_TRUE(lights[0].is_uniform());
  EXPECT_EQ(lights[0].radiance, kBright);
  const math::Vec3 normal = normalize(cross(math::Vec3{0.3f, 0.4f, 0}, math::Vec3{0, 0, 2}));
  EXPECT_NEAR(dot(lights[0].normal, normal), 1, 1e-6);
}

TEST(AreaLights, TwoLampsStayTwo) {
  solver::QuadScene scene(32);
  scene.add({{0, 0, 0}, {1, 0, 0}, {0, 0, 1}, {}, kBright});
  scene.add({{1, 0, 0}, {1, 0, 0}, {0, 0, 1}, {}, kBright});
  scene.build();
  const auto lights = find_area_lights(scene.scene());
  ASSERT_EQ(lights.size(), 2u);
  for (const AreaLight& l : lights) EXPECT_EQ(l.corners, 4u);
}

TEST(AreaLights, TrianglesThatAreNoParallelogramStayTriangles) {
  solver::QuadScene scene(32);
  scene.add({{0, 0, 0}, {1, 0, 0}, {0, 0, 1}, {}, kBright});
  scene.build();
  scene.scene().positions[2] = {1.5f, 0, 1.5f};  // a kite
  for (const AreaLight& l : find_area_lights(scene.scene())) EXPECT_EQ(l.corners, 3u);
  scene.scene().positions[2] = {1, 0.2f, 1};  // folded
  EXPECT_EQ(find_area_lights(scene.scene()).size(), 2u);
}

TEST(AreaLights, TexturedTrianglesStayTriangles) {
  solver::QuadScene scene(32);
  scene.add({{0, 0, 0}, {1, 0, 0}, {0, 0, 1}, {}, kBright});
  scene.build();
  scene.scene().images.push_back({1, 1, 0});
  scene.scene().image_texels.push_back({});
  scene.scene().materials[0].emission_texture.image = 0;
  const auto lights = find_area_lights(scene.scene());
  ASSERT_EQ(lights.size(), 2u);
  for (const AreaLight& l : lights) EXPECT_FALSE(l.is_uniform());
}

}  // namespace
}  // namespace kiln::light
