#include "tests/output/lit_scene.h"

namespace kiln::output {
namespace {

std::string base64(const std::string& bytes) {
  static constexpr char kAlphabet[] =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t v = 0;
    const std::size_t n = std::min<std::size_t>(3, bytes.size() - i);
    for (std::size_t k = 0; k < 3; ++k)
      v = v << 8 | (k < n ? static_cast<unsigned char>(bytes[i + k]) : 0);
    for (std::size_t k = 0; k < 4; ++k) out += k <= n ? kAlphabet[v >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

std::string small_png() {
  return image::encode_png(std::vector<std::array<std::uint8_t, 3>>(4, {9, 8, 7}), 2, 2).value();
}

TEST(LitDocument, MaterialsReferenceTheLightmap) {
  const test::TempFolder folder;
  const GlbReader lit = light(folder, triangle(), Layout::kWhole);
  EXPECT_EQ(lit.json["extensionsUsed"], Json::array({"MOZ_lightmap"}));
  EXPECT_FALSE(lit.json.contains("extensionsRequired"));
  EXPECT_EQ(lit.json["materials"][0],
            Json::parse(R"({"name": "paint", "extensions": {"MOZ_lightmap":
                            {"index": 0, "texCoord": 1, "intensity": 50.0}},
                            "extras": {"lightkiln": {"page": 0}}})"));
  // MX_lightmap reads RGBM, which these pages are not.
  EXPECT_FALSE(lit.json["nodes"][0].contains("extensions"));
  const Json& image = lit.json["images"][int(lit.json["textures"][0]["source"])];
  EXPECT_EQ(lit.view(image["bufferView"]), lit_pages(1).pages[0].png);
  const Json& told = lit.json["asset"]["extras"]["lightkiln"];
  EXPECT_EQ(told["pages"],
            Json::parse(R"([{"texture": 0, "scale": 50.0, "clipped": 3, "clipped_lamps": 2,
                             "exposure": 0.5, "exr": "page.exr"}])"));
  EXPECT_EQ(told["encoding"], "srgb8");
}

TEST(LitDocument, EverythingElseIsKept) {
  const test::TempFolder folder;
  GltfFile g = triangle();
  g.json["asset"]["generator"] = "by hand";
  g.json["asset"]["extras"] = {{"mine", {1, 2.5, "x"}}};
  g.json["extensionsUsed"] = {"ACME_unknown"};
  g.json["extensions"] = {{"ACME_unknown", {{"deep", {{"er", {true, nullptr}}}}}}};
  g.json["scenes"][0]["name"] = "stage";
  g.json["nodes"][0]["extras"] = {{"tag", "a"}};
  g.json["nodes"][0]["extensions"] = {{"ACME_unknown", {{"at", 1}}}};
  g.json["materials"][0]["extras"] = 17;
  const int times = g.floats({0, 1}, "SCALAR", 1);
  const int moves = g.floats({0, 0, 0, 1, 0, 0}, "VEC3", 3);
  g.json["animations"] = Json::array(
      {{{"name", "slide"},
        {"channels",
         Json::array({{{"sampler", 0}, {"target", {{"node", 0}, {"path", "translation"}}}}})},
        {"samplers", Json::array({{{"input", times}, {"output", moves}}})}}});
  g.json["cameras"] =
      Json::array({{{"type", "perspective"}, {"perspective", {{"yfov", 0.5}, {"znear", 0.1}}}}});
  g.node({{"name", "eye"}, {"camera", 0}});

  GlbReader lit = light(folder, g, Layout::kWhole);
  for (const char* same : {"extensions", "scenes", "scene", "animations", "cameras"})
    EXPECT_EQ(lit.json[same], g.json[same]) << same;
  EXPECT_EQ(lit.json["extensionsUsed"], Json({"ACME_unknown", "MOZ_lightmap"}));
  lit.json["asset"]["extras"].erase("lightkiln");
  EXPECT_EQ(lit.json["asset"], g.json["asset"]);
  EXPECT_EQ(lit.json["nodes"], g.json["nodes"]);
  EXPECT_EQ(lit.json["materials"][0]["extras"], 17);
  for (std::size_t i = 0; i < g.json["accessors"].size(); ++i)
    EXPECT_EQ(lit.json["accessors"][i], g.json["accessors"][i]);
  EXPECT_EQ(lit.bin.substr(0, g.bin.size()), g.bin);
}

TEST(LitDocument, OneVariantOfAMaterialForEachPage) {
  const test::TempFolder folder;
  GltfFile g = triangle();
  g.node({{"mesh", 0}});
  g.node({{"mesh", 0}});
  const GlbReader lit = light(folder, g, Layout::kWhole, 2);
  const auto material_of = [&](int node) {
    return lit.json["meshes"][int(lit.json["nodes"][node]["mesh"])]["primitives"][0]["material"]
        .get<int>();
  };
  EXPECT_EQ(material_of(0), 0);  // instances 0 and 2 lie on page 0
  EXPECT_EQ(material_of(2), 0);
  EXPECT_EQ(material_of(1), 1);
  ASSERT_EQ(lit.json["materials"].size(), 2u);
  EXPECT_EQ(lit.json["materials"][1]["name"], "paint");
  EXPECT_EQ(lit.json["materials"][1]["extensions"]["MOZ_lightmap"]["intensity"], 100.0);
  EXPECT_NE(lit.json["materials"][0]["extensions"]["MOZ_lightmap"]["index"],
            lit.json["materials"][1]["extensions"]["MOZ_lightmap"]["index"]);
}

TEST(LitDocument, ATextureOnTexcoord1MovesToAFreeSet) {
  const test::TempFolder folder;
  GltfFile g = triangle();
  g.add("images", {{"mimeType", "image/png"}, {"bufferView", 0}});
  const std::string png = small_png();
  g.json["images"][0]["bufferView"] = g.view(std::vector<char>(png.begin(), png.end()));
  g.add("textures", {{"source", 0}});
  auto& attributes = g.json["meshes"][0]["primitives"][0]["attributes"];
  const int second = g.floats({0, 0, 3, 0, 0, 3}, "VEC2", 2);
  attributes["TEXCOORD_1"] = second;
  g.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {{"index", 0},
                                                                        {"texCoord", 1}};
  g.json["materials"][0]["emissiveTexture"] = {
      {"index", 0},
      {"texCoord", 0},
      {"extensions", {{"KHR_texture_transform", {{"texCoord", 1}}}}}};
  g.json["materials"][0]["extras"] = {{"texCoord", 1}};
  g.json["extensionsUsed"] = {"KHR_texture_transform"};

  const GlbReader lit = light(folder, g, Layout::kWhole);
  const Json& out = lit.json["meshes"][0]["primitives"][0]["attributes"];
  EXPECT_EQ(out["TEXCOORD_2"], second);
  EXPECT_NE(out["TEXCOORD_1"], second);
  const Json& material = lit.json["materials"][0];
  EXPECT_EQ(material["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"], 2);
  EXPECT_EQ(material["emissiveTexture"]["texCoord"], 0);
  EXPECT_EQ(material["emissiveTexture"]["extensions"]["KHR_texture_transform"]["texCoord"], 2);
  EXPECT_EQ(material["extras"]["texCoord"], 1);
  EXPECT_EQ(material["extensions"]["MOZ_lightmap"]["texCoord"], 1);
}

TEST(LitDocument, VariantsOfAPrimitiveAreLitToo) {
  const test::TempFolder folder;
  GltfFile g = triangle();
  g.add("materials", {{"name", "night"}});
  g.json["extensionsUsed"] = {"KHR_materials_variants"};
  g.json["extensions"]["KHR_materials_variants"]["variants"] = Json::array({{{"name", "night"}}});
  g.json["meshes"][0]["primitives"][0]["extensions"]["KHR_materials_variants"]["mappings"] =
      Json::array({{{"material", 1}, {"variants", {0}}}});
  const GlbReader lit = light(folder, g, Layout::kWhole);
  EXPECT_TRUE(lit.json["materials"][1]["extensions"].contains("MOZ_lightmap"));
  EXPECT_EQ(lit.json["materials"][1]["name"], "night");
  EXPECT_EQ(lit.json["materials"].size(), 2u);
}

/// The triangle as .gltf with two buffers and three images; `refer` names each part's bytes.
template <class Refer>
Json two_buffers(const GltfFile& g, const std::string& extra, const std::string& png, Refer refer) {
  Json json = g.json;
  json["buffers"] = Json::array({{{"byteLength", g.bin.size()}, {"uri", refer("a.bin", g.bin)}},
                                 {{"byteLength", 6}, {"uri", refer("b.bin", extra)}}});
  json["bufferViews"].push_back({{"buffer", 1}, {"byteOffset", 1}, {"byteLength", 4}});
  json["images"] = Json::array({{{"name", "wood"}, {"uri", refer("tex/wood.png", png)}},
                                {{"uri", "missing.png"}},
                                {{"uri", "http://example.com/a.png"}}});
  json["textures"] = Json::array({{{"source", 0}}});
  return json;
}

void expect_self_contained(const GlbReader& lit, const GltfFile& g, const std::string& png) {
  ASSERT_EQ(lit.json["buffers"].size(), 1u);
  EXPECT_FALSE(lit.json["buffers"][0].contains("uri"));
  EXPECT_EQ(lit.bin.substr(0, g.bin.size()), g.bin);
  const int moved = int(g.json["bufferViews"].size());
  EXPECT_EQ(lit.json["bufferViews"][moved]["buffer"], 0);
  EXPECT_EQ(lit.view(moved), "BCDE");
  const Json& image = lit.json["images"][0];
  EXPECT_EQ(image["name"], "wood");
  EXPECT_EQ(image["mimeType"], "image/png");
  EXPECT_FALSE(image.contains("uri"));
  EXPECT_EQ(lit.view(image["bufferView"]), png);
  // What was not uploaded can't be embedded, and nothing else is ever opened.
  EXPECT_EQ(lit.json["images"][1], Json::parse(R"({"uri": "missing.png"})"));
  EXPECT_EQ(lit.json["images"][2], Json::parse(R"({"uri": "http://example.com/a.png"})"));
}

TEST(LitDocument, DataUrisAreEmbedded) {
  const test::TempFolder folder;
  const GltfFile g = triangle();
  const std::string png = small_png();
  std::ofstream(folder.path() / "scene.gltf")
      << two_buffers(g, "ABCDEF", png, [](const std::string& name, const std::string& bytes) {
           const char* type = name.ends_with("png") ? "image/png" : "application/octet-stream";
           return std::string("data:") + type + ";base64," + base64(bytes);
         });
  const files::SceneFiles files{folder.path() / "scene.gltf", {}};
  expect_self_contained(light(folder, files, Layout::kWhole), g, png);
}

TEST(LitDocument, SideFilesAreEmbedded) {
  const test::TempFolder folder;
  const GltfFile g = triangle();
  const std::string png = small_png();
  files::SceneFiles files{folder.path() / "scene.gltf", {}};
  std::ofstream(files.main) << two_buffers(
      g, "ABCDEF", png, [&](const std::string& name, const std::string& bytes) {
        const auto path = folder.path() / ("part" + std::to_string(files.side.size()));
        std::ofstream(path, std::ios::binary) << bytes;
        files.side[name] = path;
        return name;
      });
  expect_self_contained(light(folder, files, Layout::kWhole), g, png);
}

TEST(LitDocument, SameBytesTwice) {
  const test::TempFolder a, b;
  const GltfFile g = triangle();
  light(a, g, Layout::kPerTriangle);
  light(b, g, Layout::kPerTriangle);
  EXPECT_EQ(test::read_bytes(a.path() / "lit.glb"), test::read_bytes(b.path() / "lit.glb"));
}

}  // namespace
}  // namespace kiln::output
