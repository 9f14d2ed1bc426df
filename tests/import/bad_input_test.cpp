// What is wrong with a scene as a whole: its graph, its size, nothing in it.
#include <gtest/gtest.h>

#include <chrono>
#include <limits>

#include "tests/import/bad_input.h"

namespace kiln::import {
namespace {

TEST(BadInput, Nodes) {
  const auto refuse = [](const Edit& edit, const std::string& pointer) {
    expect_refused(edit, "invalid_scene", pointer);
  };
  const auto scenes = [](GltfBuilder& b, json nodes) { b.json["scenes"] = {{{"nodes", nodes}}}; };
  refuse(
      [&](auto& b) {
        b.json["nodes"][0]["children"] = {1};
        scenes(b, {0});
      },
      "/nodes/0/children");
  refuse(
      [&](auto& b) {
        b.json["nodes"][0]["children"] = {0};
        b.json["nodes"][1].erase("children");
        scenes(b, {0});
      },
      "/nodes/0/children");
  refuse([&](auto& b) { b.node({{"children", {0}}}); }, "/nodes/2/children/0");
  refuse([&](auto& b) { b.json["nodes"][1]["children"] = {0, 0}; }, "/nodes/1/children/1");
  refuse([&](auto& b) { scenes(b, {1, 0}); }, "/scenes/0/nodes/1");
  refuse([&](auto& b) { scenes(b, {1, 1}); }, "/scenes/0/nodes/1");
  refuse([&](auto& b) { b.json["nodes"][0]["rotation"] = {0, 0, 0, 0}; }, "/nodes/0/rotation");
  refuse(
      [&](auto& b) {
        b.json["nodes"][0]["matrix"] = {1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
      },
      "/nodes/0/matrix");
}

TEST(BadInput, NothingToBake) {
  expect_refused([](auto& b) { b.json["nodes"][0].erase("mesh"); }, "nothing_to_bake", "");
  expect_refused([](auto& b) { primitive(b)["mode"] = 1; }, "nothing_to_bake", "");
  expect_refused([](auto& b) { primitive(b)["attributes"].erase("POSITION"); }, "nothing_to_bake",
                 "");
  expect_refused([](auto& b) { b.json["nodes"][1]["scale"] = {0, 0, 0}; }, "nothing_to_bake", "");
  expect_refused("{\"asset\":{\"version\":\"2.0\"}}", "nothing_to_bake", "");
}

TEST(BadInput, Limits) {
  const auto refuse = [](const std::function<void(files::ImportLimits&)>& set,
                         const std::string& pointer) {
    files::ImportLimits limits;
    set(limits);
    expect_refused([](auto&) {}, "limit_exceeded", pointer, limits);
  };
  refuse([](auto& l) { l.file_bytes = 100; }, "");
  refuse([](auto& l) { l.json_bytes = 100; }, "");
  refuse([](auto& l) { l.nodes = 1; }, "/nodes");
  refuse([](auto& l) { l.node_depth = 1; }, "/nodes/0");
  refuse([](auto& l) { l.vertices = 3; }, "/meshes/0/primitives/0");
  refuse([](auto& l) { l.triangles = 1; }, "/meshes/0/primitives/0");
}

TEST(BadInput, EveryUseOfAMeshCountsAgainstTheLimits) {
  files::ImportLimits limits;
  limits.triangles = 5;
  GltfBuilder b = specimen();
  b.node({{"mesh", 0}});
  const Upload two(b.glb());
  EXPECT_TRUE(check_scene(two.files, dark(), limits));
  b.node({{"mesh", 0}});
  const Upload three(b.glb());
  EXPECT_EQ(check_scene(three.files, dark(), limits).error().code, "limit_exceeded");
  EXPECT_EQ(import_scene(three.files, dark(), limits).error().code, "limit_exceeded");
}

// A file of a few hundred bytes may claim any number of zeros.
TEST(BadInput, ClaimedElementsTakeNoMemoryAndNoTime) {
  GltfBuilder b;
  b.binary = "1234";
  b.add("accessors", {{"componentType", 5126}, {"count", 4'000'000'000}, {"type", "VEC3"}});
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", 0}}}})}});
  expect_refused(b.glb(), "limit_exceeded", "/meshes/0/primitives/0");
  // With indices, only what they name is read: three zeros are no triangle.
  primitive(b)["indices"] = b.accessor(std::vector<std::uint32_t>{0, 1, 3'999'999'999}, 1);
  expect_refused(b.glb(), "nothing_to_bake", "");
}

TEST(BadInput, StopRequestCancels) {
  const Upload upload(specimen().glb());
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(check_scene(upload.files, dark(), {}, stop.get_token()).error().code, "canceled");
  EXPECT_EQ(import_scene(upload.files, dark(), {}, stop.get_token()).error().code, "canceled");
}

}  // namespace
}  // namespace kiln::import
