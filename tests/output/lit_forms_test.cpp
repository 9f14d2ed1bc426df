#include "tests/output/lit_scene.h"

namespace kiln::output {
namespace {

// The forms of lit.glb that the settings output.glb_* and keep_lights ask for.

LitPages pages_as(proto::GlbLightmap lightmap, std::uint32_t count = 1) {
  LitPages pages = lit_pages(count);
  pages.lightmap = lightmap;
  if (lightmap == proto::GlbLightmap::kNone)
    for (LitPage& page : pages.pages) page.png.clear();
  return pages;
}

LitPages unlit_pages() {
  LitPages pages = lit_pages(1);
  pages.mode = proto::GlbMode::kUnlit;
  return pages;
}

TEST(LitForms, RgbmIsReadByMxLightmapOnNodes) {
  const test::TempFolder folder;
  const GlbReader lit =
      light(folder, save(folder, triangle()), Layout::kWhole, pages_as(proto::GlbLightmap::kRgbm));
  EXPECT_EQ(lit.json["extensionsUsed"], Json::array({"MX_lightmap"}));
  const Json& node = lit.json["nodes"][0]["extensions"]["MX_lightmap"];
  EXPECT_EQ(node["lightMapTexture"], Json::parse(R"({"index": 0, "texCoord": 1})"));
  EXPECT_NEAR(node["intensity"].get<double>() * 34.49, 50, 1e-5);
  EXPECT_EQ(lit.json["materials"][0],
            Json::parse(R"({"name": "paint", "extras": {"lightkiln": {"page": 0}}})"));
  const Json& told = lit.json["asset"]["extras"]["lightkiln"];
  EXPECT_EQ(told["encoding"], "rgbm");
  EXPECT_EQ(told["pages"],
            Json::parse(R"([{"texture": 0, "scale": 50.0, "exposure": 0.5, "exr": "page.exr"}])"));
  EXPECT_NE(told["formula"].get<std::string>().find("alpha^2.2"), std::string::npos);
}

TEST(LitForms, WithoutPagesThereAreCoordinatesAndNames) {
  const test::TempFolder folder;
  GltfFile g = triangle();
  g.node({{"mesh", 0}});
  const GlbReader lit =
      light(folder, save(folder, g), Layout::kWhole, pages_as(proto::GlbLightmap::kNone, 2));
  for (const char* absent : {"images", "textures", "samplers", "extensionsUsed"})
    EXPECT_FALSE(lit.json.contains(absent)) << absent;
  for (const Json& node : lit.json["nodes"]) EXPECT_FALSE(node.contains("extensions"));
  for (int n = 0; n < 2; ++n) {
    const Json& primitive = lit.json["meshes"][int(lit.json["nodes"][n]["mesh"])]["primitives"][0];
    EXPECT_TRUE(primitive["attributes"].contains("TEXCOORD_1"));
    const Json& material = lit.json["materials"][int(primitive["material"])];
    EXPECT_EQ(material["extras"]["lightkiln"]["page"], n);
    EXPECT_FALSE(material.contains("extensions"));
  }
  const Json& told = lit.json["asset"]["extras"]["lightkiln"];
  EXPECT_EQ(told["encoding"], "none");
  const Json page = Json::parse(R"({"exposure": 0.5, "exr": "page.exr"})");
  EXPECT_EQ(told["pages"], Json::array({page, page}));
}

TEST(LitForms, UnlitMaterialsShowThePageAndNothingElse) {
  const test::TempFolder folder;
  GltfFile g = triangle();
  Json& attributes = g.json["meshes"][0]["primitives"][0]["attributes"];
  attributes["COLOR_0"] = g.floats({1, 0, 0, 0, 1, 0, 0, 0, 1}, "VEC3", 3);
  attributes["TEXCOORD_1"] = g.floats({0, 0, 3, 0, 0, 3}, "VEC2", 2);
  g.json["materials"][0] = Json::parse(R"({"name": "paint", "doubleSided": true,
      "alphaMode": "MASK", "alphaCutoff": 0.3, "extras": {"mine": 1}, "emissiveFactor": [1, 1, 1],
      "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.2, 0.1, 0.75], "metallicFactor": 1},
      "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 5}, "ACME_x": {}}})");
  g.json["extensionsUsed"] = {"KHR_materials_emissive_strength", "ACME_x"};
  const GlbReader lit = light(folder, save(folder, g), Layout::kWhole, unlit_pages());
  EXPECT_EQ(lit.json["materials"][0], Json::parse(R"({"pbrMetallicRoughness":
                {"baseColorTexture": {"index": 0, "texCoord": 1}, "metallicFactor": 0,
                 "roughnessFactor": 0.9, "baseColorFactor": [1, 1, 1, 0.75]},
                "name": "paint", "extras": {"mine": 1}, "alphaMode": "MASK", "alphaCutoff": 0.3,
                "doubleSided": true, "extensions": {"ACME_x": {}, "KHR_materials_unlit": {}}})"));
  const Json& used = lit.json["extensionsUsed"];
  EXPECT_NE(std::find(used.begin(), used.end(), "KHR_materials_unlit"), used.end());
  EXPECT_EQ(std::find(used.begin(), used.end(), "MOZ_lightmap"), used.end());
  EXPECT_FALSE(lit.json["nodes"][0].contains("extensions"));
  const Json& out = lit.json["meshes"][0]["primitives"][0]["attributes"];
  EXPECT_FALSE(out.contains("COLOR_0")) << "the page has them already";
  EXPECT_FALSE(out.contains("TEXCOORD_2")) << "nothing reads the source's set";
  const Json& told = lit.json["asset"]["extras"]["lightkiln"];
  EXPECT_EQ(told["encoding"], "display");
  EXPECT_EQ(told["pages"], Json::parse(R"([{"texture": 0, "exposure": 0.5, "exr": "page.exr"}])"));
}

// Lights ------------------------------------------------------------------------------------------

/// A triangle, two lights in the scene, one as a child, and one in another scene.
GltfFile with_lights() {
  GltfFile g = triangle();
  g.json["extensionsUsed"] = {"KHR_lights_punctual"};
  g.json["extensionsRequired"] = {"KHR_lights_punctual"};
  g.json["extensions"]["KHR_lights_punctual"]["lights"] =
      Json::array({{{"type", "point"}}, {{"type", "directional"}}});
  const auto lamp = [](int light) {
    return Json{{"extensions", {{"KHR_lights_punctual", {{"light", light}}}}}};
  };
  g.node(lamp(0));
  g.json["nodes"].push_back(lamp(1));
  g.json["nodes"][0]["children"] = {2};
  return g;
}

Json animation_of(const char* pointer) {
  return {
      {"channels",
       Json::array({{{"sampler", 0},
                     {"target",
                      {{"path", "pointer"},
                       {"extensions", {{"KHR_animation_pointer", {{"pointer", pointer}}}}}}}}})},
      {"samplers", Json::array({{{"input", 0}, {"output", 0}}})}};
}

TEST(LitForms, LightsOfTheSceneAreLeftOut) {
  const test::TempFolder folder;
  GltfFile g = with_lights();
  g.json["animations"] =
      Json::array({animation_of("/extensions/KHR_lights_punctual/lights/0/intensity"),
                   animation_of("/nodes/0/translation")});
  const GlbReader lit = light(folder, g, Layout::kWhole);
  EXPECT_EQ(lit.json["nodes"].size(), 3u);
  EXPECT_EQ(lit.json["nodes"][1], Json::object());
  EXPECT_EQ(lit.json["nodes"][2], Json::object());
  EXPECT_FALSE(lit.json.contains("extensions"));
  EXPECT_EQ(lit.json["extensionsUsed"], Json::array({"MOZ_lightmap"}));
  EXPECT_FALSE(lit.json.contains("extensionsRequired"));
  EXPECT_EQ(lit.json["animations"], Json::array({animation_of("/nodes/0/translation")}));
}

TEST(LitForms, LightsAreKeptWhereTheyAreAskedFor) {
  const test::TempFolder folder;
  const GltfFile g = with_lights();
  LitPages pages = lit_pages(1);
  pages.keep_lights = true;
  const GlbReader lit = light(folder, save(folder, g), Layout::kWhole, pages);
  EXPECT_EQ(lit.json["nodes"], g.json["nodes"]);
  EXPECT_EQ(lit.json["extensions"], g.json["extensions"]);
  EXPECT_EQ(lit.json["extensionsRequired"], g.json["extensionsRequired"]);
}

TEST(LitForms, ALightOfAnotherSceneStays) {
  const test::TempFolder folder;
  GltfFile g = with_lights();
  g.json["nodes"].push_back(g.json["nodes"][1]);
  g.json["scenes"].push_back({{"nodes", {3}}});
  g.json["animations"] =
      Json::array({animation_of("/extensions/KHR_lights_punctual/lights/0/intensity"),
                   animation_of("/nodes/1/extensions/KHR_lights_punctual/light"),
                   animation_of("/nodes/3/extensions/KHR_lights_punctual/light")});
  const GlbReader lit = light(folder, g, Layout::kWhole);
  EXPECT_EQ(lit.json["nodes"][1], Json::object());
  EXPECT_EQ(lit.json["nodes"][3], g.json["nodes"][3]);
  EXPECT_EQ(lit.json["extensions"], g.json["extensions"]);
  EXPECT_EQ(lit.json["extensionsRequired"], g.json["extensionsRequired"]);
  EXPECT_EQ(lit.json["animations"],
            Json::array({g.json["animations"][0], g.json["animations"][2]}));
}

}  // namespace
}  // namespace kiln::output
