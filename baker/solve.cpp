#include "baker/solve.h"

#include <atomic>
#include <chrono>
#include <cmath>
#include <mutex>
#include <numeric>
#include <optional>
#include <utility>

#include "baker/exec/stop.h"
#include "baker/methods.h"
#include "baker/solver/adaptive/error.h"
#include "baker/solver/adaptive/forecast.h"
#include "baker/solver/adaptive/rounds.h"

namespace kiln::baker {
namespace {

using Clock = std::chrono::steady_clock;
using proto::Expected;
using LightPtr = std::shared_ptr<const lightmap::Lightmap>;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// The change of the light by a pass, from area-weighted sums over the texels. Runs of the same
/// texels are summed on any number of threads.
struct Change {
  double mean_lx = 0;   ///< E after
  double residual = 0;  ///< mean |E after - E before| over mean E after
  bool finite = true;
};

/// Returns nothing when stopped.
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

/// The batches of one pass, wherever they run.
class PassBatches final : public exec::BatchWork {
 public:
  /// @param restored what need not be computed
  PassBatches(const solver::Pass& pass, const lightmap::Lightmap& before, lightmap::Lightmap& after,
              const solver::PassProgress& restored)
      : pass_(pass),
        before_(before),
        after_(after),
        view_(after, pass.plan().writes),
        form_(solver::patch_form(pass.plan(), after)),
        restored_(restored),
        count_((after.size() + form_.batch_texels - 1) / form_.batch_texels),
        first_((restored.texels + form_.batch_texels - 1) / form_.batch_texels),
        ran_(count_),
        rays_(count_),
        done_(first_) {}

  void run(std::uint32_t batch) override { rays_[batch] = pass_.run(range(batch), before_, view_); }
  std::string compute(std::uint32_t batch) override {
    return solver::compute_patch(pass_, range(batch), before_).serialized();
  }
  Expected<void> take(std::uint32_t batch, std::string_view bytes) override {
    const auto patch = lightmap::parse_patch(bytes, form_);
    if (!patch) return proto::Unexpected(patch.error());
    const atlas::TexelRange asked = range(batch), given = patch->head.texels;
    if (given.begin != asked.begin || given.end != asked.end)
      return proto::fail("invalid_patch", "The patch of a batch is of another batch.");
    rays_[batch] = patch->head.rays;
    return apply_patch(*patch, after_);
  }

  /// Returns the batches that have to run.
  std::vector<std::uint32_t> missing() const {
    std::vector<std::uint32_t> all(count_ - first_);
    std::iota(all.begin(), all.end(), first_);
    return all;
  }
  std::uint32_t count() const { return count_; }
  /// Notes that a batch has run. @return how many have
  std::uint32_t note(std::uint32_t batch) {
    const std::lock_guard lock(mutex_);
    ran_[batch] = true;
    while (first_ < count_ && ran_[first_]) ++first_;
    return ++done_;
  }
  /// Returns how far all batches from the first on have run. @param seconds time so far, in this
  /// attempt
  solver::PassProgress progress(double seconds) const {
    const std::lock_guard lock(mutex_);
    return {std::min(first_ * form_.batch_texels, after_.size()), rays(first_),
            restored_.seconds + seconds};
  }

 private:
  atlas::TexelRange range(std::uint32_t batch) const {
    const std::uint32_t size = form_.batch_texels;
    return {batch * size, std::min((batch + 1) * size, after_.size())};
  }
  std::uint64_t rays(std::uint32_t batches) const {
    return std::accumulate(rays_.begin(), rays_.begin() + batches, restored_.rays);
  }

