// Geometry of imported scenes: accessors of all kinds, triangles of all modes, transforms.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/import/import_helpers.h"
#include "tests/support/png_builder.h"

namespace kiln::import {
namespace {

const std::vector<math::Vec3> kTriangle{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};

/// A quad in z = 0 as four vertices.
std::vector<float> quad() {
  return {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
}

TEST(Geometry, TriangleWithoutIndicesOrNormalsIsFlat) {
  const scene::Scene scene = imported(test::triangle_builder());
  EXPECT_EQ(corners(scene), kTriangle);
  ASSERT_EQ(scene.normals.size(), 3u);
  for (const math::Vec3 n : scene.normals) EXPECT_EQ(n, (math::Vec3{0, 0, 1}));
  EXPECT_EQ(scene.source_vertex, (std::vector<std::uint32_t>{0, 1, 2}));
  EXPECT_TRUE(scene.warnings.empty());
  EXPECT_FALSE(scene.parts.at(0).has_lightmap_uv);
}

TEST(Geometry, GlbAndGltfWithDataUriAndSideFileAreTheSameScene) {
  const GltfBuilder b = test::triangle_builder();
  const auto expected = corners(imported(b.glb()));
  EXPECT_EQ(corners(imported(b.gltf())), expected);
  auto document = b.document(false);
  document["buffers"][0]["uri"] = "data/buffer%20one.bin";
  const Upload upload(document.dump(), {{"buffer one.bin", b.binary}});
  const auto scene = import_scene(upload.files, dark());
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_EQ(corners(*scene), expected);
}

template <class T>
void expect_indices_of_type() {
  GltfBuilder b;
  const int positions = b.accessor(quad(), 3);
  const int indices = b.accessor(std::vector<T>{0, 1, 2, 0, 2, 3}, 1);
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", positions}}}, {"indices", indices}})}});
  const scene::Scene scene = imported(b);
  ASSERT_EQ(scene.triangles.size(), 2u);
  EXPECT_EQ(corners(scene)[5], (math::Vec3{0, 1, 0}));
  EXPECT_EQ(scene.source_vertex, (std::vector<std::uint32_t>{0, 1, 2, 0, 2, 3}));
}

TEST(Geometry, IndicesOfEveryType) {
  expect_indices_of_type<std::uint8_t>();
  expect_indices_of_type<std::uint16_t>();
  expect_indices_of_type<std::uint32_t>();
}

/// Positions of a quantized type, scaled back by the node: 0 and 100 become 0 and 1.
template <class T>
void expect_positions_of_type(bool normalized) {
  SCOPED_TRACE(normalized);
  GltfBuilder b;
  const std::vector<T> values{0, 0, 0, 100, 0, 0, 0, 100, 0};
  const int positions = b.accessor(values, 3, normalized);
  const double full = static_cast<double>(std::numeric_limits<T>::max());
  const double scale = (normalized ? full : 1) / 100;
  b.json["extensionsUsed"] = {"KHR_mesh_quantization"};
  b.json["extensionsRequired"] = {"KHR_mesh_quantization"};
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", positions}}}})},
          {"scale", {scale, scale, scale}}});
  const scene::Scene scene = imported(b);
  ASSERT_EQ(scene.triangles.size(), 1u);
  for (std::size_t i = 0; i < 3; ++i) expect_near(corners(scene)[i], kTriangle[i], 1e-6f);
  EXPECT_TRUE(scene.warnings.empty());
}

TEST(Geometry, QuantizedPositionsOfEveryType) {
  for (const bool normalized : {false, true}) {
    expect_positions_of_type<std::int8_t>(normalized);
    expect_positions_of_type<std::uint8_t>(normalized);
    expect_positions_of_type<std::int16_t>(normalized);
    expect_positions_of_type<std::uint16_t>(normalized);
  }
}

TEST(Geometry, QuantizedPositionsNeedTheExtension) {
  GltfBuilder b;
  const int positions = b.accessor(std::vector<std::int16_t>{0, 0, 0, 9, 0, 0, 0, 9, 0}, 3);
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", positions}}}})}});
  const auto scene = import_bytes(b.glb());
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().code, "invalid_scene");
  EXPECT_EQ(scene.error().details.at(0).pointer, "/accessors/0/componentType");
}

