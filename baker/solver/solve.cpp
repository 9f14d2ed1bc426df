#include "baker/solver/solve.h"

#include <atomic>
#include <chrono>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

namespace kiln::solver {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// From area-weighted sums over the texels, by runs of the same texels on any number of threads.
struct Change {
  double mean_lx = 0;   ///< E after
  double residual = 0;  ///< mean |E after - E before| over mean E after
  bool finite = true;
};

/// Nothing when stopped.
std::optional<Change> measure(const atlas::TextureGroup& texels, const lightmap::Lightmap& before,
                              const lightmap::Lightmap& after, const exec::Workers& workers) {
  constexpr std::uint32_t kRunTexels = 16384;
  struct Sums {
    double area = 0, light = 0, moved = 0;
  };
  std::vector<Sums> runs(texels.size() / kRunTexels + 1);
  const bool whole = workers.for_runs(texels.size(), kRunTexels, [&](auto begin, auto end) {
    Sums& run = runs[begin / kRunTexels];
    for (std::uint32_t t = begin; t < end; ++t) {
      const double a = texels.area_m2[t];
      const math::Rgb now = after.irradiance(t), then = before.irradiance(t);
      run.area += a;
      run.light += a * (double(now.r) + now.g + now.b) / 3;
      run.moved += a *
                   (std::abs(double(now.r) - then.r) + std::abs(double(now.g) - then.g) +
                    std::abs(double(now.b) - then.b)) /
                   3;
    }
  });
  if (!whole) return std::nullopt;
  Sums all;
  for (const Sums& run : runs) all.area += run.area, all.light += run.light, all.moved += run.moved;
  Change c;
  c.finite = std::isfinite(all.light);
  c.residual = all.light > 0 ? all.moved / all.light : 0;
  c.mean_lx = all.area > 0 ? all.light / all.area : 0;
  return c;
}

/// The batches of one pass.
class PassRun {
 public:
  /// @param done what need not be computed
  PassRun(Solver& solver, const Pass& pass, std::shared_ptr<const lightmap::Lightmap> before,
          std::shared_ptr<lightmap::Lightmap> after, const exec::Workers& workers,
          const SolveHooks& hooks, const PassProgress& done, Clock::time_point start)
      : solver_(solver),
        pass_(pass),
        before_(std::move(before)),
        after_(std::move(after)),
        workers_(workers),
        hooks_(hooks),
        restored_(done),
        texels_(after_->size()),
        batches_((texels_ + pass.batch_texels - 1) / pass.batch_texels),
        first_((done.texels + pass.batch_texels - 1) / pass.batch_texels),
        done_(first_),
        ran_(batches_),
        rays_(batches_),
        start_(start) {}

  /// False when stopped. What is computed, and by which bits, does not depend on how the batches
  /// fall into parts.
  bool all_batches() {
    while (first_ < batches_) {
      if (!some_batches(Clock::now() + hooks_.part_time)) return false;
      while (first_ < batches_ && ran_[first_]) ++first_;
      if (first_ < batches_ && hooks_.on_part)
        hooks_.on_part(pass_, before_, after_,
                       {first_ * pass_.batch_texels, rays(first_), seconds()});
    }
    return true;
  }
  std::uint64_t rays() const { return rays(batches_); }
  double seconds() const { return restored_.seconds + seconds_since(start_); }

 private:
  /// Those that begin before a moment, but one at least.
  bool some_batches(Clock::time_point until) {
    const std::uint32_t first = first_;
    return workers_.pool.for_batches(batches_ - first, workers_.stop, [&](std::uint32_t i) {
      const std::uint32_t b = first + i, size = pass_.batch_texels;
      if (ran_[b] || (i > 0 && Clock::now() >= until)) return;
      rays_[b] =
          solver_.run(pass_, *before_, {b * size, std::min((b + 1) * size, texels_)}, *after_);
      ran_[b] = true;
      if (hooks_.on_batch) hooks_.on_batch(pass_, ++done_, batches_);
    });
  }
  std::uint64_t rays(std::uint32_t batches) const {
    return std::accumulate(rays_.begin(), rays_.begin() + batches, restored_.rays);
  }

