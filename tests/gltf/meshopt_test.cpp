// EXT_meshopt_compression: the same scene as without, and nothing but errors from broken data.
#include <meshoptimizer.h>

#include <algorithm>
#include <cmath>

#include "tests/import/bad_input.h"
#include "tests/support/packed_gltf.h"

namespace kiln::import {
namespace {

using test::packed_by_meshopt;
using test::PackedView;

constexpr unsigned kSide = 20;

/// A bumpy sheet of kSide x kSide vertices: positions, normals of four signed bytes, indices.
test::GltfBuilder sheet(int index_stride) {
  GltfBuilder b;
  std::vector<float> positions, normals;
  for (unsigned y = 0; y < kSide; ++y)
    for (unsigned x = 0; x < kSide; ++x) {
      const float slope = std::cos(float(x));
      positions.insert(positions.end(), {float(x), std::sin(float(x)), float(y)});
      const float l = std::sqrt(1 + slope * slope);
      normals.insert(normals.end(), {-slope / l, 1 / l, 0, 0});
    }
  std::vector<std::int8_t> octahedral(normals.size());
  meshopt_encodeFilterOct(octahedral.data(), normals.size() / 4, 4, 8, normals.data());
  std::vector<std::uint32_t> indices;
  for (unsigned y = 0; y + 1 < kSide; ++y)
    for (unsigned x = 0; x + 1 < kSide; ++x) {
      const unsigned i = y * kSide + x;
      indices.insert(indices.end(), {i, i + kSide, i + 1, i + 1, i + kSide, i + kSide + 1});
    }
  const int p = b.accessor(positions, 3), n = b.accessor(octahedral, 4, true);
  b.json["accessors"][1]["type"] = "VEC3";
  b.json["bufferViews"][1]["byteStride"] = 4;
  const int i = index_stride == 4
                    ? b.accessor(indices, 1)
                    : b.accessor(std::vector<std::uint16_t>(indices.begin(), indices.end()), 1);
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", p}, {"NORMAL", n}}}, {"indices", i}})}});
  return b;
}

test::GltfBuilder packed_sheet(const std::string& mode, int index_stride) {
  return packed_by_meshopt(
      sheet(index_stride),
      {{"ATTRIBUTES", "NONE", 12}, {"ATTRIBUTES", "OCTAHEDRAL", 4}, {mode, "NONE", index_stride}});
}

/// The corners of each triangle from its least on: the codec may turn triangles.
std::vector<std::array<float, 9>> turned(const scene::Scene& scene) {
  std::vector<std::array<float, 9>> out;
  for (auto t : scene.triangles) {
    const auto key = [&](std::uint32_t v) {
      return std::tuple(scene.positions[v].x, scene.positions[v].z);
    };
    std::rotate(
        t.begin(),
        std::min_element(t.begin(), t.end(), [&](auto a, auto b) { return key(a) < key(b); }),
        t.end());
    std::array<float, 9> corners{};
    for (std::size_t k = 0; k < 3; ++k) {
      const math::Vec3 p = scene.positions[t[k]];
      corners[3 * k] = p.x, corners[3 * k + 1] = p.y, corners[3 * k + 2] = p.z;
    }
    out.push_back(corners);
  }
  return out;
}

TEST(Meshopt, EveryModeGivesTheSameSheet) {
  test::GltfBuilder plain = sheet(4);
  plain.json["meshes"][0]["primitives"][0]["attributes"].erase("NORMAL");
  const auto expected = turned(import::imported(plain));
  ASSERT_EQ(expected.size(), 2 * (kSide - 1) * (kSide - 1));
  for (const char* mode : {"TRIANGLES", "INDICES"})
    for (const int stride : {2, 4}) {
      const scene::Scene scene = import::imported(packed_sheet(mode, stride));
      EXPECT_EQ(turned(scene), expected) << mode << stride;
      EXPECT_TRUE(scene.warnings.empty());
      for (std::size_t v = 0; v < scene.positions.size(); ++v) {
        const float slope = std::cos(scene.positions[v].x);
        const math::Vec3 n = normalize(math::Vec3{-slope, 1, 0});
        EXPECT_GT(dot(scene.normals[v], n), 0.999f);
      }
    }
}

TEST(Meshopt, ExponentialNumbers) {
  test::GltfBuilder b;
  const std::vector<float> values{0.125f, 5, -3, 1000, 0.5f, 2, 7, -8, 1e-3f};
  std::vector<std::uint32_t> encoded(values.size());
  meshopt_encodeFilterExp(encoded.data(), 3, 12, 20, values.data());
  const int p = b.accessor(encoded, 3);
  b.json["accessors"][0]["componentType"] = 5126;
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", p}}}})}});
  const scene::Scene scene =
      import::imported(packed_by_meshopt(b, {{"ATTRIBUTES", "EXPONENTIAL", 12}}));
  ASSERT_EQ(scene.positions.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(scene.positions[i].x, values[3 * i], 1e-3);
    EXPECT_NEAR(scene.positions[i].y, values[3 * i + 1], 1e-3);
    EXPECT_NEAR(scene.positions[i].z, values[3 * i + 2], 1e-3);
  }
}

TEST(Meshopt, PlainDataIsTakenWhereItIsThere) {
  test::GltfBuilder b = packed_sheet("TRIANGLES", 2);
  const test::GltfBuilder plain = sheet(2);
  b.json["buffers"][1]["uri"] = "plain.bin";
  b.binary.assign(b.binary.size(), 'x');  // nobody reads it
  const import::Upload upload(b.glb(), {{"plain.bin", plain.binary}});
  const auto scene = import::import_scene(upload.files, import::dark());
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_EQ(scene->triangles.size(), 2 * (kSide - 1) * (kSide - 1));
}

void expect_wrong(const std::function<void(json&)>& edit, const std::string& words,
                  const std::string& code = "invalid_scene", const files::ImportLimits& limits = {},
                  const std::string& member = "") {
  GltfBuilder b = packed_sheet("TRIANGLES", 2);
  edit(b.json["bufferViews"][2]["extensions"]["EXT_meshopt_compression"]);
  const import::Upload upload(b.glb());
  const auto checked = import::check_scene(upload.files, import::dark(), limits);
  ASSERT_FALSE(checked) << words;
  EXPECT_EQ(checked.error().code, code);
  EXPECT_NE(checked.error().message.find(words), std::string::npos) << checked.error().message;
  EXPECT_EQ(checked.error().details.at(0).pointer,
            "/bufferViews/2/extensions/EXT_meshopt_compression" + member);
}

TEST(Meshopt, WhatCannotBeIsAnErrorWithItsPlace) {
  expect_wrong([](json& v) { v["count"] = 3; }, "byteLength");
  expect_wrong([](json& v) { v["count"] = 2167; }, "multiple of 3");
  expect_wrong([](json& v) { v["byteStride"] = 3; }, "2 or 4");
  expect_wrong([](json& v) { v["filter"] = "OCTAHEDRAL"; }, "no filter");
  expect_wrong([](json& v) { v["mode"] = "ATTRIBUTES"; }, "4, 8 ... 256");
  expect_wrong([](json& v) { v["byteLength"] = 100; }, "too short");
  expect_wrong([](json& v) { v["byteLength"] = 1'000'000; }, "reaches beyond");
  expect_wrong([](json& v) { v["byteOffset"] = 1'000'000; }, "reaches beyond");
  expect_wrong([](json& v) { v["byteOffset"] = 0; }, "damaged");
  expect_wrong([](json& v) { v["buffer"] = 1; }, "no data");
  expect_wrong([](json& v) { v["buffer"] = 2; }, "index", "invalid_scene", {}, "/buffer");
  expect_wrong([](json& v) { v["mode"] = "POINTS"; }, "", "invalid_scene", {}, "/mode");
  expect_wrong([](json& v) { v["filter"] = "ZIP"; }, "", "invalid_scene", {}, "/filter");
  expect_wrong([](json& v) { v.erase("count"); }, "count");
  // 400 positions and normals are 6400 bytes, and then there are 4332 of indices.
  files::ImportLimits few;
  few.file_bytes = 10'000;
  expect_wrong([](json&) {}, "decompressed", "limit_exceeded", few);
  few.file_bytes = 11'000;
  const import::Upload upload(packed_sheet("TRIANGLES", 2).glb());
  EXPECT_TRUE(import::check_scene(upload.files, import::dark(), few));
}

TEST(Meshopt, BrokenDataIsHarmless) {
  for (const char* mode : {"TRIANGLES", "INDICES"}) {
    const test::GltfBuilder good = packed_sheet(mode, 2);
    import::expect_harmless_when_damaged(good, {"invalid_scene"});
  }
}

}  // namespace
}  // namespace kiln::import
