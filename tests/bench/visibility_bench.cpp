// Pairs of points as POST /v1/visibility answers them, beside Embree alone with the same rays.
#include <benchmark/benchmark.h>

#include <ctime>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>

#include "baker/visibility/pairs.h"
#include "tests/bench/ball.h"
#include "tests/bench/embree_tap.h"

namespace kiln::bench {
namespace {

constexpr std::uint32_t kPairs = 1u << 18;
constexpr int kTurns = 5;

enum Kind { kScattered, kFromOnePoint };

/// Makes pairs of points of the surface, by triangle: fine parts of the scene have more of them.
std::string make_pairs(const scene::Scene& scene, Kind kind) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> unit(0.f, 1.f);
  const auto point = [&] {
    const auto& v = scene.triangles[random() % scene.triangles.size()];
    const float u = unit(random), w = unit(random) * (1 - u);
    return scene::interpolate(scene.positions[v[0]], scene.positions[v[1]], scene.positions[v[2]],
                              {u, w});
  };
  const math::Vec3 one = point();
  std::string bytes;
  for (std::uint32_t i = 0; i < kPairs; ++i) {
    const math::Vec3 pair[2] = {kind == kFromOnePoint ? one : point(), point()};
    bytes.append(reinterpret_cast<const char*>(pair), sizeof pair);
  }
  return bytes;
}

double process_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return double(now.tv_sec) + double(now.tv_nsec) * 1e-9;
}

/// Answers the pairs, and has Embree alone trace the same packets, in turns on one thread.
void visibility_rate(benchmark::State& state, const scene::Scene& scene,
                     const trace::RayScene& rays) {
  const std::string pairs = make_pairs(scene, Kind(state.range(0)));
  exec::ThreadPool pool(1);
  const exec::Workers workers{pool, {}};
  const auto answer = [&] {
    if (!visibility::check_pairs(pairs, workers)) throw std::runtime_error("wrong pairs");
    return must(visibility::see(rays, pairs, workers));
  };
  EmbreeTap tap;
  const auto heard = answer();
  tap.stop();
  double ours = 0, embree = 0;
  for (auto _ : state) {
    for (int turn = 0; turn < kTurns; ++turn) {
      const double began = process_seconds();
      benchmark::DoNotOptimize(answer());
      ours += process_seconds() - began;
      embree += tap.replay();
    }
    state.SetIterationTime(ours);
  }
  const double traced = kTurns * double(tap.shadow_rays());
  state.counters["visible_percent"] = 100 * double(heard.visible) / kPairs;
  state.counters["Mpair_per_s"] = kTurns * double(kPairs) / ours * 1e-6;
  state.counters["embree_Mray_per_s"] = traced / embree * 1e-6;
  state.counters["percent_of_embree"] = 100 * embree / ours;
}

void visibility_ball(benchmark::State& state) {
  visibility_rate(state, ball_at_1024().scene, ball_at_1024().rays);
}
void visibility_cornell(benchmark::State& state) {
  static const ReadyScene cornell("cornell", 0, 64);
  visibility_rate(state, cornell.scene, cornell.rays);
}

void kinds(benchmark::internal::Benchmark* of) {
  of->ArgName("from_one_point")->Arg(kScattered)->Arg(kFromOnePoint);
  of->Iterations(1)->UseManualTime()->Unit(benchmark::kMillisecond);
}
BENCHMARK(visibility_ball)->Apply(kinds);
BENCHMARK(visibility_cornell)->Apply(kinds);

}  // namespace
}  // namespace kiln::bench