TEST(Geometry, MostNegativeNormalizedValueIsMinusOne) {
  GltfBuilder b;
  const int positions = b.accessor(test::triangle_positions(), 3);
  const int normals =
      b.accessor(std::vector<std::int8_t>{-128, 0, 0, -127, 0, 0, 0, 0, 127}, 3, true);
  b.json["extensionsUsed"] = {"KHR_mesh_quantization"};
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", positions}, {"NORMAL", normals}}}})}});
  const scene::Scene scene = imported(b);
  ASSERT_EQ(scene.normals.size(), 3u);
  EXPECT_EQ(scene.normals[0], (math::Vec3{-1, 0, 0}));
  EXPECT_EQ(scene.normals[1], (math::Vec3{-1, 0, 0}));
  EXPECT_EQ(scene.normals[2], (math::Vec3{0, 0, 1}));
}

/// Texture coordinates and colors of a type: half of full scale at every vertex.
template <class T>
void expect_unit_attributes_of_type(T half, bool normalized, float expected) {
  GltfBuilder b;
  const int positions = b.accessor(test::triangle_positions(), 3);
  const int uv = b.accessor(std::vector<T>(6, half), 2, normalized);
  const int rgb = b.accessor(std::vector<T>(9, half), 3, normalized);
  b.node({{"mesh", b.mesh({{"attributes",
                            {{"POSITION", positions},
                             {"TEXCOORD_0", uv},
                             {"TEXCOORD_1", uv},
                             {"COLOR_0", rgb}}}})}});
  const scene::Scene scene = imported(b);
  ASSERT_EQ(scene.lightmap_uv.size(), 3u);
  EXPECT_TRUE(scene.parts.at(0).has_lightmap_uv);
  EXPECT_EQ(scene.lightmap_uv[2], (math::Vec2{expected, expected}));
  EXPECT_EQ(scene.colors[2], (std::array<float, 4>{expected, expected, expected, 1}));
}

TEST(Geometry, TextureCoordinatesAndColorsOfEveryType) {
  expect_unit_attributes_of_type<float>(0.5f, false, 0.5f);
  expect_unit_attributes_of_type<std::uint8_t>(51, true, 51 / 255.f);
  expect_unit_attributes_of_type<std::uint16_t>(13107, true, 13107 / 65535.f);
}

TEST(Geometry, ColorWithAlpha) {
  GltfBuilder b;
  const int positions = b.accessor(test::triangle_positions(), 3);
  const int rgba = b.accessor(std::vector<float>{1, 0, 0, 0.25f, 0, 1, 0, 0.5f, 0, 0, 1, 0.75f}, 4);
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", positions}, {"COLOR_0", rgba}}}})}});
  EXPECT_EQ(imported(b).colors.at(1), (std::array<float, 4>{0, 1, 0, 0.5f}));
}

TEST(Geometry, InterleavedAttributes) {
  GltfBuilder b;
  std::vector<float> data;  // position, normal
  for (const math::Vec3 p : kTriangle) data.insert(data.end(), {p.x, p.y, p.z, 0, 0, 1});
  const int view = b.view(data.data(), data.size() * sizeof(float), 24);
  const auto attribute = [&](int offset) {
    return b.add("accessors", {{"bufferView", view},
                               {"byteOffset", offset},
                               {"componentType", 5126},
                               {"count", 3},
                               {"type", "VEC3"}});
  };
  const int positions = attribute(0), normals = attribute(12);
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", positions}, {"NORMAL", normals}}}})}});
  const scene::Scene scene = imported(b);
  EXPECT_EQ(corners(scene), kTriangle);
  EXPECT_EQ(scene.normals.at(2), (math::Vec3{0, 0, 1}));
}

