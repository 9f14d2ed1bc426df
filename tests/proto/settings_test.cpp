#include <gtest/gtest.h>

#include <map>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "proto/settings_schema.h"

namespace kiln::proto {
namespace {

using nlohmann::json;

Error error_of(std::string_view text) {
  auto settings = parse_settings(text);
  EXPECT_FALSE(settings.has_value()) << text.substr(0, 100);
  return settings ? Error{} : settings.error();
}

std::string pointer_of(std::string_view text) {
  const auto e = error_of(text);
  return e.details.size() == 1 ? e.details[0].pointer
                               : std::to_string(e.details.size()) + " places";
}

TEST(Settings, NothingMeansDefaults) {
  const json defaults = to_json(BakeSettings{});
  EXPECT_EQ(to_json(*parse_settings("")), defaults);
  EXPECT_EQ(to_json(*parse_settings("{}")), defaults);
  EXPECT_EQ(defaults["solver"]["tolerance"].dump(), "0.001");  // Not 0.0010000000474974513.
  EXPECT_EQ(defaults["atlas"]["texels_per_metre"], nullptr);
  EXPECT_EQ(defaults["lights"], json::array());
}

TEST(Settings, EveryMemberSurvivesARoundTrip) {
  const char* text = R"({
    "atlas": {"page_size": 512, "max_pages": 3, "texels_per_metre": 12.5, "unwrap": "existing",
              "gutter": 7},
    "quality": {"preset": "draft", "target_error": 0.125, "measure": "rms",
                "max_samples": 77},
    "solver": {"method": "path", "bounces": 5, "samples": 99, "direct_samples": 17,
               "hit_memory_mib": 12, "coarse_indirect": false,
                "ray_pattern": "block", "tolerance": 0.1, "seed": 9007199254740991,
                "without": ["shadow_probes", "low_discrepancy"], "pair_samples": 4,
               "reflectivity_factor": 0.9, "distance_factor": 1.5, "window": 4,
               "undersampling": "monte_carlo", "sender_seed": "receiver",
               "iteration": "gauss_seidel", "batch_texels": 33, "max_contribution": 0.05,
               "max_view_factor": 0.25, "subdivision_threshold": null, "subdivision_ramp": 0.01,
               "subdivision_max_node": 16, "visibility": "voxel", "visibility_cache_mib": 64,
               "voxel_grid": 32, "voxel_march": "fixed_steps", "voxel_ratio": 0.75,
               "direction_set": "hemicube", "rotate_directions": false, "mip_radiosity": false,
               "rtrad_compat": false, "series": "unbiased", "initial_samples": 8,
               "same_directions": true, "light_sampling": "stratified", "ambient_term": true,
               "emitters": "explicit", "near_field": false, "link_error": 0.5,
               "allow_expensive": true},
    "sky": {"radiance": [0.1, 2, 3000.7], "map": "skies/n\u00f6n.exr", "scale": 0.5,
            "rotation": -90},
    "lights": [
      {"type": "directional", "color": [1, 0.5, 0.25], "intensity": 3.3, "direction": [0, -2, 1]},
      {"type": "point", "color": [1, 1, 1], "intensity": 0, "position": [1, 2, 3], "range": null},
      {"type": "spot", "color": [0, 0, 1], "intensity": 8, "position": [-1e6, 1e6, 0],
       "direction": [1, 0, 0], "range": 4.5, "inner_cone_angle": 0.2, "outer_cone_angle": 1.5},
      {"type": "rect", "color": [1, 1, 1], "intensity": 1e9, "position": [0, 0, 0],
       "direction": [0, 0, 1], "width": 0.3, "height": 10000}],
    "allow_dark": true,
    "post": {"filter": false, "dilate": 0},
    "output": {"precision": "float", "layers": ["indirect", "direct"], "formats": ["glb"],
               "exposure": 0.0125, "tone_curve": null, "preview_fade": 0.25,
               "glb_lightmap": "rgbm", "glb_mode": "lightmap", "keep_lights": true},
    "report": {"against": "refs/page_00.exr", "samples": 12, "error_scale": 2.5}})";
  const auto settings = parse_settings(text);
  ASSERT_TRUE(settings) << settings.error().message;
  EXPECT_EQ(to_json(*settings), json::parse(text));
  EXPECT_FALSE(settings->report.method());
  EXPECT_EQ(parse_settings(R"({"report": {"against": "matrix"}})")->report.method(),
            Method::kMatrix);
  EXPECT_EQ(settings->solver.seed, (1ull << 53) - 1);
  EXPECT_EQ(settings->atlas.unwrap, Unwrap::kExisting);
  EXPECT_EQ(settings->solver.method, Method::kPath);
  EXPECT_EQ(settings->output.precision, Precision::kFloat);
  ASSERT_EQ(settings->lights.size(), 4u);
  EXPECT_EQ(settings->lights[2].type, LightType::kSpot);
  EXPECT_EQ(settings->lights[2].range, 4.5f);
  EXPECT_EQ(settings->lights[3].width, 0.3f);
  EXPECT_EQ(settings->sky.radiance[2], 3000.7f);
}

