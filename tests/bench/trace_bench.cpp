// Tracing through the product's own passes beside Embree alone with the very same rays, in turns.
#include <benchmark/benchmark.h>

#include <map>
#include <memory>
#include <utility>

#include "baker/exec/thread_pool.h"
#include "baker/methods.h"
#include "baker/solve.h"
#include "tests/bench/ball.h"
#include "tests/bench/embree_tap.h"

namespace kiln::bench {
namespace {

constexpr std::uint32_t kSampled = 48;  ///< batches of each pass, evenly spread over the page

/// Goes along with two solves on one thread: hears the rays of some batches in the first, and times
/// the same batches in the second, each followed by its rays through Embree alone. What has just
/// been traced is in the caches, so Embree goes through them before the batch too, untimed: both
/// then find the same.
class Comparison {
 public:
  struct Rate {
    double rays = 0, ours_s = 0, embree_s = 0;
  };
  Rate gather, shadow;

  /// @param first the first pass that counts
  explicit Comparison(std::uint32_t first = 0) : first_(first) {}
  void begin(bool timing) { timing_ = timing; }

  /// After each batch, from the thread that made it.
  void on_batch(const baker::SolveProgress& at) {
    const std::uint32_t pass = at.pass.plan().index, done = at.done, total = at.total;
    const double now = thread_seconds();
    if (tap_) tap_->stop(), taps_[{pass, done - 1}] = std::move(tap_);
    if (pass < first_) {
      start_ = now;
      return;
    }
    if (timing_) {
      if (const EmbreeTap* tap = find(pass, done - 1)) compare(*tap, now - start_);
      if (const EmbreeTap* tap = find(pass, done)) tap->replay();
    } else if (done < total && done % std::max(1u, total / kSampled) == 0) {
      tap_ = std::make_unique<EmbreeTap>();
    }
    start_ = thread_seconds();
  }

 private:
  const EmbreeTap* find(std::uint32_t pass, std::uint32_t batch) const {
    const auto found = taps_.find({pass, batch});
    return found == taps_.end() ? nullptr : found->second.get();
  }
  void compare(const EmbreeTap& tap, double seconds) {
    const std::size_t gathered = tap.gather_rays(), shadows = tap.shadow_rays();
    if (gathered + shadows == 0) return;  // a bounce: all look-ups
    Rate& rate = gathered > 0 ? gather : shadow;
    rate.rays += double(gathered + shadows);
    rate.ours_s += seconds;
    rate.embree_s += tap.replay();
  }

  std::map<std::pair<std::uint32_t, std::uint32_t>, std::unique_ptr<EmbreeTap>> taps_;
  std::unique_ptr<EmbreeTap> tap_;  ///< of the batch under way
  const std::uint32_t first_;
  double start_ = 0;
  bool timing_ = false;
};

void put(benchmark::State& state, const std::string& name, const Comparison::Rate& rate) {
  state.counters[name + "_rays"] = rate.rays;
  state.counters[name + "_Mray_per_s"] = rate.rays / rate.ours_s * 1e-6;
  state.counters[name + "_embree_Mray_per_s"] = rate.rays / rate.embree_s * 1e-6;
  state.counters[name + "_percent_of_embree"] = 100 * rate.embree_s / rate.ours_s;
}

/// Solves twice on one thread, and compares in the second.
void compare(benchmark::State& state, const ReadyScene& ready,
             const proto::SolverSettings& settings, Comparison& comparison) {
  const solver::World world = ready.world(settings);
  baker::SolveHooks hooks;
  hooks.on_batch = [&](const baker::SolveProgress& at) { comparison.on_batch(at); };
  for (auto _ : state) {
    for (const bool timing : {false, true}) {
      exec::ThreadPool pool(1);
      comparison.begin(timing);
      const auto solver = baker::make_solver(world);
      test::must(baker::solve(world, *solver, pool, {}, hooks));
    }
    state.SetIterationTime(comparison.gather.ours_s + comparison.shadow.ours_s);
  }
}

void trace_rate(benchmark::State& state) {
  proto::SolverSettings settings;
  settings.samples = std::uint32_t(state.range(0));
  settings.direct_samples = std::uint32_t(state.range(0)) / 4;
  settings.bounces = 1;
  Comparison comparison;
  compare(state, ball_at_1024(), settings, comparison);
  put(state, "gather", comparison.gather);
  put(state, "shadow", comparison.shadow);
}

/// A bounce of `pairwise` over all pairs of texels of a Cornell box.
void pairwise_rate(benchmark::State& state) {
  static const ReadyScene cornell("cornell", 0, 128);
  proto::SolverSettings settings;
  settings.method = proto::Method::kPairwise;
  settings.direct_samples = 16;
  settings.bounces = 1;
  Comparison comparison(/*first=*/1);
  compare(state, cornell, settings, comparison);
  put(state, "pair", comparison.shadow);
}

BENCHMARK(pairwise_rate)->Iterations(1)->UseManualTime()->Unit(benchmark::kMillisecond);
BENCHMARK(trace_rate)
    ->ArgName("samples")
    ->Arg(64)
    ->Arg(256)
    ->Iterations(1)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace kiln::bench