/// Adds a sparse replacement of element `at` by (x, y, z).
void make_sparse(GltfBuilder& b, int accessor, std::uint16_t at, const std::vector<float>& value) {
  const int indices = b.view(&at, sizeof at);
  const int values = b.view(value.data(), value.size() * sizeof(float));
  b.json["accessors"][static_cast<std::size_t>(accessor)]["sparse"] = {
      {"count", 1},
      {"indices", {{"bufferView", indices}, {"componentType", 5123}}},
      {"values", {{"bufferView", values}}}};
}

TEST(Geometry, SparseAccessorReplacesElements) {
  GltfBuilder b = test::triangle_builder();
  make_sparse(b, 0, 2, {0, 2, 0});
  EXPECT_EQ(corners(imported(b)), (std::vector<math::Vec3>{{0, 0, 0}, {1, 0, 0}, {0, 2, 0}}));
}

/// A triangle with the given sets, whose u is a hundredth of the set's number.
scene::Scene with_uv_sets(const std::vector<int>& sets, int texture_reads = -1) {
  GltfBuilder b;
  nlohmann::json attributes = {{"POSITION", b.accessor(test::triangle_positions(), 3)}};
  for (const int set : sets) {
    const float u = float(set) / 100;
    attributes["TEXCOORD_" + std::to_string(set)] =
        b.accessor(std::vector<float>{u, 0, u, 1, u, 0.5f}, 2);
  }
  nlohmann::json primitive = {{"attributes", attributes}};
  if (texture_reads >= 0) {
    b.add("textures",
          {{"source", b.image(test::PngBuilder::encode(1, 1, 8, 2, "\x80\x80\x80"), "image/png")}});
    primitive["material"] =
        b.add("materials", {{"pbrMetallicRoughness",
                             {{"baseColorTexture", {{"index", 0}, {"texCoord", texture_reads}}}}}});
  }
  b.node({{"mesh", b.mesh(primitive)}});
  return imported(b);
}

// glTF wants sets without gaps, but exporters that drop a first set that no texture reads leave the
// lightmap's where it was.
TEST(Geometry, TextureCoordinatesWithGapsAreUsedAndTold) {
  for (const auto& sets : {std::vector{1}, {1, 2}, {1, 12}}) {
    const scene::Scene scene = with_uv_sets(sets);
    EXPECT_TRUE(scene.parts.at(0).has_lightmap_uv);
    EXPECT_EQ(scene.lightmap_uv, (std::vector<math::Vec2>{{0.01f, 0}, {0.01f, 1}, {0.01f, 0.5f}}));
    ASSERT_EQ(warning_codes(scene), std::vector<std::string>{"texcoord_gap"});
    EXPECT_EQ(scene.warnings[0].pointer, "/meshes/0/primitives/0/attributes");
    EXPECT_NE(scene.warnings[0].message.find("TEXCOORD_1 but no TEXCOORD_0"), std::string::npos);
  }
  const scene::Scene far = with_uv_sets({0, 1, 12, 2}, 12);
  EXPECT_EQ(far.base_uv.at(1), (math::Vec2{0.12f, 1}));
  ASSERT_EQ(warning_codes(far), std::vector<std::string>{"texcoord_gap"});
  EXPECT_NE(far.warnings[0].message.find("TEXCOORD_12 but no TEXCOORD_3"), std::string::npos);
  EXPECT_TRUE(with_uv_sets({0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10}).warnings.empty());
  EXPECT_FALSE(with_uv_sets({0, 2}).parts.at(0).has_lightmap_uv);
}