  const solver::Pass& pass_;
  const lightmap::Lightmap& before_;
  lightmap::Lightmap& after_;
  const lightmap::LightmapView view_;
  const lightmap::PatchForm form_;
  const solver::PassProgress restored_;
  const std::uint32_t count_;
  mutable std::mutex mutex_;  ///< guards what follows, and the rays of the batches that ran
  std::uint32_t first_;       ///< first batch that has not run
  std::vector<char> ran_;
  std::vector<std::uint64_t> rays_;
  std::uint32_t done_;
};

/// A solve under way: the light, what is known of it, and what is expected.
class Solve {
 public:
  Solve(const solver::World& world, const solver::Solver& solver, exec::ThreadPool& pool,
        std::stop_token stop, const SolveHooks& hooks)
      : world_(world),
        solver_(solver),
        pool_(pool),
        stop_(std::move(stop)),
        hooks_(hooks),
        local_(pool),
        smooth_(world.filter && method_of(world.settings.method).filtered),
        judge_(world, smooth_),
        sampling_(world, solver.samples()),
        rounds_(world, sampling_, solver.samples(), smooth_) {}

  Expected<Solution> run(solver::SolveStart from) {
    start(std::move(from));
    std::stop_source either;  // stops a pass under way
    const std::stop_callback on_stop(stop_, [&] { either.request_stop(); });
    const std::stop_callback on_early(hooks_.finish_early, [&] { either.request_stop(); });
    const exec::Workers workers{pool_, either.get_token()};
    while (auto pass = solver_.next(solution_.passes)) {
      if (ends_early()) break;
      auto ran = run_pass(std::move(pass), workers);
      if (!ran && ran.error().code == proto::kCanceledCode && ends_early()) break;
      if (!ran) return proto::Unexpected(ran.error());
    }
    if (!show()) return proto::canceled();
    solution_.light = std::move(light_);
    solution_.ray_pattern = solver_.ray_pattern();
    return std::move(solution_);
  }

 private:
  void start(solver::SolveStart from) {
    solution_.passes = std::move(from.passes);
    light_ = std::move(from.light);
    if (!light_)
      light_ = std::make_shared<lightmap::Lightmap>(world_.texels.size(), solver_.state_planes());
    for (std::size_t i = 0; i < solution_.passes.size(); ++i)
      if (const auto pass = solver_.next(std::span(solution_.passes).first(i)))
        solution_.tail_scale = std::max(solution_.tail_scale, pass->plan().tail_scale);
  }

  bool ends_early() const {
    return hooks_.finish_early.stop_requested() && !stop_.stop_requested() &&
           !solution_.passes.empty();
  }

  /// One pass: prepare, batches, finish; then a look at the light that it leaves.
  Expected<void> run_pass(std::unique_ptr<solver::Pass> pass, const exec::Workers& workers) {
    const auto start = Clock::now();
    if (hooks_.begin_pass) hooks_.begin_pass(pass->plan());
    if (!pass->prepare(*light_, workers)) return proto::canceled();
    const solver::PassPlan plan = pass->plan();
    auto after = std::make_shared<lightmap::Lightmap>(*light_);
    after->detach(plan.writes | plan.finishes);
    solver::PassProgress progress;
    if (hooks_.restore) progress = hooks_.restore(*pass, *light_, *after);
    if (auto ok = run_batches(*pass, after, progress, start, workers); !ok) return ok;
    if (!pass->finish(*after, workers)) return proto::canceled();
    pass = nullptr;  // its memory is free for the filter

    const auto change = measure(world_.texels, *light_, *after, workers);
    if (!change) return proto::canceled();
    if (!change->finite)
      return proto::fail("internal",
                         "The light of a texel is not finite after pass '" + plan.name + "'.");
    proto::PassReport report;
    report.name = plan.name;
    report.index = plan.index;
    report.residual = change->residual;
    report.mean_lx = change->mean_lx;
    report.rays = progress.rays;
    if (!look_at(plan, *after, report, workers)) return proto::canceled();
    report.seconds = progress.seconds + seconds_since(start);
    return take(plan, report, std::move(after));
  }