TEST(Settings, AllProblemsAreToldAtOnce) {
  const auto e = error_of(R"({"solver": {"bouncs": 3, "samples": 0, "seed": -1, "method": "magic"},
                              "atlas": 5, "postt": {}, "lights": [{"type": "point"}, 3],
                              "allow_dark": "yes"})");
  EXPECT_EQ(e.code, "invalid_settings");
  std::map<std::string, std::string> places;
  for (const auto& d : e.details) {
    EXPECT_EQ(d.source, "settings");
    places[d.pointer] = d.detail;
  }
  ASSERT_EQ(places.size(), 8u);
  EXPECT_EQ(places["/solver/bouncs"], "unknown setting \"bouncs\"; did you mean \"bounces\"?");
  EXPECT_EQ(places["/solver/samples"],
            "expected an integer from 1 to 65536, or null (samples/texel), found 0");
  EXPECT_EQ(places["/solver/seed"], "expected an integer from 0 to 9007199254740991, found -1");
  EXPECT_EQ(places["/solver/method"],
            "expected one of \"gather\", \"path\", \"pairwise\", \"matrix\", \"radiosity_map\", "
            "\"directional\", \"links\", found \"magic\"");
  EXPECT_EQ(places["/atlas"], "expected an object, found 5");
  EXPECT_EQ(places["/postt"], "unknown setting \"postt\"; did you mean \"post\"?");
  EXPECT_EQ(places["/lights/1"], "expected an object, found 3");
  EXPECT_EQ(places["/allow_dark"], "expected true or false, found \"yes\"");
  EXPECT_NE(e.message.find("(and 7 more)"), std::string::npos);
}

TEST(Settings, PairsThatMakeNoSenseTogetherAreTold) {
  EXPECT_EQ(pointer_of(R"({"solver": {"iteration": "shooting", "undersampling": "stride"}})"),
            "/solver/iteration");
  EXPECT_EQ(pointer_of(R"({"solver": {"visibility": "cached", "pair_samples": 2}})"),
            "/solver/visibility");
  EXPECT_EQ(pointer_of(R"({"solver": {"visibility": "cached", "undersampling": "mipmap"}})"),
            "/solver/visibility");
  EXPECT_TRUE(parse_settings(R"({"solver": {"visibility": "cached", "undersampling": "stride"}})"));
  EXPECT_TRUE(parse_settings(R"({"solver": {"visibility": "voxel", "pair_samples": 2}})"));
}

TEST(Settings, HostileDocumentsGiveSmallErrors) {
  json doc = json::object();
  for (int i = 0; i < 20'000; ++i) doc["key" + std::to_string(i)] = i;
  const auto e = error_of(doc.dump());
  EXPECT_EQ(e.details.size(), 64u);
  EXPECT_NE(e.message.find("(and 19999 more)"), std::string::npos);
  EXPECT_LT(to_json(error_of("{\"" + std::string(1'000'000, 'x') + "\":1}")).dump().size(), 2000u);
  EXPECT_LT(to_json(error_of(R"({"solver":{"samples":")" + std::string(1'000'000, 'x') + "\"}}"))
                .dump()
                .size(),
            2000u);
}

TEST(Settings, TheDocumentIsAnObject) {
  for (const char* text : {"[]", "null", "3", "\"x\"", "true"}) EXPECT_EQ(pointer_of(text), "");
  EXPECT_EQ(error_of("{]").code, "invalid_json");
  EXPECT_EQ(pointer_of(R"({"solver": null})"), "/solver");
  EXPECT_EQ(pointer_of(R"({"a/b~c": 1})"), "/a~1b~0c");
}

