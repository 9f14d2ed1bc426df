#include "baker/solver/gather/schedule.h"

#include <algorithm>
#include <cmath>

#include "baker/solver/direct/direct_pass.h"

namespace kiln::solver::gather {
namespace {

/// Most scenes have converged after this many bounces; for the estimate of progress only.
constexpr std::uint32_t kTypicalBounces = 10;
/// Every fourth texel is traced first, and charts are edged by texels without four around them.
constexpr double kTracedShare = 0.35;

}  // namespace

GatherSchedule::GatherSchedule(const World& world, const sampling::DirectionSet& set,
                               const adaptive::AdaptiveSampling& sampling)
    : world_(world),
      set_(set),
      sampling_(sampling),
      bounces_(world.settings, set, first_bounce()),
      needs_rays_(bounce_limit(world.settings) > 0 || world.scene.has_sky()) {}

std::uint32_t GatherSchedule::max_passes() const {
  return (needs_rays_ ? first_bounce() + bounces_.limit() : 1) + sampling_.limit();
}

Work GatherSchedule::total_work() const {
  Work work = direct::direct_work(world_);
  if (!needs_rays_) return work;
  work += trace_work();
  if (is_coarse()) work += refine_work();
  const std::uint32_t bounces = std::min(kTypicalBounces, bounces_.limit());
  for (std::uint32_t b = 0; b < bounces; ++b)
    work += look_up_work(bounces_.directions_for(std::pow(0.5, b)));
  return work;
}

/// The passes that bring new light come first, those that only add samples follow.
std::optional<Next> GatherSchedule::next(std::span<const proto::PassReport> done) const {
  const auto count = std::uint32_t(done.size());
  if (count == 0) return Next{Step::kDirect, {}, !needs_rays_};
  if (needs_rays_ && count < first_bounce()) {
    const bool completes = bounces_.limit() == 0 && count + 1 == first_bounce();
    return Next{count == 1 ? Step::kTrace : Step::kRefine, {}, completes};
  }
  const auto completed = completed_after(done);
  if (!completed) {
    const BouncePlan::Bounce bounce = bounces_.next(done);
    return Next{Step::kBounce, bounce, bounce.last};
  }
  if (!sampling_.wants_another(count - *completed, done.back())) return std::nullopt;
  return Next{Step::kRound, {}, true};
}

/// Returns how many passes it took until the light had all its bounces; nothing while it has not.
std::optional<std::uint32_t> GatherSchedule::completed_after(
    std::span<const proto::PassReport> done) const {
  if (!needs_rays_) return 1;
  if (bounces_.limit() == 0) return first_bounce();
  for (std::uint32_t n = first_bounce(); n < done.size(); ++n)
    if (bounces_.next(done.first(n)).last) return n + 1;
  return std::nullopt;
}

Work GatherSchedule::trace_work() const {
  return directions_work(is_coarse() ? kTracedShare : 1);
}

Work GatherSchedule::directions_work(double share_of_texels) const {
  return Work::directions(work::kDirection * set_.size() * share_of_texels);
}

Work GatherSchedule::look_up_work(std::uint32_t directions) const {
  const double look_ups = directions * (is_coarse() ? work::kGatheredShare : 1);
  return Work::other(work::kTexel + work::kLookUp * look_ups);
}

}  // namespace kiln::solver::gather
