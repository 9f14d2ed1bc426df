#pragma once

#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "tests/import/import_helpers.h"
#include "tests/support/png_builder.h"

namespace kiln::import {

using nlohmann::json;
using Edit = std::function<void(GltfBuilder&)>;

/// Both entry points must refuse the bytes, with the same error.
inline void expect_refused(const std::string& bytes, const std::string& code,
                           const std::string& pointer, const files::ImportLimits& limits = {}) {
  const Upload upload(bytes);
  const auto checked = check_scene(upload.files, dark(), limits);
  const auto scene = import_scene(upload.files, dark(), limits);
  ASSERT_FALSE(checked);
  ASSERT_FALSE(scene);
  EXPECT_EQ(checked.error().code, code) << checked.error().message;
  EXPECT_EQ(scene.error().code, code);
  EXPECT_EQ(scene.error().message, checked.error().message);
  ASSERT_EQ(checked.error().details.size(), 1u);
  EXPECT_EQ(checked.error().details[0].source, "scene");
  EXPECT_EQ(checked.error().details[0].pointer, pointer) << checked.error().message;
}

/// A quad with normals, indices, a texture and two nodes: something to break anywhere.
inline GltfBuilder specimen() {
  GltfBuilder b;
  const int positions = b.accessor(std::vector<float>{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0}, 3);
  const int normals = b.accessor(std::vector<float>{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, 3);
  const int uv = b.accessor(std::vector<float>{0, 0, 1, 0, 1, 1, 0, 1}, 2);
  const int indices = b.accessor(std::vector<std::uint16_t>{0, 1, 2, 0, 2, 3}, 1);
  b.add("textures", {{"source", b.image(test::PngBuilder::encode(1, 1, 8, 2, "abc"), "image/png")},
                     {"sampler", b.add("samplers", {{"wrapS", 33071}})}});
  b.material({{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}});
  const int mesh =
      b.mesh({{"attributes", {{"POSITION", positions}, {"NORMAL", normals}, {"TEXCOORD_0", uv}}},
              {"indices", indices},
              {"material", 0}});
  b.node({{"mesh", mesh}});
  b.node({{"children", {0}}, {"scale", {1, 2, 1}}});
  return b;
}

inline void expect_refused(const Edit& edit, const std::string& code, const std::string& pointer,
                           const files::ImportLimits& limits = {}) {
  GltfBuilder b = specimen();
  edit(b);
  expect_refused(b.glb(), code, pointer, limits);
}

inline json& primitive(GltfBuilder& b) {
  return b.json["meshes"][0]["primitives"][0];
}

/// Flips up to four bits of the binary chunk, 600 times over: the import either refuses the file
/// with one of these codes or returns triangles that can be used.
inline void expect_harmless_when_damaged(const GltfBuilder& good,
                                         const std::set<std::string>& codes) {
  std::uint32_t random = 7, refused = 0;
  for (int i = 0; i < 600; ++i) {
    GltfBuilder b = good;
    for (int k = 0; k <= i % 4; ++k) {
      random = random * 1664525 + 1013904223;
      char& byte = b.binary[(random >> 8) % b.binary.size()];
      byte = static_cast<char>(byte ^ (1 << (random & 7)));
    }
    const auto scene = import_bytes(b.glb());
    if (!scene) {
      EXPECT_TRUE(codes.contains(scene.error().code)) << scene.error().message;
      ++refused;
      continue;
    }
    for (const auto& t : scene->triangles)
      for (const std::uint32_t v : t) ASSERT_LT(v, scene->positions.size());
  }
  EXPECT_GT(refused, 10u);
}

template <class T>
void overwrite(GltfBuilder& b, std::size_t at, T value) {
  std::memcpy(&b.binary.at(at), &value, sizeof value);
}

}  // namespace kiln::import
