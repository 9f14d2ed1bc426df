// What cameras see.
#include "baker/view/camera.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/scenes.h"

namespace kiln::view {
namespace {

using math::Vec3;

scene::Scene box_scene(Vec3 size, Vec3 at) {
  test::Mesh mesh = test::cube(1);
  for (Vec3& p : mesh.positions) p = {p.x * size.x, p.y * size.y, p.z * size.z};
  return test::SceneBuilder().part(mesh, 0, at).build();
}

/// Returns the place of a point in the picture, -1 to 1 from side to side.
math::Vec2 seen(const Lens& lens, Vec3 p) {
  const Vec3 at = p - lens.position;
  const float depth = lens.orthographic ? 1 : dot(at, lens.forward);
  EXPECT_GT(dot(at, lens.forward), 0);
  return {dot(at, lens.right) / (depth * lens.half_width),
          dot(at, lens.up) / (depth * lens.half_height)};
}

void expect_near(Vec3 a, Vec3 b, float tolerance) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

TEST(Cameras, AFittedOneSeesTheWholeSceneAndLittleMore) {
  for (const Vec3 size : {Vec3{1, 1, 1}, {100, 1, 1}, {1, 50, 1}, {0.01f, 0.01f, 9}})
    for (const float aspect : {0.25f, 1.f, 3.f})
      for (const bool ortho : {false, true}) {
        const scene::Scene scene = box_scene(size, {3, -7, 20});
        const auto lens = choose_camera("fit", scene, aspect, ortho);
        ASSERT_TRUE(lens);
        EXPECT_EQ(lens->orthographic, ortho);
        EXPECT_FLOAT_EQ(lens->half_width / lens->half_height, aspect);
        float most = 0;
        math::Vec2 low{9, 9}, high{-9, -9};
        for (const Vec3& p : scene.positions) {
          const math::Vec2 at = seen(*lens, p);
          most = std::max({most, std::abs(at.x), std::abs(at.y)});
          low = {std::min(low.x, at.x), std::min(low.y, at.y)};
          high = {std::max(high.x, at.x), std::max(high.y, at.y)};
        }
        // It touches two opposite sides alike.
        EXPECT_LT(std::min(std::abs(low.x + high.x), std::abs(low.y + high.y)), 0.02f)
            << size.x << " " << aspect << ortho;
        EXPECT_LT(most, 1) << size.x << " " << aspect << ortho;
        EXPECT_GT(most, 0.9f) << size.x << " " << aspect << ortho;
      }
}

TEST(Cameras, APlacedOneLooksAtItsTarget) {
  const scene::Scene scene = box_scene({1, 1, 1}, {});
  const auto lens = choose_camera("1,2,3:1,2,-4:90", scene, 2, false);
  ASSERT_TRUE(lens);
  EXPECT_EQ(lens->position, (Vec3{1, 2, 3}));
  expect_near(lens->forward, {0, 0, -1}, 1e-6f);
  expect_near(lens->right, {1, 0, 0}, 1e-6f);
  expect_near(lens->up, {0, 1, 0}, 1e-6f);
  EXPECT_NEAR(lens->half_height, 1, 1e-6f);
  EXPECT_NEAR(lens->half_width, 2, 1e-6f);
  const Lens::Ray corner = lens->through(1, -1);
  expect_near(corner.direction, normalize(Vec3{2, -1, -1}), 1e-6f);

  const auto down = choose_camera("0,5,0:0,0,0:4", scene, 1, true);
  ASSERT_TRUE(down);
  expect_near(down->up, {0, 0, -1}, 1e-6f);
  EXPECT_EQ(down->half_height, 2) << "a height, not an angle";
  expect_near(down->through(0.5f, 0).origin, {1, 5, 0}, 1e-6f);
  expect_near(down->through(0.5f, 0).direction, {0, -1, 0}, 1e-6f);
}

TEST(Cameras, OfTheSceneAreFoundByName) {
  scene::Scene scene = box_scene({1, 1, 1}, {});
  scene.cameras.push_back({"door", {1, 2, 3}, {0, 0, -1}, {0, 1, 0}, false, 0.5f});
  scene.cameras.push_back({"plan", {0, 9, 0}, {0, -1, 0}, {1, 0, 0}, true, 4});
  scene.cameras.push_back({"1,2,3", {7, 7, 7}, {0, 0, -1}, {0, 1, 0}, false, 0.5f});
  const auto door = choose_camera("door", scene, 2, false);
  ASSERT_TRUE(door);
  EXPECT_EQ(door->position, (Vec3{1, 2, 3}));
  EXPECT_EQ(door->half_height, 0.5f);
  EXPECT_EQ(door->half_width, 1);
  EXPECT_FALSE(door->orthographic);
  EXPECT_TRUE(choose_camera("door", scene, 2, true)->orthographic);
  const auto plan = choose_camera("plan", scene, 1, false);
  ASSERT_TRUE(plan);
  EXPECT_TRUE(plan->orthographic);
  EXPECT_EQ(plan->half_height, 4);
  expect_near(plan->right, {0, 0, 1}, 0);
  EXPECT_EQ(choose_camera("1,2,3", scene, 1, false)->position.x, 7) << "without a colon: a name";
  const auto none = choose_camera("window", scene, 1, false);
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, "not_found");
  EXPECT_NE(none.error().message.find("`door`, `plan`"), std::string::npos) << none.error().message;
}

TEST(Cameras, ThatCantBeAreErrors) {
  const scene::Scene scene = box_scene({1, 1, 1}, {});
  for (const char* text : {"", "1,2,3:1,2,3", "1,2:3,4,5", "1,2,3:4,5,6:0", "1,2,3:4,5,6:-9",
                           "1,2,3:4,5,6:179", "1,2,3:4,5,6:7,8", "1e10,0,0:1,1,1"}) {
    const auto lens = choose_camera(text, scene, 1, false);
    ASSERT_FALSE(lens) << text;
    EXPECT_EQ(lens.error().code, "bad_request") << text;
    EXPECT_EQ(lens.error().details.at(0).pointer, "/query/camera");
  }
  for (const char* text : {"fit:", "1,2,3:nan,0,0", "1,2,3:4,5,6:7:8", "a,b,c:d,e,f"})
    EXPECT_EQ(choose_camera(text, scene, 1, false).error().code, "not_found") << text << ": a name";
}

}  // namespace
}  // namespace kiln::view
