// KHR_draco_mesh_compression: the same triangles as without, and nothing but errors from broken
// data.
#include <algorithm>
#include <cmath>

#include "tests/import/bad_input.h"
#include "tests/support/packed_gltf.h"

namespace kiln::import {
namespace {

using test::packed_by_draco;

constexpr std::uint32_t kSide = 17;
constexpr std::size_t kTriangles = 2 * (kSide - 1) * (kSide - 1);

struct Sheet {
  std::vector<float> positions, normals;
  std::vector<std::uint32_t> indices;

  Sheet() {
    for (std::uint32_t y = 0; y < kSide; ++y)
      for (std::uint32_t x = 0; x < kSide; ++x) {
        positions.insert(positions.end(), {float(x), std::sin(float(x + y)), float(y)});
        const math::Vec3 n =
            normalize(math::Vec3{-std::cos(float(x + y)), 1, -std::cos(float(x + y))});
        normals.insert(normals.end(), {n.x, n.y, n.z});
      }
    for (std::uint32_t y = 0; y + 1 < kSide; ++y)
      for (std::uint32_t x = 0; x + 1 < kSide; ++x) {
        const std::uint32_t i = y * kSide + x;
        indices.insert(indices.end(), {i, i + kSide, i + 1, i + 1, i + kSide, i + kSide + 1});
      }
  }
  test::GltfBuilder packed(bool edgebreaker) const {
    return test::packed_by_draco(positions, normals, indices, edgebreaker);
  }
};

/// Corners of all triangles, each from its least on, in order of these: the codec orders anew.
std::vector<std::array<math::Vec3, 3>> ordered(const scene::Scene& scene) {
  const auto less = [](const math::Vec3& a, const math::Vec3& b) {
    return std::tuple(a.x, a.y, a.z) < std::tuple(b.x, b.y, b.z);
  };
  std::vector<std::array<math::Vec3, 3>> out;
  for (const auto& t : scene.triangles) {
    std::array<math::Vec3, 3> c{scene.positions[t[0]], scene.positions[t[1]],
                                scene.positions[t[2]]};
    std::rotate(c.begin(), std::min_element(c.begin(), c.end(), less), c.end());
    out.push_back(c);
  }
  std::sort(out.begin(), out.end(), [&](const auto& a, const auto& b) {
    return std::lexicographical_compare(a.begin(), a.end(), b.begin(), b.end(), less);
  });
  return out;
}

TEST(Draco, BothEncodingsGiveTheSameSheet) {
  const Sheet sheet;
  test::GltfBuilder plain;
  const int p = plain.accessor(sheet.positions, 3), n = plain.accessor(sheet.normals, 3),
            i = plain.accessor(sheet.indices, 1);
  plain.node(
      {{"mesh", plain.mesh({{"attributes", {{"POSITION", p}, {"NORMAL", n}}}, {"indices", i}})}});
  const auto expected = ordered(import::imported(plain));
  ASSERT_EQ(expected.size(), kTriangles);
  for (const bool edgebreaker : {false, true}) {
    const scene::Scene scene = import::imported(sheet.packed(edgebreaker));
    EXPECT_EQ(ordered(scene), expected) << edgebreaker;
    EXPECT_TRUE(scene.warnings.empty());
    for (std::size_t v = 0; v < scene.positions.size(); ++v) {
      const float slope = -std::cos(scene.positions[v].x + scene.positions[v].z);
      import::expect_near(scene.normals[v], normalize(math::Vec3{slope, 1, slope}), 1e-3f);
    }
  }
}

TEST(Draco, MeshesMayShareAccessorsAndPlainDataIsTakenWhereItIsThere) {
  const Sheet sheet;
  test::GltfBuilder b = sheet.packed(true);
  b.json["meshes"][0]["primitives"].push_back(import::primitive(b));
  EXPECT_EQ(import::imported(b).triangles.size(), 2 * kTriangles);
  // Nobody reads the compressed bytes of a primitive whose accessors have views.
  GltfBuilder plain = sheet.packed(true);
  auto& attributes = import::primitive(plain)["attributes"];
  attributes["POSITION"] = plain.accessor(sheet.positions, 3);
  attributes["NORMAL"] = plain.accessor(sheet.normals, 3);
  const int indices = plain.accessor(sheet.indices, 1);
  import::primitive(plain)["indices"] = indices;
  plain.binary.replace(0, 5, "XXXXX");
  EXPECT_EQ(import::imported(plain).triangles.size(), kTriangles);
}

void expect_wrong(const std::function<void(test::GltfBuilder&)>& edit, const std::string& words,
                  const std::string& code = "invalid_scene",
                  const files::ImportLimits& limits = {}) {
  for (const bool edgebreaker : {false, true}) {
    GltfBuilder b = Sheet().packed(edgebreaker);
    edit(b);
    const import::Upload upload(b.glb());
    const auto checked = import::check_scene(upload.files, import::dark(), limits);
    ASSERT_FALSE(checked) << words;
    EXPECT_EQ(checked.error().code, code) << checked.error().message;
    EXPECT_NE(checked.error().message.find(words), std::string::npos) << checked.error().message;
    EXPECT_EQ(checked.error().details.at(0).pointer.substr(0, 60),
              "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression");
  }
}

json& extension(GltfBuilder& b) {
  return import::primitive(b)["extensions"]["KHR_draco_mesh_compression"];
}

TEST(Draco, WhatCannotBeIsAnErrorWithItsPlace) {
  expect_wrong([](test::GltfBuilder& b) { b.json["accessors"][2]["count"] = 3; }, "triangles");
  expect_wrong([](test::GltfBuilder& b) { b.json["accessors"][0]["count"] = 3; }, "count");
  expect_wrong(
      [](test::GltfBuilder& b) {
        b.json["accessors"][0]["count"] = b.json["accessors"][1]["count"] = 3;
      },
      "more vertices");
  expect_wrong(
      [](test::GltfBuilder& b) {
        b.json["accessors"][0]["count"] = b.json["accessors"][1]["count"] = 1000;
      },
      "vertices and");
  expect_wrong([](test::GltfBuilder& b) { b.json["accessors"][2]["componentType"] = 5121; },
               "do not fit");
  expect_wrong([](test::GltfBuilder& b) { b.json["accessors"][0]["type"] = "MAT2"; }, "can't hold");
  expect_wrong([](test::GltfBuilder& b) { import::primitive(b)["mode"] = 5; },
               "consist of triangles", "unsupported_extension");
  expect_wrong([](test::GltfBuilder& b) { import::primitive(b).erase("indices"); },
               "needs indices");
  expect_wrong([](test::GltfBuilder& b) { extension(b)["attributes"]["POSITION"] = 77; },
               "attribute 77");
  expect_wrong([](test::GltfBuilder& b) { extension(b)["attributes"]["POSITION"] = -1; }, "");
  expect_wrong([](test::GltfBuilder& b) { extension(b).erase("attributes"); }, "attributes");
  expect_wrong([](test::GltfBuilder& b) { extension(b)["bufferView"] = 9; }, "");
  expect_wrong([](test::GltfBuilder& b) { b.binary.replace(0, 5, "XXXXX"); }, "no Draco header");
  expect_wrong([](test::GltfBuilder& b) { b.binary[6] = 1; }, "version");
  expect_wrong([](test::GltfBuilder& b) { b.binary[7] = 0; }, "no triangle mesh");
  expect_wrong([](test::GltfBuilder& b) { b.binary[8] = 9; }, "encoding");
  expect_wrong([](test::GltfBuilder& b) { b.json["bufferViews"][0]["byteLength"] = 12; }, "");
  // A header that asks for 2^31 triangles takes no memory.
  expect_wrong([](test::GltfBuilder& b) { b.binary.replace(11, 12, 12, '\xff'); }, "");
  files::ImportLimits few;
  few.file_bytes = 14'000;
  expect_wrong([](test::GltfBuilder& b) { b.json["accessors"][0]["count"] = 1u << 30; }, "count",
               "invalid_scene", few);
  expect_wrong(
      [](test::GltfBuilder& b) {
        b.json["accessors"][0]["count"] = b.json["accessors"][1]["count"] = 1u << 30;
      },
      "decompressed", "limit_exceeded", few);
}

TEST(Draco, BrokenDataIsHarmless) {
  for (const bool edgebreaker : {false, true}) {
    const test::GltfBuilder good = Sheet().packed(edgebreaker);
    import::expect_harmless_when_damaged(good, {"invalid_scene", "nothing_to_bake"});
  }
}

}  // namespace
}  // namespace kiln::import
