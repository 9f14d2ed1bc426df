// The light inside lit.glb is that of the EXR pages.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/bake/recorder.h"
#include "tests/output/lit_light.h"

namespace kiln::baker {
namespace {

/// Tells how far a page inside lit.glb is from its EXR.
struct Difference {
  double rms = 0;             ///< over the lit texels that are no lamps, over their mean
  std::uint64_t clipped = 0;  ///< of those texels, the ones above the scale
  std::uint64_t texels = 0;
};

/// `emission` tells lamps: they send more light of their own than they could reflect.
Difference difference(const output::GlbReader& lit, const image::PageImage& exr,
                      const image::PageImage& emission) {
  const auto light = output::page_light(lit, 0);
  const double scale = lit.json["asset"]["extras"]["lightkiln"]["pages"][0]["scale"];
  double squares = 0, sum = 0;
  Difference out;
  for (std::size_t i = 0; i < light.size(); ++i) {
    if (!(exr.coverage[i] > 0)) continue;
    if (math::kPi * max_channel(emission.rgb[i]) > max_channel(exr.rgb[i])) continue;
    const math::Rgb d = light[i] - exr.rgb[i];
    squares += double(d.r * d.r + d.g * d.g + d.b * d.b);
    sum += double(exr.rgb[i].r + exr.rgb[i].g + exr.rgb[i].b);
    out.clipped += double(max_channel(exr.rgb[i])) > scale;
    ++out.texels;
  }
  const double values = 3 * double(out.texels);
  out.rms = std::sqrt(squares / values) / (sum / values);
  return out;
}

class LitPagesOf : public testing::TestWithParam<const char*> {};

TEST_P(LitPagesOf, AreWithinOnePercentOfTheExr) {
  const TempFolder folder;
  BakeInput in = input_for(folder, GetParam(), 256);
  in.settings.solver.samples = in.settings.solver.direct_samples = 16;
  in.settings.solver.bounces = 2;
  in.settings.output.precision = proto::Precision::kFloat;
  in.settings.output.layers = {"irradiance", "emission"};
  in.settings.output.formats = {"exr", "glb"};
  exec::ThreadPool pool(2);
  for (const auto lightmap : {proto::GlbLightmap::kSrgb8, proto::GlbLightmap::kRgbm}) {
    in.settings.output.glb_lightmap = lightmap;
    Recorder recorder;
    const auto manifest = bake(in, pool, {}, recorder);
    ASSERT_TRUE(manifest) << manifest.error().message;
    const auto exr = image::read_exr(in.output_dir / "page_00.exr");
    const auto emission = image::read_exr(in.output_dir / "page_00.exr", "emission");
    ASSERT_TRUE(exr && emission);
    const Difference found =
        difference(output::GlbReader(in.output_dir / "lit.glb"), *exr, *emission);
    EXPECT_LE(found.rms, 0.01);
    EXPECT_LE(found.clipped * 1000, found.texels);
    const proto::PageInfo& page = manifest->pages.at(0);
    EXPECT_EQ(page.glb_clipped - page.glb_clipped_lamps, found.clipped);
    EXPECT_GT(page.glb_scale, 0);
    RecordProperty(lightmap == proto::GlbLightmap::kRgbm ? "rms_rgbm" : "rms_srgb8",
                   std::to_string(found.rms));
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, LitPagesOf,
                         testing::Values("cornell", "cornell_lucy", "small_lights", "many_lights",
                                         "room_textured", "toys", "courtyard", "atrium"),
                         [](const auto& scene) { return std::string(scene.param); });

/// A lamp a finger below the ceiling makes the light behind it eighty times the mean. The page's
/// median texel had code 1.3 when pages were linear over their maximum.
TEST(LitPages, WhatALampHidesDoesNotCoarsenTheCodes) {
  const fs::path box = fs::path(LIGHTKILN_SHARED_DIR) / "corpus/bevy/CornellBox/CornellBox.glb";
  if (!fs::exists(box)) GTEST_SKIP() << "there is no corpus beside the source";
  const TempFolder folder;
  BakeInput in = input_for(folder, "cornell", 256);
  in.files.main = box;
  in.settings.solver.samples = in.settings.solver.direct_samples = 64;
  exec::ThreadPool pool(2);
  Recorder recorder;
  const auto manifest = bake(in, pool, {}, recorder);
  ASSERT_TRUE(manifest) << manifest.error().message;
  const proto::PageInfo& page = manifest->pages.at(0);
  EXPECT_GT(page.glb_clipped_lamps, 100u);
  EXPECT_LE((page.glb_clipped - page.glb_clipped_lamps) * 1000, page.texels);
  const auto exr = image::read_exr(in.output_dir / "page_00.exr");
  ASSERT_TRUE(exr);
  const output::Picture8 picture =
      output::page_picture(output::GlbReader(in.output_dir / "lit.glb"), 0);
  std::vector<std::uint8_t> codes;
  for (std::size_t i = 0; i < picture.rgba.size(); ++i)
    if (exr->coverage[i] > 0)
      codes.push_back(std::max({picture.rgba[i][0], picture.rgba[i][1], picture.rgba[i][2]}));
  std::ranges::nth_element(codes, codes.begin() + std::ptrdiff_t(codes.size() / 2));
  EXPECT_GE(codes[codes.size() / 2], 40);  // from there on a step is less than 4 %
}

}  // namespace
}  // namespace kiln::baker
