// The stages around the solver, and the solve on one and two threads.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <numeric>

#include "baker/exec/thread_pool.h"
#include "baker/methods.h"
#include "baker/output/output.h"
#include "baker/output/post.h"
#include "baker/solve.h"
#include "tests/bench/ball.h"

namespace kiln::bench {
namespace {

void import(benchmark::State& state, const char* generator) {
  const SceneFile file(generator);
  for (auto _ : state) benchmark::DoNotOptimize(must(import::import_scene(file.files(), {})));
}
void build_bvh(benchmark::State& state) {
  const scene::Scene& scene = ball_at_1024().scene;
  for (auto _ : state) benchmark::DoNotOptimize(test::must(trace::RayScene::build(scene)));
  state.SetItemsProcessed(state.iterations() * std::int64_t(scene.triangles.size()));
}
void atlas(benchmark::State& state, proto::Unwrap unwrap) {
  const scene::Scene& scene = ball_at_1024().scene;
  proto::AtlasSettings settings;
  settings.unwrap = unwrap;
  for (auto _ : state) benchmark::DoNotOptimize(test::must(atlas::build_atlas(scene, settings)));
  state.SetItemsProcessed(state.iterations() * std::int64_t(scene.triangles.size()));
}
void rasterize(benchmark::State& state) {
  const scene::Scene& scene = ball_at_1024().scene;
  proto::AtlasSettings settings;
  settings.page_size = std::uint32_t(state.range(0));
  const atlas::Atlas atlas = test::must(atlas::build_atlas(scene, settings));
  std::int64_t texels = 0;
  for (auto _ : state) texels += test::must(atlas::rasterize(scene, atlas)).size();
  state.SetItemsProcessed(texels);
}

void write_exr(benchmark::State& state, proto::Precision precision) {
  const atlas::TextureGroup& texels = ball_at_1024().texels;
  // Positions vary as light does: smoothly, and not at all alike from chart to chart.
  std::vector<math::Rgb> values;
  for (const math::Vec3& p : texels.position)
    values.push_back({2 + std::sin(p.x), 2 + std::sin(p.y), 2 + std::sin(p.z)});
  const image::PageImage page = output::compose_page(
      texels, 0, [&](std::uint32_t t) { return values[t]; }, 4);
  const image::ExrLayer layer{"irradiance", &page};
  const test::TempFolder folder;
  const auto file = folder.path() / "page.exr";
  for (auto _ : state)
    if (!image::write_exr(file, {&layer, 1}, precision, {})) state.SkipWithError("not written");
  state.SetItemsProcessed(state.iterations() * std::int64_t(page.rgb.size()));
  state.counters["file_MB"] = double(std::filesystem::file_size(file)) * 1e-6;
}

double solve_seconds(const ReadyScene& ready, unsigned threads) {
  exec::ThreadPool pool(threads);
  const solver::World world = ready.world({});
  const auto start = std::chrono::steady_clock::now();
  const auto solver = baker::make_solver(world);
  benchmark::DoNotOptimize(test::must(baker::solve(world, *solver, pool, {})));
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

double solve_cpu_seconds(const ReadyScene& ready, std::uint32_t bounces) {
  proto::SolverSettings settings;
  settings.samples = settings.direct_samples = 64;
  settings.bounces = bounces;
  settings.tolerance = 0;  // all of them
  const solver::World world = ready.world(settings);
  exec::ThreadPool pool(1);
  const std::clock_t start = std::clock();
  const auto solver = baker::make_solver(world);
  benchmark::DoNotOptimize(test::must(baker::solve(world, *solver, pool, {})));
  return double(std::clock() - start) / CLOCKS_PER_SEC;
}

/// The shortest seconds of two ways, in turns.
struct InTurns {
  double first = 1e9, second = 1e9;

  template <class First, class Second>
  InTurns(benchmark::State& state, const First& one, const Second& two) {
    for (auto _ : state) {
      first = std::min(first, one());
      const double now = two();
      second = std::min(second, now);
      state.SetIterationTime(now);
    }
  }
};

/// Wall time of the default solve, one thread and two; means something on an idle machine only.
void threads(benchmark::State& state, const char* generator, std::uint32_t page_size) {
  const ReadyScene ready(generator, 0, page_size);
  const InTurns s(
      state, [&] { return solve_seconds(ready, 1); }, [&] { return solve_seconds(ready, 2); });
  state.counters["one_thread_s"] = s.first;
  state.counters["two_threads_s"] = s.second;
  state.counters["speedup"] = s.first / s.second;
}

/// CPU time of a solve with one bounce and with sixteen.
void bounces(benchmark::State& state, const char* generator, std::uint32_t page_size) {
  const ReadyScene ready(generator, 0, page_size);
  const InTurns s(
      state, [&] { return solve_cpu_seconds(ready, 1); },
      [&] { return solve_cpu_seconds(ready, 16); });
  state.counters["one_bounce_s"] = s.first;
  state.counters["sixteen_bounces_s"] = s.second;
}

constexpr auto kUnit = benchmark::kMillisecond;
BENCHMARK_CAPTURE(import, cornell, "cornell")->Unit(kUnit);
BENCHMARK_CAPTURE(import, bumpy_ball, "bumpy_ball")->Unit(kUnit);
BENCHMARK_CAPTURE(import, room_textured, "room_textured")->Unit(kUnit);
BENCHMARK(build_bvh)->Unit(kUnit);
BENCHMARK_CAPTURE(atlas, existing, proto::Unwrap::kExisting)->Unit(kUnit);
BENCHMARK_CAPTURE(atlas, unwrap, proto::Unwrap::kAlways)->Unit(kUnit);
BENCHMARK(rasterize)->ArgName("page")->Arg(256)->Arg(1024)->Unit(kUnit);
BENCHMARK_CAPTURE(write_exr, half, proto::Precision::kHalf)->Unit(kUnit);
BENCHMARK_CAPTURE(write_exr, float, proto::Precision::kFloat)->Unit(kUnit);
BENCHMARK_CAPTURE(threads, cornell, "cornell", 256)->Iterations(5)->UseManualTime()->Unit(kUnit);
BENCHMARK_CAPTURE(bounces, cornell, "cornell", 256)->Iterations(5)->UseManualTime()->Unit(kUnit);
BENCHMARK_CAPTURE(bounces, bumpy_ball, "bumpy_ball", 1024)
    ->Iterations(2)
    ->UseManualTime()
    ->Unit(kUnit);
BENCHMARK_CAPTURE(threads, bumpy_ball, "bumpy_ball", 256)
    ->Iterations(3)
    ->UseManualTime()
    ->Unit(kUnit);

}  // namespace
}  // namespace kiln::bench
