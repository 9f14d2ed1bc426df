// Layers that need more than pages do, in the files of whole bakes.
#include "baker/made_layers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <tuple>

#include "baker/image/page_image.h"
#include "baker/output/layers.h"
#include "baker/preflight.h"
#include "baker/reference.h"
#include "baker/trace/voxel_grid.h"
#include "tests/bake/recorder.h"

namespace kiln::baker {
namespace {

/// A small bake of layers, whose pages keep every bit.
BakeInput bake_of(const TempFolder& folder, std::vector<std::string> layers,
                  std::uint32_t page_size = 64) {
  BakeInput in = input_for(folder, "cornell", page_size);
  in.settings.solver.samples = in.settings.solver.direct_samples = 8;
  in.settings.solver.bounces = 2;
  in.settings.output.precision = proto::Precision::kFloat;
  in.settings.output.formats = {"exr"};
  in.settings.output.layers = std::move(layers);
  return in;
}

image::PageImage layer(const BakeInput& in, const std::string& name) {
  auto page = image::read_exr(in.output_dir / "page_00.exr", name);
  EXPECT_TRUE(page) << name;
  return page ? std::move(*page) : image::PageImage();
}

void bake_it(const BakeInput& in) {
  exec::ThreadPool pool(2);
  BakeObserver quiet;
  const auto manifest = bake(in, pool, {}, quiet);
  ASSERT_TRUE(manifest) << manifest.error().message;
}

template <class Use>
void for_lit(const image::PageImage& page, const Use& use) {
  for (std::size_t i = 0; i < page.rgb.size(); ++i)
    if (page.coverage[i] > 0) use(i);
}

TEST(MadeLayers, MipIsTheMeanRadiosityOfAWindow) {
  const TempFolder folder;
  BakeInput in = bake_of(folder, {"irradiance", "albedo", "area", "chart", "mip"});
  in.settings.solver.window = 4;
  bake_it(in);
  const auto light = layer(in, ""), albedo = layer(in, "albedo"), area = layer(in, "area"),
             chart = layer(in, "chart"), mip = layer(in, "mip");
  struct Sum {
    double area = 0, green = 0;
  };
  std::map<std::tuple<std::size_t, std::size_t, float, float>, Sum> windows;
  const auto window_of = [&](std::size_t i) -> Sum& {
    return windows[{i % mip.width / 4, i / mip.width / 4, chart.rgb[i].r, chart.rgb[i].g}];
  };
  for_lit(mip, [&](std::size_t i) {
    Sum& sum = window_of(i);
    sum.area += double(area.rgb[i].r);
    sum.green += double(area.rgb[i].r) * double(albedo.rgb[i].g) * double(light.rgb[i].g);
  });
  std::uint32_t texels = 0;
  for_lit(mip, [&](std::size_t i) {
    const double mean = window_of(i).green / window_of(i).area;
    EXPECT_NEAR(mip.rgb[i].g, mean, 1e-5 * mean + 1e-9);
    ++texels;
  });
  EXPECT_LT(windows.size(), texels / 4);
}

TEST(MadeLayers, TreeHasLeavesWhereLightIsSmooth) {
  const TempFolder folder, fine_folder;
  BakeInput in = bake_of(folder, {"tree"}, 128);
  bake_it(in);
  BakeInput fine = bake_of(fine_folder, {"tree"}, 128);
  fine.settings.solver.subdivision_threshold = 0.01f;
  fine.settings.solver.subdivision_max_node = 4;
  bake_it(fine);
  std::map<float, std::uint32_t> sides, fine_sides;
  const auto usual = layer(in, ""), finer = layer(fine, "");
  for_lit(usual, [&](std::size_t i) {
    ++sides[usual.rgb[i].r];
    ++fine_sides[finer.rgb[i].r];
    EXPECT_LE(finer.rgb[i].r, usual.rgb[i].r);
  });
  for (const auto& [side, count] : sides)
    EXPECT_TRUE(side == 1 || side == 2 || side == 4 || side == 8) << side;
  EXPECT_GT(sides[8], sides[1]);
  EXPECT_GT(sides[1], 0u) << "along edges of shadows";
  EXPECT_EQ(fine_sides[8], 0u);
}

TEST(MadeLayers, SendersCarryTheAreaOfTheSurface) {
  const TempFolder folder;
  BakeInput in = bake_of(folder, {"area", "direct", "albedo", "senders"});
  in.settings.solver.method = proto::Method::kPairwise;
  in.settings.solver.undersampling = proto::Undersampling::kStride;
  in.settings.solver.window = 4;
  bake_it(in);
  const auto senders = layer(in, "senders");
  std::map<std::pair<std::size_t, std::size_t>, int> windows;
  for_lit(senders, [&](std::size_t i) {
    if (senders.rgb[i].r > 0) ++windows[{i % senders.width / 4, i / senders.width / 4}];
  });
  EXPECT_GT(windows.size(), 50u);
  for (const auto& [window, count] : windows) EXPECT_EQ(count, 1) << "one of each window";

  const TempFolder all_folder;
  BakeInput all = bake_of(all_folder, {"area", "direct", "albedo", "senders"});
  all.settings.solver.method = proto::Method::kPairwise;
  bake_it(all);
  const auto own = layer(all, "senders"), area = layer(all, ""), direct = layer(all, "direct"),
             albedo = layer(all, "albedo");
  std::uint32_t black = 0;
  for_lit(own, [&](std::size_t i) {
    const bool sends = !is_black(direct.rgb[i] * albedo.rgb[i]);
    black += !sends;
    EXPECT_EQ(own.rgb[i].r, sends ? area.rgb[i].r : 0);
  });
  EXPECT_GT(black, 0u) << "the ceiling has no direct light";
}

TEST(MadeLayers, VoxelsShowTheHolesOfARasterizedGrid) {
  std::uint32_t holes[2] = {};
  for (const bool exact : {false, true}) {
    const TempFolder folder;
    BakeInput in = bake_of(folder, {"position", "voxels"});
    in.settings.solver.voxel_grid = 21;
    in.settings.solver.voxel_march =
        exact ? proto::VoxelMarch::kExact : proto::VoxelMarch::kFixedSteps;
    bake_it(in);
    const auto scene = import::import_files(in.files);
    ASSERT_TRUE(scene);
    const auto grid = trace::VoxelGrid::build(
        *scene, 21, exact ? trace::VoxelFill::kConservative : trace::VoxelFill::kDominantAxis);
    ASSERT_TRUE(grid);
    const auto position = layer(in, ""), voxels = layer(in, "voxels");
    std::map<std::uint32_t, math::Rgb> colors;
    for_lit(voxels, [&](std::size_t i) {
      const math::Vec3 at{position.rgb[i].r, position.rgb[i].g, position.rgb[i].b};
      const std::uint32_t voxel = grid->voxel_of(at);
      EXPECT_EQ(is_black(voxels.rgb[i]), !grid->is_solid_voxel(voxel));
      const auto [color, is_new] = colors.try_emplace(voxel, voxels.rgb[i]);
      EXPECT_EQ(voxels.rgb[i], color->second) << "one color a voxel";
      holes[exact] += is_black(voxels.rgb[i]);
    });
    std::set<std::tuple<float, float, float>> different;
    for (const auto& [voxel, color] : colors) different.insert({color.r, color.g, color.b});
    EXPECT_GT(different.size(), colors.size() / 2);
  }
  EXPECT_GT(holes[0], 0u) << "corners and slopes of the blocks";
  EXPECT_LT(holes[1], holes[0]);
}

TEST(MadeLayers, ErrorIsTheDistanceToTheReference) {
  const TempFolder folder, reference_folder;
  BakeInput in = bake_of(folder, {"irradiance", "error"});
  in.settings.report = {"path", 16, 10};
  bake_it(in);
  BakeInput reference = bake_of(reference_folder, {"irradiance"});
  reference.settings.solver = reference_settings(in.settings, proto::Method::kPath);
  bake_it(reference);
  const auto light = layer(in, ""), error = layer(in, "error"), truth = layer(reference, "");
  double sum = 0;
  for_lit(light, [&](std::size_t i) {
    const math::Rgb off = light.rgb[i] - truth.rgb[i];
    EXPECT_EQ(error.rgb[i], (math::Rgb{std::abs(off.r), std::abs(off.g), std::abs(off.b)}));
    sum += double(error.rgb[i].g);
  });
  EXPECT_GT(sum, 0);

  // A bake beside its own page has none.
  const TempFolder again_folder;
  BakeInput again = bake_of(again_folder, {"irradiance", "error"});
  again.files.side["own.exr"] = in.output_dir / "page_00.exr";
  again.settings.report.against = "own.exr";
  bake_it(again);
  const auto none = layer(again, "error");
  for_lit(none, [&](std::size_t i) { EXPECT_TRUE(is_black(none.rgb[i])); });
}

TEST(MadeLayers, ABakeThatEndsBeforeItsReferenceHasABlackError) {
  const TempFolder folder;
  BakeInput in = bake_of(folder, {"irradiance", "error"}, 128);
  in.settings.report = {"path", 65536, 10};
  std::stop_source early;
  in.finish_early = early.get_token();
  struct AtReference : BakeObserver {
    std::stop_source& early;
    explicit AtReference(std::stop_source& s) : early(s) {}
    void on_stage(const std::string& stage) override {
      if (stage == "reference") early.request_stop();
    }
  } observer(early);
  exec::ThreadPool pool(2);
  const auto manifest = bake(in, pool, {}, observer);
  ASSERT_TRUE(manifest) << manifest.error().message;
  const auto error = layer(in, "error");
  for_lit(error, [&](std::size_t i) { EXPECT_TRUE(is_black(error.rgb[i])); });
  const auto said = std::ranges::find(manifest->warnings, "report_left_out", &proto::Warning::code);
  ASSERT_NE(said, manifest->warnings.end());
  EXPECT_NE(said->message.find("error"), std::string::npos);
}

TEST(MadeLayers, AreTheSameOnAnyNumberOfThreads) {
  std::string first;
  for (const unsigned threads : {1u, 3u}) {
    const TempFolder folder;
    BakeInput in = bake_of(folder, {"mip", "tree", "senders", "voxels"});
    in.settings.solver.undersampling = proto::Undersampling::kMonteCarlo;
    in.settings.solver.window = 3;
    exec::ThreadPool pool(threads);
    BakeObserver quiet;
    ASSERT_TRUE(bake(in, pool, {}, quiet));
    const std::string bytes = read_bytes(in.output_dir / "page_00.exr");
    if (first.empty()) first = bytes;
    EXPECT_TRUE(bytes == first) << threads;
  }
}

TEST(MadeLayers, AreInTheMemoryEstimate) {
  const TempFolder folder;
  BakeInput in = input_for(folder, "cornell", 1024);
  const auto scene = import::import_files(in.files);
  ASSERT_TRUE(scene);
  in.settings.solver.hit_memory_mib = 1;
  in.settings.solver.samples = 1;
  // The same number of layers, whose images count in any case.
  in.settings.output.layers = {"irradiance", "area", "albedo", "normal", "chart"};
  const std::uint64_t plain = estimate_memory(*scene, in.settings);
  in.settings.output.layers = {"irradiance", "mip", "tree", "senders", "voxels"};
  in.settings.solver.voxel_grid = 1024;
  const std::uint64_t made = estimate_memory(*scene, in.settings);
  EXPECT_GE(made, plain + (1u << 27)) << "the bits of 1024 x 1024 x 1024 voxels";
  in.settings.solver.voxel_grid = 64;
  EXPECT_GT(made, estimate_memory(*scene, in.settings) + 100'000'000);
  in.settings.output.layers = {"irradiance"};
  in.settings.output.preview_fade = 0.5f;
  const std::uint64_t fading = estimate_memory(*scene, in.settings);
  in.settings.output.preview_fade = 1;
  EXPECT_GT(fading, estimate_memory(*scene, in.settings) + 50'000'000);
}

}  // namespace
}  // namespace kiln::baker
