#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "baker/generate/generate.h"
#include "baker/image/image.h"
#include "baker/output/layers.h"
#include "baker/upload_reader.h"
#include "proto/files.h"
#include "proto/json.h"
#include "tests/output/lit_light.h"
#include "tests/output/lit_scene.h"

namespace kiln::output {
namespace {

/// A Cornell box laid out and lit by hand: E = 100 + x of the texel's position, in lx.
struct Baked {
  test::TempFolder folder;
  files::SceneFiles files;
  scene::Scene scene;
  atlas::Atlas atlas;
  atlas::TextureGroup texels;
  lightmap::Lightmap light;
  proto::BakeSettings settings;
  proto::Manifest manifest;
  std::map<std::string, TexelValue> made;
  exec::ThreadPool pool{2};

  Baked() {
    files.main = folder.path() / "cornell.glb";
    std::ofstream(files.main, std::ios::binary) << generate::generate_glb("cornell").value();
    settings.atlas.page_size = 64;
    scene = import::import_scene(files, settings).value();
    atlas = atlas::build_atlas(scene, settings.atlas).value();
    texels = rasterize(scene, atlas).value();
    light = lightmap::Lightmap(texels.size());
    for (std::uint32_t i = 0; i < texels.size(); ++i) {
      light.direct[i] = {100 + texels.position[i].x, 10, 1};
      light.indirect[i] = {0, 0, 5};
    }
    manifest.version = "1.2.3";
    manifest.scene_sha256 = std::string(64, 'a');
    manifest.settings = settings;
  }
  std::filesystem::path out() const {
    std::filesystem::create_directories(folder.path() / "out");
    return folder.path() / "out";
  }
  proto::Expected<void> write(std::stop_token stop = {}) {
    const denoise::FilteredLight filtered{light.direct, light.sky, light.indirect,
                                          std::vector<float>(light.size(), 9.f),
                                          std::vector<float>(light.size(), 16.f)};
    baker::InProcessReader source(files);
    const LitWriter write_lit = [&](const auto& path, const auto& pages, std::stop_token until) {
      return source.write_lit(path, scene, atlas, pages, std::move(until));
    };
    return write_outputs(out(), {write_lit, scene, atlas, texels, light, filtered, {}, made},
                         settings, manifest, pool, stop);
  }
};

TEST(WriteOutputs, EveryFileIsThereAndHashed) {
  Baked baked;
  const auto ok = baked.write();
  ASSERT_TRUE(ok) << ok.error().message;
  std::vector<std::string> names;
  for (const auto& file : baked.manifest.files) {
    names.push_back(file.name);
    const auto again = proto::digest_file(baked.out() / file.name);
    ASSERT_TRUE(again);
    EXPECT_EQ(again->sha256, file.sha256);
    EXPECT_EQ(again->bytes, std::filesystem::file_size(baked.out() / file.name));
  }
  EXPECT_EQ(names,
            (std::vector<std::string>{"page_00.exr", "page_00.png", "lit.glb", "manifest.json"}));
  const std::filesystem::directory_iterator left(baked.out());
  EXPECT_EQ(std::distance(begin(left), end(left)), 4);  // no temporaries

  const auto json = proto::parse_json(test::read_bytes(baked.out() / "manifest.json"), "request");
  ASSERT_TRUE(json) << json.error().message;
  const auto manifest = proto::manifest_from_json(*json);
  ASSERT_TRUE(manifest) << manifest.error().message;
  EXPECT_EQ(manifest->files.size(), 3u);
  ASSERT_EQ(manifest->pages.size(), 1u);
  EXPECT_EQ(manifest->pages[0].texels, baked.texels.front_count);
  EXPECT_EQ(manifest->pages[0].exr, "page_00.exr");
  EXPECT_EQ(manifest->nodes.size(), baked.scene.instances.size());
}

TEST(WriteOutputs, TheExrHoldsTheSumOfLightAtEachTexel) {
  Baked baked;
  baked.settings.output.precision = proto::Precision::kFloat;
  ASSERT_TRUE(baked.write());
  const auto image = image::read_exr(baked.out() / "page_00.exr");
  ASSERT_TRUE(image);
  std::uint32_t lit = 0;
  for (std::size_t i = 0; i < image->rgb.size(); ++i) {
    const std::int32_t texel = baked.texels.pages[0].texel_at[i];
    EXPECT_EQ(image->coverage[i] > 0, texel >= 0);
    if (texel < 0) continue;
    ++lit;
    EXPECT_EQ(image->rgb[i], baked.light.irradiance(std::uint32_t(texel)));
  }
  EXPECT_EQ(lit, baked.texels.front_count);
  const std::string bytes = test::read_bytes(baked.out() / "page_00.exr");
  for (const char* said : {"lightkiln:units", "lux", "lightkiln:seed", "gather", "1.2.3"})
    EXPECT_NE(bytes.find(said), std::string::npos) << said;
}

TEST(WriteOutputs, SameBytesTwice) {
  Baked a, b;
  ASSERT_TRUE(a.write());
  ASSERT_TRUE(b.write());
  for (const char* name : {"page_00.exr", "page_00.png", "lit.glb"})
    EXPECT_EQ(test::read_bytes(a.out() / name), test::read_bytes(b.out() / name)) << name;
  // All but what was measured.
  const auto manifest = [](const Baked& baked) {
    auto doc = nlohmann::json::parse(test::read_bytes(baked.out() / "manifest.json"));
    EXPECT_EQ(doc["statistics"].erase("peak_memory_bytes"), 1u);
    return doc;
  };
  EXPECT_EQ(manifest(a), manifest(b));
}

TEST(WriteOutputs, LayersAndFormatsAreThoseAskedFor) {
  Baked baked;
  baked.settings.output.formats = {"exr"};
  baked.settings.output.layers = {"irradiance", "indirect"};
  ASSERT_TRUE(baked.write());
  ASSERT_EQ(baked.manifest.files.size(), 2u);
  EXPECT_EQ(baked.manifest.pages[0].preview, "");
  EXPECT_NE(test::read_bytes(baked.out() / "page_00.exr").find("indirect.R"), std::string::npos);
}

std::vector<std::string> all_layers() {
  std::vector<std::string> names;
  for (const Layer& layer : layers()) names.emplace_back(layer.name);
  return names;
}

/// Asks for all layers. Those that whoever bakes has to make hold the numbers of the texels.
void ask_for_all(Baked& baked) {
  baked.settings.output.layers = all_layers();
  for (const Layer& layer : layers())
    if (!layer.value)
      baked.made[layer.name] = [](std::uint32_t t) { return math::Rgb{float(t), 1, 2}; };
}

TEST(WriteOutputs, EveryLayerHasAPicture) {
  Baked baked;
  ask_for_all(baked);
  ASSERT_TRUE(baked.write());
  std::set<std::string> listed;
  for (const auto& file : baked.manifest.files) listed.insert(file.name);
  for (const std::string& name : all_layers()) {
    if (name == "irradiance") continue;  // the preview
    const std::string file = "page_00." + name + ".png";
    EXPECT_TRUE(listed.contains(file)) << file;
    const std::string png = test::read_bytes(baked.out() / file);
    ASSERT_TRUE(png.starts_with("\x89PNG")) << file;
    const auto header = image::read_header(png);
    ASSERT_TRUE(header);
    EXPECT_EQ(header->size.width, 64u);
  }
  EXPECT_FALSE(listed.contains("page_00.irradiance.png"));
}

TEST(WriteOutputs, LayersOfTheSurfaceAreThoseOfItsTexels) {
  Baked baked;
  ask_for_all(baked);
  baked.settings.output.precision = proto::Precision::kFloat;
  for (std::uint32_t i = 0; i < baked.texels.size(); ++i)
    baked.light.validity[i] = i % 2 == 0 ? 1.f : 0.25f;
  ASSERT_TRUE(baked.write());
  const auto layer = [&](const char* name) {
    return image::read_exr(baked.out() / "page_00.exr", name).value();
  };
  const auto position = layer("position"), normal = layer("normal"), albedo = layer("albedo"),
             area = layer("area"), coverage = layer("coverage"), validity = layer("validity"),
             emission = layer("emission"), chart = layer("chart"), checker = layer("texel_checker");
  const atlas::TextureGroup& texels = baked.texels;
  const auto rgb = [](math::Vec3 v) { return math::Rgb{v.x, v.y, v.z}; };
  std::uint32_t emitting = 0;
  std::map<std::uint32_t, math::Rgb> colors;
  for (std::uint32_t t = 0; t < texels.front_count; ++t) {
    const std::size_t at = std::size_t(texels.y[t]) * position.width + texels.x[t];
    EXPECT_EQ(position.rgb[at], rgb(texels.position[t]));
    EXPECT_EQ(normal.rgb[at], rgb(texels.shading_normal[t]));
    EXPECT_EQ(albedo.rgb[at], texels.albedo[t]);
    EXPECT_EQ(area.rgb[at].g, texels.area_m2[t]);
    EXPECT_EQ(coverage.rgb[at].b, texels.coverage[t]);
    EXPECT_EQ(validity.rgb[at].r, t % 2 == 0 ? 1.f : 0.25f);
    // A texel of the lamp has the light of the lamp's material, all others have none.
    const math::Rgb emitted = baked.scene.material_of(texels.triangle[t]).emission;
    EXPECT_NEAR(emission.rgb[at].r, emitted.r, 1e-4f * emitted.r) << t;
    emitting += !is_black(emission.rgb[at]);
    const auto [color, is_new] = colors.try_emplace(texels.chart[t], chart.rgb[at]);
    EXPECT_EQ(color->second, chart.rgb[at]) << "one color a chart";
    const std::int32_t right = texels.neighbor(t, 1, 0);
    if (right != atlas::kNoTexel) {
      const float difference = luminance(checker.rgb[at]) - luminance(checker.rgb[at + 1]);
      EXPECT_GT(std::abs(difference), 0.3f);
    }
  }
  EXPECT_GT(emitting, 0u);
  EXPECT_LT(emitting, texels.front_count);
  ASSERT_GT(colors.size(), 1u);
  for (const auto& [a, color] : colors)
    for (const auto& [b, other] : colors)
      if (a != b) {
        EXPECT_NE(color, other) << a << " " << b;
      }
}

TEST(WriteOutputs, LayersThatAreMadeAboveHaveTheirValues) {
  Baked baked;
  ask_for_all(baked);
  baked.settings.output.precision = proto::Precision::kFloat;
  ASSERT_TRUE(baked.write());
  EXPECT_EQ(baked.made.size(), 5u);
  for (const auto& [name, value] : baked.made) {
    const auto layer = image::read_exr(baked.out() / "page_00.exr", name).value();
    for (std::uint32_t t = 0; t < baked.texels.front_count; ++t)
      EXPECT_EQ(layer.rgb[std::size_t(baked.texels.y[t]) * layer.width + baked.texels.x[t]],
                value(t));
  }
  baked.made.erase("tree");
  const auto ok = baked.write();
  ASSERT_FALSE(ok) << "a layer without values is not written as something else";
  EXPECT_EQ(ok.error().code, "internal");
}

TEST(WriteOutputs, AToneCurveIsForPicturesAlone) {
  Baked plain, curved;
  curved.settings.output.tone_curve = 0.05f;
  for (Baked* baked : {&plain, &curved}) {
    baked->settings.output.layers = {"irradiance", "direct", "emission", "normal"};
    ASSERT_TRUE(baked->write());
  }
  const auto same = [&](const char* name) {
    return test::read_bytes(plain.out() / name) == test::read_bytes(curved.out() / name);
  };
  const proto::PageInfo& page = curved.manifest.pages[0];
  EXPECT_FLOAT_EQ(page.preview_exposure, 1 / page.max_lx);
  EXPECT_TRUE(same("lit.glb"));
  EXPECT_TRUE(same("page_00.normal.png"));
  for (const char* name : {"page_00.png", "page_00.direct.png", "page_00.emission.png"})
    EXPECT_FALSE(same(name)) << name;
}

TEST(WriteOutputs, TheManifestTellsWhatTheLitPageClips) {
  Baked baked;
  const std::uint32_t stray = 40;
  baked.light.direct[stray] = {50'000, 1, 1};
  ASSERT_TRUE(baked.write());
  const proto::PageInfo& page = baked.manifest.pages[0];
  EXPECT_EQ(page.max_lx, 50'000);
  EXPECT_LT(page.glb_scale, 110);  // 100 + x, of all others
  EXPECT_EQ(page.glb_clipped, 1u);
  EXPECT_EQ(page.glb_clipped_lamps, 0u);
  const GlbReader lit(baked.out() / "lit.glb");
  const Json& told = lit.json["asset"]["extras"]["lightkiln"]["pages"][0];
  EXPECT_EQ(told["scale"].get<float>(), page.glb_scale);
  EXPECT_EQ(told["clipped"], 1);
  EXPECT_EQ(told["exposure"].get<float>(), page.preview_exposure);
}

TEST(WriteOutputs, AnUnlitPageShowsReflectedAndOwnLight) {
  Baked baked;
  baked.settings.output.glb_mode = proto::GlbMode::kUnlit;
  ASSERT_TRUE(baked.write());
  EXPECT_EQ(baked.manifest.pages[0].glb_scale, 0);
  const float exposure = baked.manifest.pages[0].preview_exposure;
  const GlbReader lit(baked.out() / "lit.glb");
  EXPECT_FLOAT_EQ(lit.json["asset"]["extras"]["lightkiln"]["pages"][0]["exposure"].get<float>(),
                  exposure);
  const Picture8 picture = page_picture(lit, 0);
  const atlas::TextureGroup& texels = baked.texels;
  for (std::uint32_t t = 0; t < texels.front_count; ++t) {
    const auto& shown = picture.rgba[std::size_t(texels.y[t]) * picture.width + texels.x[t]];
    const math::Rgb emitted = baked.scene.material_of(texels.triangle[t]).emission;
    const double x =
        double(exposure) * (double(texels.albedo[t].r) * double(baked.light.irradiance(t).r) +
                            math::kPi * double(emitted.r));
    const double white = x >= 4 ? 1 : x * (1 + x / 16) / (1 + x);
    EXPECT_NEAR(
        shown[0],
        255 * (white <= 0.0031308 ? 12.92 * white : 1.055 * std::pow(white, 1 / 2.4) - 0.055), 0.51)
        << t;
    EXPECT_EQ(shown[3], 255);
  }
}

TEST(WriteOutputs, APositionBeyondHalfIsWrittenAsFloat) {
  Baked baked;
  baked.settings.output.layers = {"irradiance", "position"};
  for (auto& p : baked.texels.position) p.z -= 100'000;
  ASSERT_TRUE(baked.write());
  ASSERT_EQ(baked.manifest.warnings.size(), 1u);
  EXPECT_EQ(baked.manifest.warnings[0].code, "half_overflow");
  EXPECT_NE(baked.manifest.warnings[0].message.find("position"), std::string::npos);
}

TEST(WriteOutputs, TheExposureIsAutomaticUnlessSet) {
  Baked baked;
  ASSERT_TRUE(baked.write());
  const float automatic = baked.manifest.pages[0].preview_exposure;
  EXPECT_GT(automatic, 0);
  baked.settings.output.exposure = automatic * 2;
  const std::string before = test::read_bytes(baked.out() / "page_00.png");
  ASSERT_TRUE(baked.write());
  EXPECT_EQ(baked.manifest.pages[0].preview_exposure, automatic * 2);
  EXPECT_NE(test::read_bytes(baked.out() / "page_00.png"), before);
}

TEST(WriteOutputs, APageBeyondHalfIsWrittenAsFloatWithAWarning) {
  Baked baked;
  baked.light.direct[3] = {123456, 1, 1};
  ASSERT_TRUE(baked.write());
  ASSERT_EQ(baked.manifest.warnings.size(), 1u);
  EXPECT_EQ(baked.manifest.warnings[0].code, "half_overflow");
  EXPECT_EQ(baked.manifest.pages[0].max_lx, 123456);
  const auto image = image::read_exr(baked.out() / "page_00.exr");
  ASSERT_TRUE(image);
  float max = 0;
  for (const math::Rgb v : image->rgb) max = std::max(max, v.r);
  EXPECT_EQ(max, 123456);  // half precision would have made it infinite
}

TEST(WriteOutputs, AnInfinityNeverLeaves) {
  for (const float bad : {std::numeric_limits<float>::infinity(), std::nanf("")}) {
    Baked baked;
    baked.light.indirect[7].g = bad;
    const auto ok = baked.write();
    ASSERT_FALSE(ok);
    EXPECT_EQ(ok.error().code, "internal");
    const std::string place =
        "(" + std::to_string(baked.texels.x[7]) + ", " + std::to_string(baked.texels.y[7]) + ")";
    EXPECT_NE(ok.error().message.find(place), std::string::npos) << ok.error().message;
    EXPECT_TRUE(std::filesystem::is_empty(baked.out()));
  }
}

TEST(WriteOutputs, StopsWhenTold) {
  Baked baked;
  std::stop_source stop;
  stop.request_stop();
  const auto ok = baked.write(stop.get_token());
  ASSERT_FALSE(ok);
  EXPECT_EQ(ok.error().code, proto::kCanceledCode);
}

}  // namespace
}  // namespace kiln::output
