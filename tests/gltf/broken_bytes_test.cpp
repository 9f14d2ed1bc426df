// Whatever happens to the bytes, the answer is a scene or an error.
#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "tests/import/bad_input.h"

namespace kiln::import {
namespace {

TEST(BadInput, EveryPrefixOfAGlbIsAnError) {
  const std::string glb = import::specimen().glb();
  const test::TempFolder folder;
  for (std::size_t length = 0; length < glb.size(); ++length) {
    files::SceneFiles files;
    files.main = folder.write("scene", glb.substr(0, length));
    const auto scene = import::import_scene(files, import::dark());
    ASSERT_FALSE(scene) << length;
    EXPECT_EQ(scene.error().code, "invalid_scene") << length;
  }
}

/// A scene that came out of damaged bytes must still keep Scene's promises.
void expect_consistent(const scene::Scene& scene) {
  ASSERT_EQ(scene.normals.size(), scene.positions.size());
  ASSERT_EQ(scene.base_uv.size(), scene.positions.size());
  ASSERT_EQ(scene.lightmap_uv.size(), scene.positions.size());
  ASSERT_EQ(scene.source_vertex.size(), scene.positions.size());
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    for (const auto v : scene.triangles[t]) ASSERT_LT(v, scene.positions.size());
    ASSERT_GT(triangle_area(scene, t), 0);
    const math::Rgb albedo = albedo_at(scene, t, {0.3f, 0.3f});
    ASSERT_TRUE(albedo.r >= 0 && albedo.r <= 1 && albedo.g >= 0 && albedo.b <= 1);
    ASSERT_TRUE(std::isfinite(max_channel(emission_at(scene, t, {0.3f, 0.3f}))));
  }
  for (const math::Vec3 n : scene.normals) ASSERT_NEAR(length(n), 1, 1e-4f);
}

void flip_and_import(const std::string& original, unsigned seed, int rounds) {
  std::mt19937 random(seed);
  const test::TempFolder folder;
  int survived = 0;
  for (int round = 0; round < rounds; ++round) {
    std::string bytes = original;
    for (unsigned flips = 1 + random() % 4; flips > 0; --flips) {
      bytes[random() % bytes.size()] ^= static_cast<char>(1u << random() % 8);
    }
    files::SceneFiles files;
    files.main = folder.write("scene", bytes);
    const auto checked = import::check_scene(files, import::dark());
    const auto scene = import::import_scene(files, import::dark());
    if (!checked) {
      EXPECT_FALSE(scene) << seed << " " << round;
    }
    if (scene) expect_consistent(*scene);
    survived += scene ? 1 : 0;
  }
  EXPECT_GT(survived, 0);  // else nothing behind the container was reached
  EXPECT_LT(survived, rounds);
}

TEST(BadInput, RandomBitFlipsNeverCrash) {
  test::GltfBuilder b = import::specimen();
  const std::uint8_t at = 1;
  const int indices = b.view(&at, 1);
  const std::vector<float> moved{1, 0.5f, 0};
  b.json["accessors"][0]["sparse"] = {
      {"count", 1},
      {"indices", {{"bufferView", indices}, {"componentType", 5121}}},
      {"values", {{"bufferView", b.view(moved.data(), 12)}}}};
  b.json["extensions"]["KHR_lights_punctual"]["lights"] = {
      {{"type", "spot"}, {"spot", json::object()}}};
  b.json["nodes"][1]["extensions"]["KHR_lights_punctual"]["light"] = 0;
  flip_and_import(b.glb(), 1, 1500);
  flip_and_import(b.gltf(), 2, 500);
}

// JSON values of all kinds at every place of the document.
TEST(BadInput, AnyValueAnywhereNeverCrashes) {
  const test::GltfBuilder b = import::specimen();
  const json document = b.document(true);
  const json flat = document.flatten();
  const std::vector<json> values{nullptr, -1, 3, 9007199254740991, 1e38, "x", json::array(), {0}};
  const test::TempFolder folder;
  for (const auto& [place, old] : flat.items()) {
    for (json::json_pointer at(place); !at.empty(); at.pop_back()) {
      for (const json& value : values) {
        json changed = document;
        changed[at] = value;
        files::SceneFiles files;
        files.main = folder.write("scene", changed.dump());
        const auto checked = import::check_scene(files, import::dark());
        const auto scene = import::import_scene(files, import::dark());
        if (!checked) {
          EXPECT_FALSE(scene) << place << " " << value;
        }
        if (scene) expect_consistent(*scene);
      }
    }
  }
}

}  // namespace
}  // namespace kiln::import