  /// @param progress what is restored; then the rays of all batches, and the seconds of earlier
  /// attempts
  Expected<void> run_batches(const solver::Pass& pass,
                             const std::shared_ptr<lightmap::Lightmap>& after,
                             solver::PassProgress& progress, Clock::time_point start,
                             const exec::Workers& workers) {
    PassBatches batches(pass, *light_, *after, progress);
    const solver::Forecast forecast = solver_.forecast();
    const solver::Work all = forecast.work + rounds_.expected_work();
    std::mutex one_part;
    auto next_part = Clock::now() + hooks_.part_time;
    std::uint32_t offered = progress.texels;
    const auto on_done = [&](std::uint32_t batch) {
      const std::uint32_t done = batches.note(batch);
      if (hooks_.on_batch) hooks_.on_batch({pass, done, batches.count(), forecast.passes, all});
      if (!hooks_.on_part) return;
      const std::lock_guard lock(one_part);
      if (workers.stop.stop_requested() || Clock::now() < next_part) return;
      const auto so_far = batches.progress(seconds_since(start));
      if (so_far.texels <= offered || so_far.texels == after->size()) return;
      hooks_.on_part(pass.plan(), after, so_far);
      offered = so_far.texels;
      next_part = Clock::now() + hooks_.part_time;
    };
    exec::BatchQueue& queue = hooks_.queue ? *hooks_.queue : local_;
    const auto ran = queue.run(batches.missing(), batches, on_done, workers.stop);
    if (hooks_.end_parts) hooks_.end_parts();
    progress.rays = batches.progress(0).rays;
    if (!ran && ran.error().code == proto::kCanceledCode) return proto::canceled();
    return ran;
  }

  /// Judges light that is complete, and chooses what the next round adds; estimates otherwise what
  /// rounds will cost. Returns false when stopped.
  bool look_at(const solver::PassPlan& plan, lightmap::Lightmap& after, proto::PassReport& report,
               const exec::Workers& workers) {
    if (!plan.completes) {
      if (plan.shows != solver::Shows::kNothingNew) rounds_.guess(after, plan.shows);
      return true;
    }
    // What passes share, and what an earlier judgement holds, are memory that the filter can use.
    drop_shared_planes(after);
    judgement_.reset();
    judgement_ = judge_.judge(after, workers);
    if (!judgement_) return false;
    report.standard_error = judgement_->standard_error;
    rounds_.see(sampling_.choose(*judgement_, after));
    return true;
  }
  void drop_shared_planes(lightmap::Lightmap& after) {
    after.drop_shared();
    if (!light_->has_shared()) return;
    auto before = std::make_shared<lightmap::Lightmap>(*light_);
    before->drop_shared();
    light_ = std::move(before);
  }

  Expected<void> take(const solver::PassPlan& plan, const proto::PassReport& report,
                      LightPtr after) {
    solution_.passes.push_back(report);
    solution_.tail_scale = std::max(solution_.tail_scale, plan.tail_scale);
    light_ = std::move(after);
    judged_after_ = plan.completes ? solution_.passes.size() : 0;
    if (!hooks_.on_pass) return {};
    return hooks_.on_pass(plan, report, light_);
  }

  /// The light of the last pass has been filtered already, unless the solve ends early, or began at
  /// its end. Returns false when stopped.
  bool show() {
    if (judged_after_ != solution_.passes.size() || !judgement_) {
      judgement_.reset();
      judgement_ = judge_.judge(*light_, {pool_, stop_});
    }
    if (!judgement_) return false;
    solution_.filtered = std::move(judgement_->filtered);
    return true;
  }

  const solver::World& world_;
  const solver::Solver& solver_;
  exec::ThreadPool& pool_;
  const std::stop_token stop_;
  const SolveHooks& hooks_;
  exec::LocalQueue local_;
  const bool smooth_;
  solver::adaptive::ErrorJudge judge_;
  const solver::adaptive::AdaptiveSampling sampling_;
  solver::adaptive::RoundForecast rounds_;

  Solution solution_;
  LightPtr light_;                ///< after the passes that are done
  std::size_t judged_after_ = 0;  ///< passes that led to the light of the judgement; 0: none
  std::optional<solver::adaptive::Judgement> judgement_;
};

}  // namespace

proto::Expected<Solution> solve(const solver::World& world, const solver::Solver& solver,
                                exec::ThreadPool& pool, std::stop_token stop,
                                const SolveHooks& hooks, solver::SolveStart from) {
  return Solve(world, solver, pool, std::move(stop), hooks).run(std::move(from));
}

}  // namespace kiln::baker
