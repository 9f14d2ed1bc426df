#include <algorithm>

#include "tests/output/lit_scene.h"
#include "tests/support/packed_gltf.h"

namespace kiln::output {
namespace {

// A unit square of two triangles in z = 0, its corners numbered like this: 3 2
//                                                                          0 1
const std::vector<float> kCorners{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
const std::vector<std::uint16_t> kIndices{0, 1, 2, 0, 2, 3};
const std::vector<float> kNormals{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1};

GltfFile square() {
  GltfFile g;
  const int position = g.positions(kCorners);
  const int normal = g.floats(kNormals, "VEC3", 3);
  const int uv = g.accessor<std::uint8_t>({0, 0, 255, 0, 255, 255, 0, 255}, 5121, "VEC2", 2);
  g.json["accessors"][uv]["normalized"] = true;
  const int indices = g.accessor(kIndices, 5123, "SCALAR", 1);
  g.mesh({{"attributes", {{"POSITION", position}, {"NORMAL", normal}, {"TEXCOORD_0", uv}}},
          {"indices", indices}});
  g.node({{"mesh", 0}});
  // Two bytes per element are not 4-aligned: a stride makes the source valid.
  g.bin.resize((g.bin.size() + 3) / 4 * 4);
  const Json strided = {
      {"buffer", 0}, {"byteOffset", g.bin.size()}, {"byteLength", 16}, {"byteStride", 4}};
  for (const int c : {0, 0, 255, 0, 255, 255, 0, 255}) {
    g.bin += char(c);
    if (g.bin.size() % 4 == 2) g.bin += "\1\2";
  }
  g.json["accessors"][uv]["bufferView"] = g.add("bufferViews", strided);
  return g;
}

const Json& primitive(const GlbReader& lit, int mesh = 0, int index = 0) {
  return lit.json["meshes"][mesh]["primitives"][index];
}

/// Positions of an indexed primitive, corner by corner.
std::vector<float> corner_positions(const GlbReader& lit, const Json& p) {
  const auto position = lit.values<float>(p["attributes"]["POSITION"], 3);
  std::vector<float> out;
  for (const auto i : lit.values<std::uint16_t>(p["indices"], 1))
    out.insert(out.end(), position.begin() + i * 3, position.begin() + i * 3 + 3);
  return out;
}
const std::vector<float> kTwoTriangles{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 0, 0, 1, 0};

TEST(LitGeometry, WithoutSplitsTheSourceAccessorsStay) {
  const test::TempFolder folder;
  const GltfFile g = square();
  const GlbReader lit = light(folder, g, Layout::kWhole);
  Json p = primitive(lit);
  const int uv = p["attributes"]["TEXCOORD_1"];
  p["attributes"].erase("TEXCOORD_1");
  p.erase("material");
  EXPECT_EQ(p, g.json["meshes"][0]["primitives"][0]);
  for (std::size_t i = 0; i < g.json["accessors"].size(); ++i)
    EXPECT_EQ(lit.json["accessors"][i], g.json["accessors"][i]);
  EXPECT_EQ(lit.bin.substr(0, g.bin.size()), g.bin);
  EXPECT_EQ(lit.values<float>(uv, 2),
            (std::vector<float>{0.25f / 64, 0.5f / 64, 1.25f / 64, 0.5f / 64, 2.25f / 64, 0.5f / 64,
                                3.25f / 64, 0.5f / 64}));
}

TEST(LitGeometry, SplitsRebuildEveryAttributeByType) {
  const test::TempFolder folder;
  GltfFile g = square();
  auto& attributes = g.json["meshes"][0]["primitives"][0]["attributes"];
  attributes["_ID"] = g.accessor<std::uint16_t>({7, 0, 8, 0, 9, 0, 10, 0}, 5123, "VEC2", 2);
  g.json["accessors"][int(attributes["_ID"])]["extras"] = {{"mine", 1}};
  const GlbReader lit = light(folder, g, Layout::kPerTriangle);
  const Json& p = primitive(lit);
  EXPECT_EQ(corner_positions(lit, p), kTwoTriangles);
  EXPECT_EQ(lit.values<std::uint16_t>(p["indices"], 1),
            (std::vector<std::uint16_t>{0, 1, 2, 3, 4, 5}));
  const Json& position = lit.json["accessors"][int(p["attributes"]["POSITION"])];
  EXPECT_EQ(position["count"], 6);
  EXPECT_EQ(position["min"], Json({0.0, 0.0, 0.0}));
  EXPECT_EQ(position["max"], Json({1.0, 1.0, 0.0}));
  const Json& uv0 = lit.json["accessors"][int(p["attributes"]["TEXCOORD_0"])];
  EXPECT_EQ(uv0["componentType"], 5121);
  EXPECT_EQ(uv0["normalized"], true);
  EXPECT_EQ(lit.values<std::uint8_t>(p["attributes"]["TEXCOORD_0"], 2),
            (std::vector<std::uint8_t>{0, 0, 255, 0, 255, 255, 0, 0, 255, 255, 0, 255}));
  EXPECT_EQ(lit.json["accessors"][int(p["attributes"]["_ID"])]["extras"]["mine"], 1);
  EXPECT_EQ(lit.values<std::uint16_t>(p["attributes"]["_ID"], 2),
            (std::vector<std::uint16_t>{7, 0, 8, 0, 9, 0, 7, 0, 9, 0, 10, 0}));
  const auto uv = lit.values<float>(p["attributes"]["TEXCOORD_1"], 2);
  for (int c = 0; c < 3; ++c) {
    EXPECT_EQ(uv[std::size_t(c) * 2], 0.25f * float(c) / 64);
    EXPECT_EQ(uv[std::size_t(c + 3) * 2], (1 + 0.25f * float(c)) / 64);
  }
}

TEST(LitGeometry, UnusedSourceVerticesAndSparseValues) {
  const test::TempFolder folder;
  GltfFile g = square();
  // Vertex 2 stands elsewhere by a sparse entry; vertex 1 is used by no triangle.
  auto& position = g.json["accessors"][0];
  const int index_view = g.view<std::uint8_t>({2});
  const int value_view = g.view<float>({2, 2, 0});
  position["sparse"] = {{"count", 1},
                        {"indices", {{"bufferView", index_view}, {"componentType", 5121}}},
                        {"values", {{"bufferView", value_view}}}};
  position["max"] = {2, 2, 0};
  const int indices = g.accessor<std::uint16_t>({0, 2, 3}, 5123, "SCALAR", 1);
  g.json["meshes"][0]["primitives"][0]["indices"] = indices;

  const GlbReader kept = light(folder, g, Layout::kWhole);
  EXPECT_EQ(kept.json["accessors"][int(primitive(kept)["attributes"]["TEXCOORD_1"])]["count"], 4);
  EXPECT_EQ(kept.json["accessors"][0], g.json["accessors"][0]);

  const GlbReader split = light(folder, g, Layout::kPerTriangle);
  const Json& p = primitive(split);
  // One triangle splits nothing either: the sparse accessor stays.
  EXPECT_EQ(p["attributes"]["POSITION"], 0);
}

TEST(LitGeometry, SparseValuesSurviveASplit) {
  const test::TempFolder folder;
  GltfFile g = square();
  auto& position = g.json["accessors"][0];
  const int index_view = g.view<std::uint16_t>({2});
  const int value_view = g.view<float>({2, 2, 0});
  position["sparse"] = {{"count", 1},
                        {"indices", {{"bufferView", index_view}, {"componentType", 5123}}},
                        {"values", {{"bufferView", value_view}}}};
  position["max"] = {2, 2, 0};
  const GlbReader lit = light(folder, g, Layout::kPerTriangle);
  const Json& p = primitive(lit);
  EXPECT_EQ(corner_positions(lit, p), (std::vector<float>{0, 0, 0, 1, 0, 0, 2, 2, 0,  //
                                                          0, 0, 0, 2, 2, 0, 0, 1, 0}));
  const Json& made = lit.json["accessors"][int(p["attributes"]["POSITION"])];
  EXPECT_EQ(made["max"], Json({2.0, 2.0, 0.0}));
  EXPECT_FALSE(made.contains("sparse"));
}

TEST(LitGeometry, UnindexedTrianglesKeepTheirVertices) {
  const test::TempFolder folder;
  GltfFile g;
  const int position = g.positions(kTwoTriangles);
  g.mesh({{"attributes", {{"POSITION", position}}}});
  g.node({{"mesh", 0}});
  const GlbReader lit = light(folder, g, Layout::kPerTriangle);
  const Json& p = primitive(lit);
  EXPECT_EQ(p["attributes"]["POSITION"], position);
  EXPECT_FALSE(p.contains("indices"));
  EXPECT_EQ(lit.json["accessors"][int(p["attributes"]["TEXCOORD_1"])]["count"], 6);
  // Texture coordinate sets are numbered from 0 without gaps.
  EXPECT_EQ(p["attributes"]["TEXCOORD_0"], p["attributes"]["TEXCOORD_1"]);
}

TEST(LitGeometry, StripsStayStripsUntilTheySplit) {
  const test::TempFolder folder;
  GltfFile g;
  const int position = g.positions({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 2, 0});
  const int normal = g.floats({0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3", 3);
  g.mesh({{"attributes", {{"POSITION", position}, {"NORMAL", normal}}}, {"mode", 5}});
  g.node({{"mesh", 0}});
  const GlbReader kept = light(folder, g, Layout::kWhole);
  EXPECT_EQ(primitive(kept)["mode"], 5);
  EXPECT_EQ(primitive(kept)["attributes"]["POSITION"], position);

  const GlbReader split = light(folder, g, Layout::kPerTriangle);
  EXPECT_EQ(primitive(split)["mode"], 4);
  const auto at = corner_positions(split, primitive(split));
  ASSERT_EQ(at.size(), 27u);
  for (std::size_t t = 0; t < 3; ++t) {  // all face +z
    const float* p = at.data() + t * 9;
    EXPECT_GT((p[3] - p[0]) * (p[7] - p[1]) - (p[4] - p[1]) * (p[6] - p[0]), 0) << t;
  }
}

TEST(LitGeometry, AMirroredNodeKeepsTheSourceWinding) {
  const test::TempFolder folder;
  GltfFile g = square();
  g.json["nodes"][0]["scale"] = {-1, 1, 1};
  const GlbReader lit = light(folder, g, Layout::kPerTriangle);
  const auto at = corner_positions(lit, primitive(lit));
  for (std::size_t t = 0; t < 2; ++t) {
    const float* p = at.data() + t * 9;
    EXPECT_GT((p[3] - p[0]) * (p[7] - p[1]) - (p[4] - p[1]) * (p[6] - p[0]), 0) << t;
  }
}

TEST(LitGeometry, MorphTargetsAndSkinsSplitWithTheirVertices) {
  const test::TempFolder folder;
  GltfFile g = square();
  auto& p = g.json["meshes"][0]["primitives"][0];
  const int joints =
      g.accessor<std::uint8_t>({0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0}, 5121, "VEC4", 4);
  const int weights = g.accessor<std::uint8_t>(
      {255, 0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0}, 5121, "VEC4", 4);
  g.json["accessors"][weights]["normalized"] = true;
  p["attributes"]["JOINTS_0"] = joints;
  p["attributes"]["WEIGHTS_0"] = weights;
  const int moved = g.positions({0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0, 4});
  p["targets"] = Json::array({{{"POSITION", moved}}});
  g.json["meshes"][0]["weights"] = {0.0};
  g.json["meshes"][0]["extras"] = {{"targetNames", {"up"}}};
  g.node({{"name", "bone"}});
  g.node({{"name", "tip"}});
  g.json["skins"] = Json::array({{{"joints", {1, 2}}}});
  g.json["nodes"][0]["skin"] = 0;

  const GlbReader lit = light(folder, g, Layout::kPerTriangle);
  const Json& out = primitive(lit);
  EXPECT_EQ(lit.values<float>(out["targets"][0]["POSITION"], 3),
            (std::vector<float>{0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0, 1, 0, 0, 3, 0, 0, 4}));
  EXPECT_EQ(lit.json["accessors"][int(out["targets"][0]["POSITION"])]["min"],
            Json({0.0, 0.0, 1.0}));
  EXPECT_EQ(lit.values<std::uint8_t>(out["attributes"]["JOINTS_0"], 4),
            (std::vector<std::uint8_t>{0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0,  //
                                       0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0}));
  EXPECT_EQ(lit.json["skins"], g.json["skins"]);
  EXPECT_EQ(lit.json["meshes"][0]["extras"], g.json["meshes"][0]["extras"]);
  EXPECT_EQ(lit.json["meshes"][0]["weights"], g.json["meshes"][0]["weights"]);
}

TEST(LitGeometry, AMeshOfTwoNodesIsClonedAndSharesWhatIsTheSame) {
  const test::TempFolder folder;
  GltfFile g = square();
  g.json["meshes"][0]["name"] = "square";
  g.node({{"mesh", 0}, {"translation", {2, 0, 0}}});
  const GlbReader lit = light(folder, g, Layout::kPerTriangle);
  ASSERT_EQ(lit.json["meshes"].size(), 2u);
  EXPECT_EQ(lit.json["nodes"][0]["mesh"], 0);
  EXPECT_EQ(lit.json["nodes"][1]["mesh"], 1);
  EXPECT_EQ(lit.json["meshes"][1]["name"], "square");
  const Json &a = primitive(lit, 0)["attributes"], &b = primitive(lit, 1)["attributes"];
  EXPECT_NE(a["TEXCOORD_1"], b["TEXCOORD_1"]);
  EXPECT_NE(lit.values<float>(a["TEXCOORD_1"], 2), lit.values<float>(b["TEXCOORD_1"], 2));
  EXPECT_EQ(a["POSITION"], b["POSITION"]);
  EXPECT_EQ(primitive(lit, 0)["indices"], primitive(lit, 1)["indices"]);
}

TEST(LitGeometry, ALightmapUvThatFitsIsLeftAlone) {
  const test::TempFolder folder;
  GltfFile g = square();
  auto& attributes = g.json["meshes"][0]["primitives"][0]["attributes"];
  attributes["TEXCOORD_1"] = g.floats({0, 0, 1, 0, 1, 1, 0, 1}, "VEC2", 2);
  const GlbReader lit = light(folder, g, Layout::kSource);
  EXPECT_EQ(primitive(lit)["attributes"], attributes);
  EXPECT_EQ(lit.json["accessors"].size(), g.json["accessors"].size());
}

TEST(LitGeometry, ALightmapUvWithoutAFirstSetGetsOne) {
  const test::TempFolder folder;
  GltfFile g = square();
  auto& attributes = g.json["meshes"][0]["primitives"][0]["attributes"];
  attributes.erase("TEXCOORD_0");
  attributes["TEXCOORD_1"] = g.floats({0, 0, 1, 0, 1, 1, 0, 1}, "VEC2", 2);
  const GlbReader lit = light(folder, g, Layout::kSource);
  Json expected = attributes;
  expected["TEXCOORD_0"] = expected["TEXCOORD_1"];
  EXPECT_EQ(primitive(lit)["attributes"], expected);
}

TEST(LitGeometry, PointsAndLinesPassThroughWithTheirMaterial) {
  const test::TempFolder folder;
  GltfFile g = square();
  g.add("materials", {{"name", "shared"}});
  auto& primitives = g.json["meshes"][0]["primitives"];
  primitives[0]["material"] = 0;
  primitives.push_back({{"attributes", {{"POSITION", 0}}}, {"mode", 1}, {"material", 0}});
  const Json lines = primitives[1];
  const GlbReader lit = light(folder, g, Layout::kPerTriangle);
  EXPECT_EQ(primitive(lit, 0, 1), lines);
  EXPECT_EQ(lit.json["materials"][0], g.json["materials"][0]);
  EXPECT_EQ(primitive(lit)["material"], 1);
  EXPECT_TRUE(lit.json["materials"][1]["extensions"].contains("MOZ_lightmap"));
}

TEST(LitGeometry, CompressedBuffersAreReadWhereVerticesSplit) {
  const test::TempFolder folder;
  test::GltfBuilder plain;
  const int position = plain.accessor(kCorners, 3), normal = plain.accessor(kNormals, 3),
            indices = plain.accessor(kIndices, 1);
  plain.node({{"mesh", plain.mesh({{"attributes", {{"POSITION", position}, {"NORMAL", normal}}},
                                   {"indices", indices}})}});
  const test::GltfBuilder packed = packed_by_meshopt(
      plain, {{.stride = 12}, {.stride = 12}, {.mode = "TRIANGLES", .stride = 2}});
  const auto corners = [&](const test::GltfBuilder& b, const char* name) {
    const files::SceneFiles files{folder.write(name, b.glb()), {}};
    const GlbReader lit = light(folder, files, Layout::kPerTriangle);
    EXPECT_EQ(lit.values<float>(primitive(lit)["attributes"]["NORMAL"], 3).at(2), 1);
    return corner_positions(lit, primitive(lit));
  };
  EXPECT_EQ(corners(plain, "plain.glb"), kTwoTriangles);
  const auto turned = corners(packed, "packed.glb");  // each triangle may begin at any corner
  ASSERT_EQ(turned.size(), kTwoTriangles.size());
  EXPECT_TRUE(std::is_permutation(turned.begin(), turned.end(), kTwoTriangles.begin()));
  // What is not split stays as it came, packed.
  const files::SceneFiles files{folder.write("packed.glb", packed.glb()), {}};
  const GlbReader whole = light(folder, files, Layout::kWhole);
  EXPECT_EQ(whole.json["extensionsRequired"][0], "EXT_meshopt_compression");
  const Json& view = whole.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"];
  EXPECT_EQ(view["buffer"], 0);
  EXPECT_EQ(whole.bin.substr(0, packed.binary.size()), packed.binary);
  EXPECT_EQ(whole.json["buffers"].size(), 2u);
}

TEST(LitGeometry, WhatDracoHeldIsPlain) {
  for (const Layout layout : {Layout::kWhole, Layout::kPerTriangle}) {
    const test::TempFolder folder;
    const test::GltfBuilder packed =
        test::packed_by_draco(kCorners, kNormals, {0, 1, 2, 0, 2, 3}, true);
    const files::SceneFiles files{folder.write("packed.glb", packed.glb()), {}};
    const GlbReader lit = light(folder, files, layout);
    EXPECT_FALSE(primitive(lit).contains("extensions"));
    EXPECT_FALSE(lit.json.contains("extensionsRequired"));
    const auto corners = corner_positions(lit, primitive(lit));
    ASSERT_EQ(corners.size(), kTwoTriangles.size());
    EXPECT_TRUE(std::is_permutation(corners.begin(), corners.end(), kTwoTriangles.begin()));
    EXPECT_NEAR(lit.values<float>(primitive(lit)["attributes"]["NORMAL"], 3).at(2), 1, 1e-3);
  }
}

TEST(LitGeometry, DracoIsDroppedFromLitPrimitives) {
  const test::TempFolder folder;
  GltfFile g = square();
  g.json["extensionsUsed"] = {"KHR_draco_mesh_compression"};
  g.json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"] = {
      {"bufferView", 0}, {"attributes", {{"POSITION", 0}}}};
  const GlbReader lit = light(folder, g, Layout::kWhole);
  EXPECT_FALSE(primitive(lit).contains("extensions"));
  EXPECT_EQ(lit.json["extensionsUsed"], Json::array({"MOZ_lightmap"}));
}

}  // namespace
}  // namespace kiln::output
