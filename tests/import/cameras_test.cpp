// Cameras of the glTF: no bake needs them, a view does.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/import/import_helpers.h"

namespace kiln::import {
namespace {

/// A triangle, and a camera under a node.
GltfBuilder with_camera(nlohmann::json camera, nlohmann::json node = nlohmann::json::object()) {
  GltfBuilder b = triangle_builder();
  node["camera"] = b.add("cameras", std::move(camera));
  b.node(std::move(node));
  return b;
}

nlohmann::json perspective(double yfov) {
  return {{"type", "perspective"}, {"perspective", {{"yfov", yfov}, {"znear", 0.1}}}};
}
nlohmann::json orthographic(double ymag) {
  return {{"type", "orthographic"},
          {"orthographic", {{"xmag", 1}, {"ymag", ymag}, {"znear", 0}, {"zfar", 9}}}};
}

TEST(Cameras, LookAlongTheirNode) {
  const double h = std::sqrt(0.5);  // a quarter turn about X: -Z becomes +Y, and +Y becomes +Z
  nlohmann::json camera = perspective(std::atan(0.5) * 2);
  camera["name"] = "lens";
  const auto scene = imported(with_camera(
      camera, {{"name", "door"}, {"rotation", {h, 0, 0, h}}, {"translation", {1, 2, 3}}}));
  ASSERT_EQ(scene.cameras.size(), 1u);
  const scene::Camera& c = scene.cameras[0];
  EXPECT_EQ(c.name, "door");
  EXPECT_FALSE(c.orthographic);
  EXPECT_NEAR(c.half_height, 0.5f, 1e-6f);
  expect_near(c.position, {1, 2, 3});
  expect_near(c.forward, {0, 1, 0}, 1e-6f);
  expect_near(c.up, {0, 0, 1}, 1e-6f);
}

TEST(Cameras, AreNamedByTheirOwnNameWhereTheNodeHasNone) {
  nlohmann::json camera = orthographic(2.5);
  camera["name"] = "plan";
  const auto scene = imported(with_camera(camera, {{"scale", {7, 7, 7}}}));
  ASSERT_EQ(scene.cameras.size(), 1u);
  EXPECT_EQ(scene.cameras[0].name, "plan");
  EXPECT_TRUE(scene.cameras[0].orthographic);
  EXPECT_EQ(scene.cameras[0].half_height, 2.5f) << "a node's scale is not the lens's";
  EXPECT_TRUE(scene.warnings.empty());
}

TEST(Cameras, ThatShowNothingAreLeftOut) {
  for (const auto& camera : {perspective(0), perspective(-1), perspective(4), orthographic(0),
                             orthographic(-3), nlohmann::json{{"type", "fisheye"}},
                             nlohmann::json{{"type", "perspective"}}, nlohmann::json::object()}) {
    const auto scene = imported(with_camera(camera));
    EXPECT_TRUE(scene.cameras.empty()) << camera;
    EXPECT_EQ(warning_codes(scene), std::vector<std::string>{"camera_ignored"}) << camera;
  }
  const auto flat = imported(with_camera(perspective(1), {{"scale", {1, 1, 0}}}));
  EXPECT_TRUE(flat.cameras.empty());
  const auto wrong = import_bytes(
      with_camera({{"type", "perspective"}, {"perspective", {{"yfov", "wide"}}}}).glb());
  ASSERT_FALSE(wrong);
  EXPECT_EQ(wrong.error().details.at(0).pointer, "/cameras/0/perspective/yfov");
}

TEST(Cameras, AndTheirNamesAreBounded) {
  GltfBuilder b = triangle_builder();
  nlohmann::json camera = perspective(1);
  camera["name"] = std::string(10'000, 'x');
  b.add("cameras", camera);
  for (int i = 0; i < 300; ++i) b.node({{"camera", 0}});
  const auto scene = imported(b);
  ASSERT_EQ(scene.cameras.size(), scene::Camera::kMost);
  EXPECT_LE(scene.cameras[0].name.size(), scene::Camera::kNameBytes);
  EXPECT_EQ(warning_codes(scene), std::vector<std::string>{"camera_ignored"});
}

}  // namespace
}  // namespace kiln::import