TEST(Geometry, AccessorWithoutBufferViewIsZeroButForSparseElements) {
  GltfBuilder b;
  const int positions = b.accessor(quad(), 3);
  const int indices = b.accessor(std::vector<std::uint8_t>{0, 1, 2}, 1);
  const int uv = b.add("accessors", {{"componentType", 5126}, {"count", 4}, {"type", "VEC2"}});
  make_sparse(b, uv, 1, {0.25f, 0.75f});
  b.node({{"mesh", b.mesh({{"attributes",
                            {{"POSITION", positions}, {"TEXCOORD_0", uv}, {"TEXCOORD_1", uv}}},
                           {"indices", indices}})}});
  const scene::Scene scene = imported(b);
  EXPECT_EQ(scene.lightmap_uv, (std::vector<math::Vec2>{{0, 0}, {0.25f, 0.75f}, {0, 0}}));
}

/// Triangles, as corner lists, of a primitive of five points on an arc.
std::vector<std::array<std::uint32_t, 3>> assembled(int mode, bool indexed) {
  GltfBuilder b;
  std::vector<float> arc;
  for (int i = 0; i < 5; ++i) {  // convex, so that every mode gives triangles with an area
    const float angle = static_cast<float>(i) * 0.5f;
    arc.insert(arc.end(), {std::cos(angle), std::sin(angle), 0});
  }
  const int positions = b.accessor(arc, 3);
  nlohmann::json primitive = {{"attributes", {{"POSITION", positions}}}, {"mode", mode}};
  if (indexed) primitive["indices"] = b.accessor(std::vector<std::uint16_t>{0, 1, 2, 3, 4}, 1);
  b.node({{"mesh", b.mesh(primitive)}});
  const scene::Scene scene = imported(b);
  std::vector<std::array<std::uint32_t, 3>> out;
  for (const auto& t : scene.triangles) {
    out.push_back(
        {scene.source_vertex[t[0]], scene.source_vertex[t[1]], scene.source_vertex[t[2]]});
  }
  return out;
}

TEST(Geometry, StripsFansAndLists) {
  using Triangles = std::vector<std::array<std::uint32_t, 3>>;
  for (const bool indexed : {false, true}) {
    EXPECT_EQ(assembled(5, indexed), (Triangles{{0, 1, 2}, {1, 3, 2}, {2, 3, 4}}));
    EXPECT_EQ(assembled(6, indexed), (Triangles{{1, 2, 0}, {2, 3, 0}, {3, 4, 0}}));
    EXPECT_EQ(assembled(4, indexed), (Triangles{{0, 1, 2}}));  // two corners too many
  }
}

TEST(Geometry, IncompleteTriangleIsAWarning) {
  GltfBuilder b;
  const int positions = b.accessor(quad(), 3);
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", positions}}}})}});
  EXPECT_EQ(warning_codes(imported(b)), std::vector<std::string>{"incomplete_triangle"});
}

TEST(Geometry, VerticesWithNormalsAreSharedAndThoseUnusedLeftOut) {
  GltfBuilder b;
  auto points = quad();
  points.insert(points.begin(), {9, 9, 9});  // vertex 0 is not used
  const int positions = b.accessor(points, 3);
  const int normals =
      b.accessor(std::vector<float>{0, 0, 1, 0, 0, 2, 0, 0, 2, 0, 0, 2, 0, 0, 2}, 3);
  const int indices = b.accessor(std::vector<std::uint32_t>{1, 2, 3, 1, 3, 4}, 1);
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", positions}, {"NORMAL", normals}}},
                           {"indices", indices}})}});
  const scene::Scene scene = imported(b);
  EXPECT_EQ(scene.source_vertex, (std::vector<std::uint32_t>{1, 2, 3, 4}));
  EXPECT_EQ(scene.triangles[1], (std::array<std::uint32_t, 3>{0, 2, 3}));
  EXPECT_EQ(scene.normals[3], (math::Vec3{0, 0, 1}));
}