TEST(Settings, NumbersOfTheWrongKind) {
  EXPECT_EQ(pointer_of(R"({"solver": {"samples": "64"}})"), "/solver/samples");
  EXPECT_EQ(pointer_of(R"({"solver": {"samples": 1.5}})"), "/solver/samples");
  EXPECT_EQ(pointer_of(R"({"solver": {"samples": true}})"), "/solver/samples");
  EXPECT_EQ(pointer_of(R"({"solver": {"bounces": null}})"), "/solver/bounces");
  EXPECT_FALSE(parse_settings(R"({"solver": {"samples": null}})")->solver.samples);
  EXPECT_EQ(pointer_of(R"({"solver": {"samples": 4294967297}})"), "/solver/samples");
  EXPECT_EQ(pointer_of(R"({"solver": {"seed": 18446744073709551617}})"), "/solver/seed");
  EXPECT_EQ(pointer_of(R"({"solver": {"seed": 9007199254740992}})"), "/solver/seed");
  EXPECT_EQ(parse_settings(R"({"solver": {"samples": 64.0, "seed": 1e3}})")->solver.seed, 1000u);
}

TEST(Settings, ListsOfWords) {
  EXPECT_EQ(pointer_of(R"({"output": {"layers": []}})"), "/output/layers");
  EXPECT_TRUE(parse_settings(R"({"solver": {"without": []}})"));
  EXPECT_EQ(pointer_of(R"({"solver": {"without": ["luck"]}})"), "/solver/without");
  EXPECT_EQ(pointer_of(R"({"output": {"layers": ["direct", "direct"]}})"), "/output/layers");
  EXPECT_EQ(pointer_of(R"({"output": {"layers": "direct"}})"), "/output/layers");
  EXPECT_EQ(pointer_of(R"({"output": {"formats": ["exr", "tga"]}})"), "/output/formats");
  EXPECT_EQ(pointer_of(R"({"output": {"formats": ["exr", 1]}})"), "/output/formats");
  EXPECT_TRUE(parse_settings(R"({"output": {"formats": ["png"]}})"));
}

TEST(Settings, ALayerOfErrorsNeedsAReference) {
  const std::string layers = R"({"output": {"layers": ["irradiance", "error"]})";
  EXPECT_EQ(pointer_of(layers + "}"), "/output/layers");
  EXPECT_EQ(pointer_of(layers + R"(, "report": {"against": null}})"), "/output/layers");
  EXPECT_TRUE(parse_settings(layers + R"(, "report": {"against": "path"}})"));
}

TEST(Settings, ALayerOfTheQuadtreeNeedsItsNodes) {
  EXPECT_TRUE(parse_settings(R"({"solver": {"subdivision_max_node": 12}})"));
  EXPECT_EQ(
      pointer_of(R"({"solver": {"subdivision_max_node": 12}, "output": {"layers": ["tree"]}})"),
      "/solver/subdivision_max_node");
  EXPECT_TRUE(parse_settings(
      R"({"solver": {"subdivision_max_node": 16}, "output": {"layers": ["tree"]}})"));
}

TEST(Settings, AToneCurveAndAnExposureExcludeEachOther) {
  EXPECT_EQ(parse_settings(R"({"output": {"tone_curve": 0.05}})")->output.tone_curve, 0.05f);
  EXPECT_EQ(pointer_of(R"({"output": {"tone_curve": 0.05, "exposure": 1}})"), "/output/tone_curve");
  EXPECT_TRUE(parse_settings(R"({"output": {"tone_curve": 0.05, "exposure": null}})"));
  EXPECT_EQ(pointer_of(R"({"output": {"tone_curve": 0}})"), "/output/tone_curve");
  EXPECT_EQ(pointer_of(R"({"output": {"tone_curve": true}})"), "/output/tone_curve");
}

