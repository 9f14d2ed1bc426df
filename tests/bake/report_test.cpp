// The report of a bake: its result beside a reference.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>

#include "baker/bake.h"
#include "baker/output/compare.h"
#include "baker/reference.h"
#include "tests/bake/recorder.h"
#include "tests/support/sanitizer.h"
#include "tests/support/stop_timing.h"

namespace kiln::baker {
namespace {

using nlohmann::json;

/// A small bake with noise, whose pages keep every bit.
BakeInput small_bake(const TempFolder& folder, std::uint32_t page_size = 32) {
  BakeInput in = input_for(folder, "cornell", page_size);
  in.settings.solver.samples = in.settings.solver.direct_samples = 8;
  in.settings.solver.bounces = 3;
  in.settings.output.precision = proto::Precision::kFloat;
  in.settings.output.formats = {"exr"};
  return in;
}

proto::Expected<proto::Manifest> bake_quietly(const BakeInput& in) {
  exec::ThreadPool pool(2);
  BakeObserver quiet;
  return bake(in, pool, {}, quiet);
}

json report_of(const BakeInput& in) {
  return json::parse(read_bytes(in.output_dir / "report.json"), nullptr, false);
}

TEST(Report, ComparesWithAMethodThatBakesTheSameTexels) {
  const TempFolder folder, plain_folder, reference_folder;
  BakeInput in = small_bake(folder);
  in.settings.report = {"path", 32, 10};
  exec::ThreadPool pool(2);
  Recorder recorder;
  const auto manifest = bake(in, pool, {}, recorder);
  ASSERT_TRUE(manifest) << manifest.error().message;
  EXPECT_EQ(recorder.stages,
            (std::vector<std::string>{"import", "atlas", "solve", "reference", "output"}));
  EXPECT_FALSE(recorder.fell);
  std::vector<std::string> names;
  for (const auto& file : manifest->files) names.push_back(file.name);
  EXPECT_EQ(names, (std::vector<std::string>{"page_00.exr", "error_00.png", "contours_00.png",
                                             "histogram.csv", "report.json", "manifest.json"}));

  // The reference's passes are no passes of the bake, and its result is as without it.
  const BakeInput plain = small_bake(plain_folder);
  const auto same = bake_quietly(plain);
  ASSERT_TRUE(same) << same.error().message;
  EXPECT_EQ(recorder.passes.size(), same->statistics.passes.size());
  EXPECT_EQ(recorder.snapshots, recorder.passes.size());
  const auto page = image::read_exr(in.output_dir / "page_00.exr");
  EXPECT_EQ(page->rgb, image::read_exr(plain.output_dir / "page_00.exr")->rgb);

  // A bake with the reference's settings has the light that the figures are of.
  BakeInput reference = small_bake(reference_folder);
  reference.settings.solver = reference_settings(in.settings, proto::Method::kPath);
  ASSERT_TRUE(bake_quietly(reference));
  const auto figures = output::to_json(
      output::compare(*image::read_exr(reference.output_dir / "page_00.exr"), *page));
  const json report = report_of(in);
  EXPECT_EQ(report["figures"], figures);
  EXPECT_GT(report["figures"]["nrmse"], 0.01);
  EXPECT_EQ(report["against"], "path");
  EXPECT_EQ(report["seed"], reference.settings.solver.seed);
  EXPECT_NE(report["seed"], in.settings.solver.seed);
  ASSERT_EQ(report["pages"].size(), 1u);
  EXPECT_EQ(report["pages"][0]["nrmse"], figures["nrmse"]);
  EXPECT_DOUBLE_EQ(report["error_map"]["white"].get<double>(), figures["scale"].get<double>() / 10);
  EXPECT_EQ(report["passes"][0]["name"], "paths");
}

TEST(Report, ComparesWithAFileOfTheUpload) {
  const TempFolder first_folder, folder;
  const BakeInput first = small_bake(first_folder);
  ASSERT_TRUE(bake_quietly(first));
  BakeInput in = small_bake(folder);
  in.files.side["refs/a.exr"] = first.output_dir / "page_00.exr";
  for (const char* name : {"refs/a.exr", "a.exr"}) {
    in.settings.report.against = name;
    const auto manifest = bake_quietly(in);
    ASSERT_TRUE(manifest) << manifest.error().message;
    const json report = report_of(in);
    EXPECT_EQ(report["figures"]["rmse"], 0) << "the same bake";
    EXPECT_GT(report["figures"]["texels"], 100);
    EXPECT_FALSE(report.contains("method"));
    EXPECT_TRUE(std::none_of(manifest->statistics.stages.begin(), manifest->statistics.stages.end(),
                             [](const auto& s) { return s.seconds < 0; }));
  }
  in.settings.solver.seed = 2;
  ASSERT_TRUE(bake_quietly(in));
  EXPECT_GT(report_of(in)["figures"]["rmse"], 0);
}

TEST(Report, WhatCantBeMadeIsRefusedBeforeTheFirstPass) {
  const TempFolder folder, large_folder;
  BakeInput in = small_bake(folder);
  const BakeInput large = small_bake(large_folder, 64);
  ASSERT_TRUE(bake_quietly(large));
  in.files.side["large.exr"] = large.output_dir / "page_00.exr";
  in.files.side["text.exr"] = folder.write("text.exr", "no picture");
  struct Case {
    const char *against, *code, *says;
  };
  for (const Case c : {Case{"none.exr", "missing_file", "none.exr"},
                       Case{"large.exr", "invalid_image", "64x64 pixels, and page 0 has 32x32"},
                       Case{"text.exr", "invalid_image", "text.exr"}}) {
    in.settings.report.against = c.against;
    exec::ThreadPool pool(2);
    Recorder recorder;
    const auto manifest = bake(in, pool, {}, recorder);
    ASSERT_FALSE(manifest) << c.against;
    EXPECT_EQ(manifest.error().code, c.code);
    EXPECT_NE(manifest.error().message.find(c.says), std::string::npos) << manifest.error().message;
    ASSERT_EQ(manifest.error().details.size(), 1u);
    EXPECT_EQ(manifest.error().details[0].pointer, "/report/against");
    EXPECT_TRUE(recorder.passes.empty());
  }
  in.settings.atlas.page_size = 128;  // more texels than matrix takes
  in.settings.report.against = "matrix";
  const auto expensive = bake_quietly(in);
  ASSERT_FALSE(expensive);
  EXPECT_EQ(expensive.error().code, "too_expensive");
  EXPECT_EQ(expensive.error().details[0].pointer, "/report/against");
}

/// Acts when the reference has begun.
struct AtReference : Recorder {
  std::function<void()> act;
  void on_progress(const proto::JobProgress& p) override {
    Recorder::on_progress(p);
    if (p.stage == "reference" && p.batches_done > 0) act();
  }
};

TEST(Report, AStopIsHeardWhileTheReferenceIsMade) {
  const TempFolder folder;
  BakeInput in = small_bake(folder, 128);
  in.settings.report = {"path", 65536, 10};
  AtReference observer;
  std::stop_source stop;
  std::chrono::steady_clock::time_point asked;
  double asked_cpu = 0;
  observer.act = [&] {
    if (!stop.request_stop()) return;
    asked = std::chrono::steady_clock::now();
    asked_cpu = test::cpu_seconds();
  };
  exec::ThreadPool pool(2);
  const auto manifest = bake(in, pool, stop.get_token(), observer);
  const double cpu = test::cpu_seconds() - asked_cpu;
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - asked;
  ASSERT_FALSE(manifest);
  EXPECT_EQ(manifest.error().code, proto::kCanceledCode);
  // As seconds_after_stop() measures: other programs may have the processors meanwhile.
  EXPECT_LT(std::min(took.count(), cpu + took.count() / 10), 1 * test::kSlowdown);
}

TEST(Report, ABakeThatEndsEarlyKeepsItsLightWithoutAReport) {
  const TempFolder folder;
  BakeInput in = small_bake(folder, 128);
  in.settings.report = {"path", 65536, 10};
  std::stop_source early;
  in.finish_early = early.get_token();
  AtReference observer;
  observer.act = [&] { early.request_stop(); };
  exec::ThreadPool pool(2);
  const auto manifest = bake(in, pool, {}, observer);
  ASSERT_TRUE(manifest) << manifest.error().message;
  EXPECT_TRUE(fs::exists(in.output_dir / "page_00.exr"));
  EXPECT_FALSE(fs::exists(in.output_dir / "report.json"));
  EXPECT_TRUE(std::any_of(manifest->warnings.begin(), manifest->warnings.end(),
                          [](const auto& w) { return w.code == "report_left_out"; }));
}

TEST(Report, TheReferenceLeavesOutWhatABakeApproximates) {
  proto::BakeSettings settings;
  settings.solver.method = proto::Method::kGather;
  settings.solver.bounces = 5;
  settings.solver.reflectivity_factor = 0.5f;
  settings.solver.undersampling = proto::Undersampling::kStride;
  settings.solver.max_view_factor = 0.1f;
  settings.solver.visibility = proto::VisibilityKind::kVoxel;
  settings.solver.window = 8;
  settings.report.samples = 77;
  const auto solver = reference_settings(settings, proto::Method::kPairwise);
  EXPECT_EQ(solver.method, proto::Method::kPairwise);
  EXPECT_EQ(solver.bounces, 5u);
  EXPECT_EQ(solver.reflectivity_factor, 0.5f);
  EXPECT_EQ(solver.samples, 77u);
  EXPECT_EQ(solver.undersampling, proto::Undersampling::kNone);
  EXPECT_EQ(solver.visibility, proto::VisibilityKind::kAuto);
  EXPECT_FALSE(solver.max_view_factor || solver.window);
  EXPECT_NE(solver.seed, settings.solver.seed);
  EXPECT_LT(solver.seed, std::uint64_t(1) << 53);
}

TEST(Report, PagesFollowTheNumberOfTheFirst) {
  EXPECT_EQ(page_file_name("page_00.exr", 0), "page_00.exr");
  EXPECT_EQ(page_file_name("page_00.exr", 12), "page_12.exr");
  EXPECT_EQ(page_file_name("v2/light_099_b.exr", 1), "v2/light_100_b.exr");
  EXPECT_EQ(page_file_name("7", 1), "8");
  EXPECT_EQ(page_file_name("one.exr", 0), "one.exr");
  EXPECT_EQ(page_file_name("one.exr", 1), std::nullopt);
  EXPECT_EQ(page_file_name("one.ex3", 1), std::nullopt);
  EXPECT_EQ(page_file_name("99999999999999999999.exr", 1), std::nullopt);
}

}  // namespace
}  // namespace kiln::baker