TEST(Geometry, DegenerateTrianglesAreDroppedAndCounted) {
  GltfBuilder b;
  const int positions = b.accessor(quad(), 3);
  const int normals = b.accessor(std::vector<float>{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, 3);
  const int indices = b.accessor(std::vector<std::uint8_t>{0, 0, 3, 0, 1, 2, 1, 1, 1}, 1);
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", positions}, {"NORMAL", normals}}},
                           {"indices", indices}})}});
  const scene::Scene scene = imported(b);
  EXPECT_EQ(scene.triangles.size(), 1u);
  EXPECT_EQ(scene.source_vertex, (std::vector<std::uint32_t>{0, 1, 2}));
  ASSERT_EQ(scene.warnings.size(), 1u);
  EXPECT_EQ(scene.warnings[0].code, "degenerate_triangles");
  EXPECT_EQ(scene.warnings[0].pointer, "/meshes/0/primitives/0");
  EXPECT_NE(scene.warnings[0].message.find("(2 times)"), std::string::npos);
}

TEST(Geometry, ZeroNormalsTakeThoseOfTheFaces) {
  GltfBuilder b;
  const int positions = b.accessor(test::triangle_positions(), 3);
  const int normals = b.accessor(std::vector<float>{0, 0, 0, 1, 0, 0, 0, 0, 0}, 3);
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", positions}, {"NORMAL", normals}}}})}});
  const scene::Scene scene = imported(b);
  EXPECT_EQ(scene.normals, (std::vector<math::Vec3>{{0, 0, 1}, {1, 0, 0}, {0, 0, 1}}));
  EXPECT_EQ(warning_codes(scene), std::vector<std::string>{"normals_repaired"});
}

// Nodes -------------------------------------------------------------------------------------------

/// A triangle with normals along (0, 0.6, 0.8) under the given node.
scene::Scene with_node(nlohmann::json node) {
  GltfBuilder b;
  const int positions = b.accessor(test::triangle_positions(), 3);
  std::vector<float> n;
  for (int i = 0; i < 3; ++i) n.insert(n.end(), {0, 0.6f, 0.8f});
  const int normals = b.accessor(n, 3);
  node["mesh"] = b.mesh({{"attributes", {{"POSITION", positions}, {"NORMAL", normals}}}});
  b.node(std::move(node));
  return imported(b);
}

TEST(Nodes, MatrixAndTrsGiveTheSameScene) {
  const double s = std::sin(0.5), c = std::cos(0.5);  // a turn of 1 rad about Y
  const double cs = std::cos(1.0), sn = std::sin(1.0);
  const scene::Scene trs =
      with_node({{"translation", {1, 2, 3}}, {"rotation", {0, s, 0, c}}, {"scale", {2, 3, 4}}});
  const scene::Scene matrix = with_node(
      {{"matrix", {2 * cs, 0, -2 * sn, 0, 0, 3, 0, 0, 4 * sn, 0, 4 * cs, 0, 1, 2, 3, 1}}});
  ASSERT_EQ(trs.positions.size(), 3u);
  ASSERT_EQ(matrix.positions.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    expect_near(trs.positions[i], matrix.positions[i], 1e-6f);
    expect_near(trs.normals[i], matrix.normals[i], 1e-6f);
  }
  expect_near(trs.positions[1], {static_cast<float>(1 + 2 * cs), 2, static_cast<float>(3 - 2 * sn)},
              1e-6f);
}

TEST(Nodes, NormalsFollowTheInverseTranspose) {
  const scene::Scene scene = with_node({{"scale", {1, 3, 1}}});
  // (0, 0.6, 0.8) with Y stretched three times: (0, 0.2, 0.8), normalized.
  const float l = std::sqrt(0.2f * 0.2f + 0.8f * 0.8f);
  expect_near(scene.normals.at(0), {0, 0.2f / l, 0.8f / l}, 1e-6f);
}

TEST(Nodes, NegativeScaleSwapsTheWindingAndMirrorsNormals) {
  const scene::Scene scene = with_node({{"scale", {1, 1, -1}}});
  ASSERT_EQ(scene.triangles.size(), 1u);
  EXPECT_TRUE(scene.instances.at(0).mirrored);
  EXPECT_EQ(scene.triangles[0], (std::array<std::uint32_t, 3>{0, 2, 1}));
  // Seen from the front before, seen from the front after: both normals point to -Z now.
  EXPECT_EQ(geometric_normal(scene, 0), (math::Vec3{0, 0, -1}));
  expect_near(scene.normals[0], {0, 0.6f, -0.8f}, 1e-6f);
}