TEST(Settings, UnlitColorsArePlainSrgb) {
  EXPECT_EQ(parse_settings("{}")->output.glb_lightmap, GlbLightmap::kSrgb8);
  EXPECT_EQ(parse_settings(R"({"output": {"glb_lightmap": "none"}})")->output.glb_lightmap,
            GlbLightmap::kNone);
  EXPECT_EQ(parse_settings(R"({"output": {"glb_mode": "unlit"}})")->output.glb_mode,
            GlbMode::kUnlit);
  for (const char* form : {"rgbm", "none"})
    EXPECT_EQ(pointer_of(R"({"output": {"glb_mode": "unlit", "glb_lightmap": ")" +
                         std::string(form) + "\"}}"),
              "/output/glb_lightmap");
  EXPECT_TRUE(parse_settings(
      R"({"output": {"glb_mode": "unlit", "keep_lights": true, "formats": ["exr"]}})"));
}

TEST(Settings, PreviewsGoSomeOfTheWay) {
  EXPECT_EQ(parse_settings("{}")->output.preview_fade, 1);
  EXPECT_EQ(pointer_of(R"({"output": {"preview_fade": 0}})"), "/output/preview_fade");
  EXPECT_EQ(pointer_of(R"({"output": {"preview_fade": 1.5}})"), "/output/preview_fade");
  EXPECT_EQ(pointer_of(R"({"output": {"preview_fade": null}})"), "/output/preview_fade");
}

TEST(Settings, GutterMustLeaveRoomOnThePage) {
  EXPECT_EQ(pointer_of(R"({"atlas": {"page_size": 16, "gutter": 8}})"), "/atlas/gutter");
  EXPECT_TRUE(parse_settings(R"({"atlas": {"page_size": 16, "gutter": 7}})"));
}

TEST(Settings, DirectionsMustBeOnesThatThereAre) {
  const auto directional = [](const std::string& more) {
    return R"({"solver": {"method": "directional", )" + more + "}}";
  };
  EXPECT_TRUE(parse_settings(directional(R"("samples": 4096)")));
  EXPECT_EQ(pointer_of(directional(R"("samples": 4097)")), "/solver/samples");
  EXPECT_TRUE(parse_settings(R"({"solver": {"method": "path", "samples": 4097}})"));
  EXPECT_TRUE(parse_settings(directional(R"("rtrad_compat": true)")));
  EXPECT_EQ(pointer_of(directional(R"("rtrad_compat": true, "direction_set": "hemicube")")),
            "/solver/rtrad_compat");
}

TEST(Settings, EmittersSendTheirLightInEveryMethod) {
  for (const Word& method : kMethodNames)
    EXPECT_TRUE(parse_settings(R"({"solver": {"emitters": "transport", "method": ")" +
                               std::string(method.name) + "\"}}"))
        << method.name;
}

std::vector<Warning> warnings_of(const std::string& text) {
  const auto settings = parse_settings(text);
  if (!settings) throw std::runtime_error(settings.error().message);
  return settings_without_effect(*settings);
}

TEST(SettingsWithoutEffect, AreToldWhereTheMethodReadsThemNot) {
  const auto told =
      warnings_of(R"({"solver": {"voxel_grid": 32, "bounces": 3, "link_error": 0.1}})");
  ASSERT_EQ(told.size(), 2u);
  EXPECT_EQ(told[0].code, "setting_without_effect");
  EXPECT_EQ(told[0].pointer, "/solver/voxel_grid");
  EXPECT_EQ(told[0].message,
            "solver.voxel_grid has no effect with solver.method gather; pairwise, matrix and links "
            "read it.");
  EXPECT_EQ(told[1].pointer, "/solver/link_error");
  EXPECT_EQ(told[1].message,
            "solver.link_error has no effect with solver.method gather; links reads it.");
}

TEST(SettingsWithoutEffect, AreNoneWhereSomethingReadsThem) {
  EXPECT_TRUE(warnings_of("{}").empty());
  EXPECT_TRUE(warnings_of(R"({"solver": {"voxel_grid": 64, "window": null}})").empty())
      << "the defaults";
  EXPECT_TRUE(warnings_of(R"({"solver": {"method": "links", "voxel_grid": 32}})").empty());
  EXPECT_TRUE(
      warnings_of(R"({"solver": {"voxel_grid": 32}, "output": {"layers": ["voxels"]}})").empty());
  EXPECT_TRUE(warnings_of(R"({"solver": {"subdivision_max_node": 16, "subdivision_threshold": 0.1},
                      "output": {"layers": ["irradiance", "tree"]}})")
                  .empty());
  const std::string reference = R"("report": {"against": "pairwise"}})";
  EXPECT_TRUE(warnings_of(R"({"solver": {"reflectivity_factor": 0.5}, )" + reference).empty());
  EXPECT_EQ(warnings_of(R"({"solver": {"max_view_factor": 0.5}, )" + reference).size(), 1u)
      << "a reference leaves out what approximates";
}

