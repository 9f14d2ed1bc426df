// Tracing through the product's own passes beside Embree alone with the very same rays, in turns.
#include <benchmark/benchmark.h>
#include <xmmintrin.h>

#include <algorithm>
#include <optional>

#include "baker/solver/solve.h"
#include "tests/bench/embree_tap.h"
#include "tests/bench/ready_scene.h"

namespace kiln::bench {
namespace {

using baker::Lightmap;
using baker::Pass;
using baker::TexelRange;

constexpr std::uint32_t kBatches = 48;  ///< of all that a pass has, evenly spread over the page
constexpr int kRounds = 5;

/// As in the pool's threads.
struct FlushDenormals {
  unsigned before = _mm_getcsr();
  FlushDenormals() { _mm_setcsr(before | 0x8040); }
  ~FlushDenormals() { _mm_setcsr(before); }
};

/// A solver before its first pass that traces gather rays (or shadow rays).
class PassUnderTest {
 public:
  PassUnderTest(const ReadyScene& ready, const proto::SolverSettings& settings, bool shadow)
      : input_(ready.input(settings)),
        solver_(make_solver(input_)),
        before_(ready.texels.size()),
        after_(ready.texels.size()) {
    std::vector<proto::PassReport> done;
    while ((pass_ = solver_->next(done))) {
      solver_->begin(*pass_, before_);
      EmbreeTap tap;
      for (std::uint32_t i = 0; i < kBatches; ++i) run(batch(i));
      if ((shadow ? tap.shadow_rays() : tap.gather_rays()) > 0) return;
      proto::PassReport report;
      report.name = pass_->name;
      report.index = pass_->index;
      report.residual = 1;
      done.push_back(report);
    }
    throw std::runtime_error("no pass traces such rays");
  }

  TexelRange batch(std::uint32_t i) const {
    const std::uint32_t size = pass_->batch_texels, all = input_.texels.size() / size;
    const std::uint32_t first = std::uint32_t(std::uint64_t(i) * all / kBatches) * size;
    return {first, first + size};
  }
  void run(TexelRange range) { solver_->run(*pass_, before_, range, after_); }

 private:
  const baker::SolverInput input_;
  std::unique_ptr<baker::Solver> solver_;
  Lightmap before_, after_;
  std::optional<Pass> pass_;
};

double timed(PassUnderTest& pass, TexelRange range) {
  const double start = thread_seconds();
  pass.run(range);
  return thread_seconds() - start;
}

void trace_rate(benchmark::State& state, bool shadow) {
  const FlushDenormals as_in_the_pool;
  proto::SolverSettings settings;
  settings.samples = settings.direct_samples = std::uint32_t(state.range(0));
  PassUnderTest pass(ball_at_1024(), settings, shadow);
  double ours = 0, raw = 0, rays = 0;
  for (auto _ : state) {
    ours = raw = rays = 0;
    for (std::uint32_t i = 0; i < kBatches; ++i) {
      const TexelRange range = pass.batch(i);
      EmbreeTap tap;
      pass.run(range);
      tap.stop();
      rays += double(tap.gather_rays() + tap.shadow_rays());
      double best_ours = 1e9, best_raw = 1e9;
      for (int round = 0; round < kRounds; ++round) {
        best_ours = std::min(best_ours, timed(pass, range));
        best_raw = std::min(best_raw, tap.replay());
      }
      ours += best_ours, raw += best_raw;
    }
    state.SetIterationTime(ours);
  }
  state.counters["rays"] = rays;
  state.counters["ours_Mray_per_s"] = rays / ours * 1e-6;
  state.counters["embree_Mray_per_s"] = rays / raw * 1e-6;
  state.counters["percent_of_embree"] = 100 * raw / ours;
}

BENCHMARK_CAPTURE(trace_rate, gather, false)
    ->ArgName("samples")
    ->Arg(64)
    ->Arg(256)
    ->Arg(1024)
    ->Iterations(1)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(trace_rate, occlusion, true)
    ->ArgName("samples")
    ->Arg(16)
    ->Arg(64)
    ->Iterations(1)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace kiln::bench
