#include "baker/solver/gather/schedule.h"

#include <algorithm>
#include <cmath>

#include "baker/solver/direct/direct.h"

namespace kiln::solver::gather {
namespace {

/// Bounces after which most scenes have converged; for the estimate of progress only.
constexpr std::uint32_t kTypicalBounces = 10;

}  // namespace

GatherSchedule::GatherSchedule(const SolverInput& in, const sampling::DirectionSet& set,
                               const adaptive::SampleRounds& rounds)
    : in_(in),
      set_(set),
      rounds_(rounds),
      bounces_(in.settings, set, first_bounce()),
      needs_rays_(in.settings.bounces > 0 || in.scene.has_sky()) {}

std::uint32_t GatherSchedule::max_passes() const {
  return (needs_rays_ ? first_bounce() + in_.settings.bounces : 1) + rounds_.limit();
}

Work GatherSchedule::total_work() const {
  Work work = direct_work() + rounds_.expected_work() + adaptive::SampleRounds::judge_work();
  if (!needs_rays_) return work;
  work += trace_work();
  if (in_.plan.coarse) work += refine_work();
  const std::uint32_t bounces = std::min(kTypicalBounces, in_.settings.bounces);
  for (std::uint32_t b = 0; b < bounces; ++b)
    work += look_up_work(bounces_.directions_for(std::pow(0.5, b)));
  return work;
}

std::optional<Pass> GatherSchedule::next(std::span<const proto::PassReport> done) const {
  auto pass = plan(done);
  if (!pass) return std::nullopt;
  pass->index = static_cast<std::uint32_t>(done.size());
  if (pass->completes) pass->finish_work = adaptive::SampleRounds::judge_work();
  return pass;
}

/// The passes that bring new light come first, those that only add samples follow.
std::optional<Pass> GatherSchedule::plan(std::span<const proto::PassReport> done) const {
  Pass pass;
  if (done.empty()) {
    pass.name = kDirect;
    pass.completes = !needs_rays_;
    pass.work = direct_work();
    return pass;
  }
  if (needs_rays_ && done.size() < first_bounce()) {
    pass.name = done.size() == 1 ? kTrace : kRefine;
    pass.fills_state = true;
    pass.completes = bounces_.limit() == 0 && done.size() + 1 == first_bounce();
    pass.work = done.size() == 1 ? trace_work() : refine_work();
    return pass;
  }
  const std::string& last = done.back().name;
  if (needs_rays_ && last != kTail && last != kRound && !bounces_.is_complete(done))
    return plan_bounce(done);
  if (!rounds_.wants_another(done)) return std::nullopt;
  pass.name = kRound;
  pass.work = rounds_.next_work();
  pass.completes = true;
  return pass;
}

/// Another bounce of what the one before has changed.
Pass GatherSchedule::plan_bounce(std::span<const proto::PassReport> done) const {
  const BouncePlan::Bounce bounce = bounces_.next(done);
  Pass pass;
  pass.name = bounce.stands_for_others ? kTail : kBounce;
  pass.batch_texels = 1024;
  pass.completes = bounce.last;
  pass.tail_scale = bounce.tail_scale;
  pass.sample_count = bounce.directions;
  pass.work = look_up_work(pass.sample_count);
  return pass;
}

Work GatherSchedule::direct_work() const {
  constexpr double kSent = 0.6;  // about; the others are saved where the first of them agree
  const double ray = direct::DirectLight::are_many(in_.lights) ? work::kManyLightsRay : kSent;
  const double area = in_.lights.area().empty() ? 0 : ray;
  const double sky = in_.lights.has_bright_sky() ? 1 : 0;
  const double punctual =
      double(in_.lights.punctual().size()) * atlas::TextureGroup::kPointsPerTexel;
  return Work::shadow_rays((area + sky) * in_.plan.shadow_rays + punctual);
}

/// Every fourth texel is a site, and charts are edged by texels without sites around them.
Work GatherSchedule::trace_work() const {
  return directions_work(in_.plan.coarse ? 0.35 : 1);
}

Work GatherSchedule::directions_work(double share_of_texels) const {
  return Work::directions(work::kDirection * set_.size() * share_of_texels);
}

Work GatherSchedule::look_up_work(std::uint32_t directions) const {
  const double look_ups = directions * (in_.plan.coarse ? 0.45 : 1);
  return Work::other(work::kTexel + work::kLookUp * look_ups);
}

}  // namespace kiln::solver::gather