TEST(Settings, AQuadtreeAndWindowsExcludeEachOther) {
  EXPECT_EQ(pointer_of(R"({"solver": {"subdivision_threshold": 0.1, "undersampling": "mipmap"}})"),
            "/solver/subdivision_threshold");
  EXPECT_TRUE(parse_settings(R"({"solver": {"undersampling": "mipmap"}})"));
  EXPECT_EQ(pointer_of(R"({"solver": {"subdivision_threshold": 0.1, "subdivision_max_node": 12}})"),
            "/solver/subdivision_max_node");
  EXPECT_TRUE(
      parse_settings(R"({"solver": {"subdivision_threshold": 0.1, "subdivision_max_node": 16}})"));
}

std::string light(const std::string& members) {
  return R"({"lights": [{)" + members + "}]}";
}

TEST(Settings, LightsRefuseKeysThatTheirTypeDoesNotUse) {
  const auto e = error_of(light(R"("type": "rect", "range": 3, "inner_cone_angle": 0)"));
  ASSERT_EQ(e.details.size(), 2u);
  EXPECT_EQ(e.details[0].pointer, "/lights/0/range");
  EXPECT_NE(e.details[0].detail.find("type \"rect\" does not use \"range\""), std::string::npos);
  EXPECT_EQ(pointer_of(light(R"("type": "directional", "position": [0, 0, 0])")),
            "/lights/0/position");
  EXPECT_EQ(pointer_of(light(R"("type": "point", "direction": [0, 0, 1])")), "/lights/0/direction");
  EXPECT_EQ(pointer_of(light(R"("type": "spot", "width": 1)")), "/lights/0/width");
}

TEST(Settings, LightsNeedAType) {
  EXPECT_EQ(pointer_of(light(R"("intensity": 1)")), "/lights/0");
  EXPECT_EQ(pointer_of(light(R"("type": "sun")")), "/lights/0/type");
  EXPECT_EQ(pointer_of(light(R"("type": 1)")), "/lights/0/type");
}

TEST(Settings, LightGeometry) {
  const std::string spot = R"("type": "spot", )";
  EXPECT_EQ(pointer_of(light(spot + R"("direction": [0, 0, 0])")), "/lights/0/direction");
  EXPECT_EQ(pointer_of(light(spot + R"("direction": [1e-7, 0, -1e-30])")), "/lights/0/direction");
  EXPECT_EQ(pointer_of(light(spot + R"("direction": [0, 1])")), "/lights/0/direction");
  EXPECT_EQ(pointer_of(light(spot + R"("range": 0)")), "/lights/0/range");
  EXPECT_EQ(pointer_of(light(spot + R"("inner_cone_angle": 0.9)")), "/lights/0/inner_cone_angle");
  EXPECT_EQ(pointer_of(light(spot + R"("outer_cone_angle": 1.6)")), "/lights/0/outer_cone_angle");
  EXPECT_TRUE(parse_settings(light(spot + R"("inner_cone_angle": 1, "outer_cone_angle": 1)")));
  // The exact pi/2 of a double, and what becomes of it in float, are both fine.
  const auto wide = parse_settings(light(spot + R"("outer_cone_angle": 1.5707963267948966)"));
  ASSERT_TRUE(wide);
  EXPECT_TRUE(settings_from_json(to_json(*wide)));
}

TEST(Settings, NumberOfLights) {
  json doc;
  for (std::size_t i = 0; i < kMaxLights; ++i) doc["lights"].push_back({{"type", "point"}});
  EXPECT_TRUE(settings_from_json(doc));
  doc["lights"].push_back({{"type", "point"}});
  EXPECT_EQ(pointer_of(doc.dump()), "/lights");
  EXPECT_EQ(pointer_of(R"({"lights": {}})"), "/lights");
}

}  // namespace
}  // namespace kiln::proto
