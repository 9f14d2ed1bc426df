#include "baker/solve_session.h"

#include <span>
#include <utility>

#include "baker/solver/emittance.h"
#include "baker/solver/radiosity_map/ambient_term.h"

namespace kiln::baker {
namespace {

/// Returns the expected effort of passes that are done.
solver::Work work_of(const solver::Solver& solver, std::span<const proto::PassReport> passes) {
  solver::Work work;
  for (std::size_t i = 0; i < passes.size(); ++i) {
    const auto pass = solver.next(passes.first(i));
    work += pass->plan().work + pass->plan().finish_work;
  }
  return work;
}

/// Takes the light of `to` back to the share of the way that leads there from `from`.
void fade(const lightmap::Lightmap& from, lightmap::Lightmap& to, float share) {
  const auto mix = [&](const lightmap::Plane<math::Rgb>& shown,
                       lightmap::Plane<math::Rgb>& computed) {
    std::vector<math::Rgb> mixed(shown.values());
    for (std::size_t t = 0; t < mixed.size(); ++t) mixed[t] += (computed[t] - mixed[t]) * share;
    computed = std::move(mixed);
  };
  mix(from.direct, to.direct), mix(from.sky, to.sky), mix(from.indirect, to.indirect);
}

}  // namespace

SolveSession::SolveSession(const BakeInput& input, const solver::World& world,
                           const solver::Solver& solver,
                           std::shared_ptr<const atlas::TextureGroup> texels,
                           const solver::SolveStart& start, checkpoint::CheckpointWriter& writer,
                           BakeObserver& observer, progress::ProgressReporter& reporter,
                           const solver::Work& reference)
    : input_(input),
      world_(world),
      solver_(solver),
      texels_(std::move(texels)),
      writer_(writer),
      observer_(observer),
      reporter_(reporter),
      passes_(start.passes),
      eta_(work_of(solver, start.passes)),
      elsewhere_(solver::Work::other(solver::work::kOutput) + reference) {
  for (const auto& p : passes_)
    if (p.residual > 0) residual_ = p.residual;
  if (passes_.empty()) return;
  observer_.on_resume(std::uint32_t(passes_.size()));
  show(start.light->shown(), passes_.back().index);
}

SolveHooks SolveSession::hooks() {
  SolveHooks hooks;
  hooks.finish_early = input_.finish_early;
  hooks.part_time = input_.part_time;
  hooks.queue = input_.queue;
  hooks.on_batch = [this](const SolveProgress& progress) { on_batch(progress); };
  hooks.on_pass = [this](const solver::PassPlan& plan, const proto::PassReport& report,
                         std::shared_ptr<const lightmap::Lightmap> light) -> proto::Expected<void> {
    on_pass(plan, report, std::move(light));
    return {};
  };
  hooks.begin_pass = [this](const solver::PassPlan& plan) { writer_.begin_pass(plan); };
  hooks.on_part = [this](const solver::PassPlan& plan,
                         std::shared_ptr<const lightmap::Lightmap> after,
                         const solver::PassProgress& progress) {
    writer_.submit_part(plan, std::move(after), progress);
  };
  hooks.end_parts = [this] { writer_.end_parts(); };
  hooks.restore = [this](const solver::Pass& pass, const lightmap::Lightmap& before,
                         lightmap::Lightmap& after) { return restore(pass, before, after); };
  return hooks;
}

SolveHooks SolveSession::reference_hooks() {
  elsewhere_ = solver::Work::other(solver::work::kOutput) + work_of(solver_, passes_);
  SolveHooks hooks;
  hooks.on_batch = [this](const SolveProgress& progress) { on_batch(progress); };
  hooks.on_pass = [this](
                      const solver::PassPlan& plan, const proto::PassReport&,
                      const std::shared_ptr<const lightmap::Lightmap>&) -> proto::Expected<void> {
    eta_.end_pass(plan);
    return {};
  };
  return hooks;
}

void SolveSession::on_batch(const SolveProgress& at) {
  const solver::PassPlan& plan = at.pass.plan();
  const double share = at.pass.work_share(double(at.done) / at.total);
  const auto ahead = eta_.ahead(plan, share, at.work + elsewhere_);
  proto::JobProgress p;
  p.pass = plan.index;
  p.max_passes = at.max_passes;
  p.batches_done = at.done;
  p.batches_total = at.total;
  p.residual = residual_;
  p.fraction = kSolvingFrom + (kSolvedAt - kSolvingFrom) * ahead.share_done;
  p.eta_seconds = ahead.seconds_left;
  reporter_.batch(std::move(p));
}

void SolveSession::on_pass(const solver::PassPlan& plan, const proto::PassReport& report,
                           std::shared_ptr<const lightmap::Lightmap> light) {
  eta_.end_pass(plan);
  if (report.residual > 0) residual_ = report.residual;  // tracing alone changes no light
  passes_.push_back(report);
  const proto::SolverSettings& settings = input_.settings.solver;
  const bool guesses = settings.ambient_term && settings.method == proto::Method::kRadiosityMap &&
                       settings.bounces > 0 && !plan.completes;
  show(guesses ? solver::radiosity_map::with_ambient_term(*texels_, light->shown(),
                                                          solver::sent_emittance(world_))
               : light->shown(),
       report.index);
  writer_.submit(plan, passes_, std::move(light));
}

void SolveSession::show(lightmap::Lightmap computed, std::uint32_t pass) {
  const float share = input_.settings.output.preview_fade;
  if (share < 1 && shown_) fade(*shown_, computed, share);
  auto shown = std::make_shared<const lightmap::Lightmap>(std::move(computed));
  if (share < 1) shown_ = shown;
  observer_.on_snapshot({texels_, std::move(shown), pass});
}

solver::PassProgress SolveSession::restore(const solver::Pass& pass,
                                           const lightmap::Lightmap& before,
                                           lightmap::Lightmap& after) {
  const solver::PassProgress done = writer_.restore(pass.plan(), before, after);
  if (done.texels == 0) return done;
  const double share = double(done.texels) / texels_->size();
  eta_.resume_within(pass.work_share(share));
  observer_.on_resume_within(pass.plan().name, share);
  return done;
}

}  // namespace kiln::baker