  Solver& solver_;
  const Pass& pass_;
  const std::shared_ptr<const lightmap::Lightmap> before_;
  const std::shared_ptr<lightmap::Lightmap> after_;
  const exec::Workers& workers_;
  const SolveHooks& hooks_;
  const PassProgress restored_;
  const std::uint32_t texels_, batches_;
  std::uint32_t first_;  ///< that has not run
  std::atomic<std::uint32_t> done_;
  std::vector<char> ran_;
  std::vector<std::uint64_t> rays_;
  const Clock::time_point start_;
};

/// Nothing when stopped.
proto::Expected<std::optional<proto::PassReport>> run_pass(
    Solver& solver, const Pass& pass, const atlas::TextureGroup& texels,
    const std::shared_ptr<const lightmap::Lightmap>& before,
    const std::shared_ptr<lightmap::Lightmap>& after, const exec::Workers& workers,
    const SolveHooks& hooks) {
  if (hooks.before_pass) hooks.before_pass(pass);
  const auto start = Clock::now();
  bool whole = solver.begin(pass, *before, *after, workers);
  PassProgress restored;
  if (whole && hooks.restore) restored = hooks.restore(pass, *before, *after);
  PassRun run{solver, pass, before, after, workers, hooks, restored, start};
  whole = whole && run.all_batches();
  if (hooks.before_finish) hooks.before_finish();
  proto::PassReport report;
  whole = whole && solver.finish(pass, *after, workers, report);
  const auto change = whole ? measure(texels, *before, *after, workers) : std::nullopt;
  if (!change) return std::optional<proto::PassReport>{};
  if (!change->finite)
    return proto::fail("internal",
                       "The light of a texel is not finite after pass '" + pass.name + "'.");
  report.name = pass.name;
  report.index = pass.index;
  report.residual = change->residual;
  report.mean_lx = change->mean_lx;
  report.rays = run.rays();
  report.seconds = run.seconds();
  return std::optional(report);
}

}  // namespace

proto::Expected<Solution> solve(Solver& solver, const atlas::TextureGroup& texels,
                                exec::ThreadPool& pool, std::stop_token stop,
                                const SolveHooks& hooks, SolveStart from) {
  Solution solution;
  solution.passes = std::move(from.passes);
  std::shared_ptr<const lightmap::Lightmap> before = std::move(from.light);
  if (!before) before = std::make_shared<lightmap::Lightmap>(texels.size());
  for (std::size_t i = 0; i < solution.passes.size(); ++i)
    if (const auto pass = solver.next(std::span(solution.passes).first(i)))
      solution.tail_scale = std::max(solution.tail_scale, pass->tail_scale);
  std::stop_source either;  // what a pass under way listens to
  const std::stop_callback on_stop(stop, [&] { either.request_stop(); });
  const std::stop_callback on_enough(hooks.enough, [&] { either.request_stop(); });
  const auto enough = [&] {
    return hooks.enough.stop_requested() && !stop.stop_requested() && !solution.passes.empty();
  };
  const exec::Workers workers{pool, either.get_token()};
  while (const auto pass = solver.next(solution.passes)) {
    if (enough()) break;
    auto after = std::make_shared<lightmap::Lightmap>(*before);
    const auto ran = run_pass(solver, *pass, texels, before, after, workers, hooks);
    if (!ran) return proto::Unexpected(ran.error());
    if (!*ran && enough()) break;
    if (!*ran) return proto::fail(proto::kCanceledCode, "The job was canceled.");
    const proto::PassReport& report = **ran;
    solution.passes.push_back(report);
    if (hooks.on_pass)
      if (auto ok = hooks.on_pass(*pass, report, after); !ok) return proto::Unexpected(ok.error());
    solution.tail_scale = std::max(solution.tail_scale, pass->tail_scale);
    before = std::move(after);
  }
  auto filtered = solver.filtered(*before, {pool, stop});
  if (!filtered) return proto::fail(proto::kCanceledCode, "The job was canceled.");
  solution.filtered = std::move(*filtered);
  solution.light = std::move(before);
  solution.ray_pattern = solver.ray_pattern();
  return solution;
}

}  // namespace kiln::solver