TEST(Nodes, TwoMirrorsAreNone) {
  const scene::Scene scene = with_node({{"scale", {-1, -1, 1}}});
  EXPECT_FALSE(scene.instances.at(0).mirrored);
  EXPECT_EQ(geometric_normal(scene, 0), (math::Vec3{0, 0, 1}));
}

TEST(Nodes, HierarchyMultipliesParentFirst) {
  GltfBuilder b = test::triangle_builder();  // node 0
  b.json["nodes"][0]["translation"] = {1, 0, 0};
  b.node({{"children", {0}}, {"scale", {2, 2, 2}}, {"translation", {0, 5, 0}}});
  const scene::Scene scene = imported(b);
  EXPECT_EQ(scene.positions.at(1), (math::Vec3{4, 5, 0}));  // ((1 + 1) * 2, 5)
}

TEST(Nodes, InstancesOfOneMeshComeInDocumentOrder) {
  GltfBuilder b = test::triangle_builder();
  b.node({{"mesh", 0}, {"name", "right"}, {"translation", {5, 0, 0}}});
  b.json["meshes"][0]["name"] = "leaf";
  const scene::Scene scene = imported(b);
  ASSERT_EQ(scene.instances.size(), 2u);
  EXPECT_EQ(scene.instances[0].name, "leaf");
  EXPECT_EQ(scene.instances[1].name, "right");
  EXPECT_EQ(scene.instances[1].node, 1u);
  EXPECT_EQ(scene.instances[1].first_part, 1u);
  EXPECT_EQ(scene.parts.at(1).instance, 1u);
  EXPECT_EQ(scene.parts.at(1).first_vertex, 3u);
  EXPECT_EQ(scene.triangle_part, (std::vector<std::uint32_t>{0, 1}));
  EXPECT_EQ(scene.positions[3], (math::Vec3{5, 0, 0}));
}

TEST(Nodes, OnlyTheChosenSceneIsBaked) {
  GltfBuilder b = test::triangle_builder();
  b.node({{"mesh", 0}, {"translation", {5, 0, 0}}});
  b.json["scenes"] = {{{"nodes", {0}}}, {{"nodes", {1}}}};
  b.json["scene"] = 1;
  const scene::Scene scene = imported(b);
  ASSERT_EQ(scene.instances.size(), 1u);
  EXPECT_EQ(scene.instances[0].node, 1u);
}

TEST(Nodes, FileWithoutScenesIsBakedWhole) {
  GltfBuilder b = test::triangle_builder();
  auto document = b.document(true);
  document.erase("scenes");
  document.erase("scene");
  const scene::Scene scene = imported(document.dump());
  EXPECT_EQ(scene.instances.size(), 1u);
  EXPECT_EQ(warning_codes(scene), std::vector<std::string>{"no_scene"});
}

TEST(Nodes, FlattenedNodeLeavesNothingOfAStandingTriangle) {
  GltfBuilder b = test::triangle_builder();
  b.json["nodes"][0]["scale"] = {1, 0, 1};
  const auto scene = import_bytes(b.glb());
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().code, "nothing_to_bake");
}

TEST(Nodes, FlattenedFloorKeepsItsNormal) {
  const scene::Scene scene = with_node({{"scale", {1, 1, 0}}});
  EXPECT_EQ(scene.triangles.size(), 1u);
  EXPECT_EQ(scene.normals.at(0), (math::Vec3{0, 0, 1}));
}

TEST(Nodes, WholeNumbersWrittenWithAFractionAreIntegers) {
  GltfBuilder b = test::triangle_builder();
  b.json["nodes"][0]["mesh"] = 0.0;
  b.json["accessors"][0]["count"] = 3.0;
  EXPECT_EQ(imported(b).triangles.size(), 1u);
}

}  // namespace
}  // namespace kiln::import
