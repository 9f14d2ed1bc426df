// The pipeline from glTF to files, without a server.
#include "baker/bake.h"

#include <gtest/gtest.h>

#include <algorithm>

#include <chrono>
#include <cmath>
#include <thread>
#include <utility>

#include "baker/output/output.h"
#include "tests/bake/recorder.h"
#include "tests/support/sanitizer.h"

namespace kiln::baker {
namespace {

using namespace std::chrono_literals;

TEST(Bake, CornellGivesAllFilesAndAnHonestReport) {
  const TempFolder folder;
  const BakeInput in = input_for(folder, "cornell", 128);
  exec::ThreadPool pool(2);
  Recorder recorder;
  const auto manifest = bake(in, pool, {}, recorder);
  ASSERT_TRUE(manifest) << manifest.error().message;
  for (const char* name : {"page_00.exr", "page_00.png", "manifest.json", "lit.glb"})
    EXPECT_TRUE(fs::exists(in.output_dir / name)) << name;
  EXPECT_EQ(recorder.stages, (std::vector<std::string>{"import", "atlas", "solve", "output"}));
  EXPECT_EQ(recorder.passes.size(), manifest->statistics.passes.size());
  EXPECT_EQ(recorder.snapshots, recorder.passes.size());
  EXPECT_FALSE(recorder.fell);
  ASSERT_GT(recorder.passes.size(), 3u);
  EXPECT_EQ(recorder.passes[0].name, "direct");
  const auto tail = std::find_if(recorder.passes.begin(), recorder.passes.end(),
                                 [](const auto& p) { return p.name == "tail"; });
  ASSERT_NE(tail, recorder.passes.end());
  EXPECT_LE(tail->residual, 3 * in.settings.solver.tolerance) << "with all that would follow";
  ASSERT_TRUE(manifest->statistics.standard_error);
  EXPECT_LE(*manifest->statistics.standard_error, proto::target_error(in.settings.quality));
  EXPECT_GT(manifest->statistics.peak_memory_bytes, 1u << 20);
  // Every fourth texel at least sends rays over its hemisphere.
  EXPECT_GT(manifest->statistics.rays, manifest->statistics.texels * 64 / 4);

  const auto page = image::read_exr(in.output_dir / "page_00.exr");
  ASSERT_TRUE(page) << page.error().message;
  EXPECT_EQ(page->width, 128u);
  std::uint64_t lit = 0;
  for (std::size_t i = 0; i < page->rgb.size(); ++i) {
    ASSERT_TRUE(std::isfinite(page->rgb[i].r));
    lit += page->coverage[i] > 0;
  }
  EXPECT_EQ(lit, manifest->pages.at(0).texels);
}

TEST(Bake, TellsSettingsThatItsMethodDoesNotRead) {
  struct Warnings : BakeObserver {
    std::vector<proto::Warning> told;
    void on_warning(const proto::Warning& w) override { told.push_back(w); }
  };
  const TempFolder folder;
  BakeInput in = input_for(folder, "cornell", 32);
  in.settings.solver.voxel_grid = 32;
  in.settings.solver.samples = 16;
  exec::ThreadPool pool(2);
  for (const bool layer : {false, true}) {
    in.settings.output.layers = {"irradiance"};
    if (layer) in.settings.output.layers.push_back("voxels");
    Warnings observer;
    const auto manifest = bake(in, pool, {}, observer);
    ASSERT_TRUE(manifest) << manifest.error().message;
    for (const auto* warnings : {&std::as_const(observer.told), &manifest->warnings}) {
      const auto told =
          std::ranges::find(*warnings, "setting_without_effect", &proto::Warning::code);
      ASSERT_EQ(told == warnings->end(), layer) << "the layer reads it";
      if (!layer) {
        EXPECT_EQ(told->pointer, "/solver/voxel_grid");
      }
    }
  }
}

TEST(Bake, SaysHowMuchTimeIsLeft) {
  const TempFolder folder;
  BakeInput in = input_for(folder, "cornell", 256);
  in.settings.solver.samples = in.settings.solver.direct_samples = 1024;
  exec::ThreadPool pool(2);
  Recorder recorder;
  const auto manifest = bake(in, pool, {}, recorder);
  ASSERT_TRUE(manifest) << manifest.error().message;
  double solve_seconds = 0;
  for (const auto& stage : manifest->statistics.stages)
    if (stage.name == "solve") solve_seconds = stage.seconds;
  ASSERT_GE(recorder.etas.size(), 2u);
  for (const double eta : recorder.etas) EXPECT_GE(eta, 0);
  // At the end of the light hardly anything is left of what it took; there was more before.
  EXPECT_LT(recorder.etas.back(), solve_seconds / 2);
  EXPECT_GT(*std::ranges::max_element(recorder.etas), recorder.etas.back());
}

TEST(Bake, MemoryThatIsRefusedEndsItBeforeTheAtlas) {
  const TempFolder folder;
  BakeInput in = input_for(folder, "cornell", 256);
  std::uint64_t asked = 0;
  in.reserve_memory = [&](std::uint64_t bytes, const std::stop_token&) -> proto::Expected<void> {
    asked = bytes;
    return proto::fail("job_too_large", "no room");
  };
  exec::ThreadPool pool(2);
  Recorder recorder;
  const auto manifest = bake(in, pool, {}, recorder);
  ASSERT_FALSE(manifest);
  EXPECT_EQ(manifest.error().code, "job_too_large");
  EXPECT_EQ(recorder.stages, (std::vector<std::string>{"import"}));
  EXPECT_GT(asked, 256u * 256 * 100) << "bytes for a page of texels";
}

TEST(Bake, AMethodThatCantFinishIsRefusedBeforeItsFirstPass) {
  const TempFolder folder;
  exec::ThreadPool pool(2);
  for (const proto::Method method : {proto::Method::kPairwise, proto::Method::kMatrix}) {
    BakeInput in = input_for(folder, "cornell", 1024);
    in.settings.solver.method = method;
    Recorder recorder;
    const auto manifest = bake(in, pool, {}, recorder);
    ASSERT_FALSE(manifest);
    EXPECT_EQ(manifest.error().code, "too_expensive");
    ASSERT_EQ(manifest.error().details.size(), 1u);
    EXPECT_EQ(manifest.error().details[0].source, "settings");
    EXPECT_EQ(manifest.error().details[0].pointer, "/solver/method");
    EXPECT_EQ(recorder.stages, (std::vector<std::string>{"import", "atlas"}));
    EXPECT_TRUE(recorder.passes.empty());
  }
}

/// The mean light of the previews of a bake.
struct Previews : BakeObserver {
  std::vector<double> mean;
  void on_snapshot(Snapshot s) override {
    double sum = 0;
    for (std::uint32_t t = 0; t < s.light->size(); ++t)
      sum += double(luminance(s.light->irradiance(t))) / double(s.light->size());
    mean.push_back(sum);
  }
};

TEST(Bake, PreviewsOfARadiosityMapCanAddTheLightThatIsMissing) {
  Previews plain, ambient;
  std::vector<math::Rgb> page[2];
  for (const bool adds : {false, true}) {
    const TempFolder folder;
    BakeInput in = input_for(folder, "cornell", 64);
    in.settings.solver.method = proto::Method::kRadiosityMap;
    in.settings.solver.samples = 64;
    in.settings.solver.ambient_term = adds;
    exec::ThreadPool pool(2);
    const auto manifest = bake(in, pool, {}, adds ? ambient : plain);
    ASSERT_TRUE(manifest) << manifest.error().message;
    page[adds] = image::read_exr(in.output_dir / "page_00.exr")->rgb;
  }
  EXPECT_TRUE(page[0] == page[1]) << "the result has none of it";
  ASSERT_EQ(plain.mean.size(), ambient.mean.size());
  EXPECT_EQ(plain.mean.back(), ambient.mean.back());
  const double whole = plain.mean.back();
  EXPECT_LT(plain.mean.front(), 0.8 * whole) << "direct light alone";
  EXPECT_GT(ambient.mean.front(), 0.8 * whole);
  EXPECT_LT(ambient.mean.front(), 1.5 * whole);
}

/// The light of all previews of a bake.
struct PreviewLight : BakeObserver {
  std::vector<std::vector<math::Rgb>> passes;
  void on_snapshot(Snapshot s) override {
    auto& light = passes.emplace_back();
    for (std::uint32_t t = 0; t < s.light->size(); ++t) light.push_back(s.light->irradiance(t));
  }
};

TEST(Bake, PreviewsFadeFromOneToTheNext) {
  for (const proto::Method method : {proto::Method::kGather, proto::Method::kRadiosityMap}) {
    PreviewLight plain, faded;
    std::string png[2];
    std::vector<math::Rgb> page[2];
    for (const bool fades : {false, true}) {
      const TempFolder folder;
      BakeInput in = input_for(folder, "cornell", 64);
      in.settings.solver.method = method;
      in.settings.solver.samples = 64;
      in.settings.solver.ambient_term = true;  // radiosity_map has it, and it fades, too
      if (fades) in.settings.output.preview_fade = 0.25f;
      exec::ThreadPool pool(2);
      const auto manifest = bake(in, pool, {}, fades ? faded : plain);
      ASSERT_TRUE(manifest) << manifest.error().message;
      page[fades] = image::read_exr(in.output_dir / "page_00.exr")->rgb;
      png[fades] = test::read_bytes(in.output_dir / "page_00.png");
    }
    EXPECT_TRUE(page[0] == page[1]) << "the result does not hang on it";
    EXPECT_TRUE(png[0] == png[1]) << "the final preview does not fade";
    ASSERT_EQ(plain.passes.size(), faded.passes.size());
    ASSERT_GE(plain.passes.size(), 3u);
    std::vector<math::Rgb> shown = plain.passes[0];
    EXPECT_TRUE(faded.passes[0] == shown) << "the first has nothing to fade from";
    for (std::size_t p = 1; p < plain.passes.size(); ++p)
      for (std::size_t t = 0; t < shown.size(); ++t) {
        shown[t] += (plain.passes[p][t] - shown[t]) * 0.25f;
        const float size = 1e-5f * (max_channel(shown[t]) + max_channel(plain.passes[0][t]));
        EXPECT_NEAR(faded.passes[p][t].r, shown[t].r, size);
        EXPECT_NEAR(faded.passes[p][t].b, shown[t].b, size);
      }
    EXPECT_FALSE(faded.passes.back() == plain.passes.back());
  }
}

TEST(Bake, ImagesAreBitIdenticalOnAnyNumberOfThreads) {
  std::string first;
  for (const unsigned threads : {1u, 2u, 3u, 8u}) {
    const TempFolder folder;
    BakeInput in = input_for(folder, "courtyard", 64);
    in.settings.quality.target_error = 0.04f;
    in.settings.output.precision = proto::Precision::kFloat;
    in.settings.output.layers = {"irradiance", "direct", "indirect", "raw", "standard_error"};
    exec::ThreadPool pool(threads);
    BakeObserver quiet;
    const auto manifest = bake(in, pool, {}, quiet);
    ASSERT_TRUE(manifest) << manifest.error().message;
    const std::string exr = test::read_bytes(in.output_dir / "page_00.exr");
    if (first.empty()) first = exr;
    EXPECT_TRUE(exr == first) << threads << " threads";
  }
}

TEST(Bake, StopsWithinASecondAndSaysSo) {
  const TempFolder folder;
  BakeInput in = input_for(folder, "cornell", 1024);
  in.settings.solver.samples = 4096;
  exec::ThreadPool pool(2);
  std::stop_source stop;
  Recorder recorder;
  std::chrono::steady_clock::time_point asked;
  std::jthread canceler([&] {
    std::this_thread::sleep_for(1s);
    asked = std::chrono::steady_clock::now();
    stop.request_stop();
  });
  const auto manifest = bake(in, pool, stop.get_token(), recorder);
  ASSERT_FALSE(manifest);
  EXPECT_EQ(manifest.error().code, proto::kCanceledCode);
  EXPECT_LT(std::chrono::steady_clock::now() - asked, 1s * test::kSlowdown);
  EXPECT_FALSE(fs::exists(in.output_dir / "manifest.json"));
}

TEST(Bake, MayBeStoppedAtAnyMoment) {
  const TempFolder folder;
  BakeInput in = input_for(folder, "cornell", 1024);
  in.settings.solver.samples = 1;
  in.settings.solver.direct_samples = 1;
  exec::ThreadPool pool(2);
  for (int k = 0; k < 40; ++k) {
    std::stop_source stop;
    const std::jthread canceler([&] {
      std::this_thread::sleep_for(k * 3ms * test::kSlowdown);
      stop.request_stop();
    });
    BakeObserver quiet;
    const auto manifest = bake(in, pool, stop.get_token(), quiet);
    if (!manifest) {
      EXPECT_EQ(manifest.error().code, proto::kCanceledCode) << k;
    }
  }
}

TEST(Bake, SceneWithoutLightIsAnErrorUnlessAllowed) {
  const TempFolder folder;
  BakeInput in = input_for(folder, "sphere_on_plane", 64);
  exec::ThreadPool pool(2);
  BakeObserver quiet;
  const auto dark = bake(in, pool, {}, quiet);
  ASSERT_FALSE(dark);
  EXPECT_EQ(dark.error().code, "no_light");
  in.settings.allow_dark = true;
  const auto allowed = bake(in, pool, {}, quiet);
  ASSERT_TRUE(allowed) << allowed.error().message;
  EXPECT_EQ(allowed->pages.at(0).max_lx, 0);
}

}  // namespace
}  // namespace kiln::baker
