#include "baker/solver/radiosity_map/series.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "baker/solver/emittance.h"

namespace kiln::solver::radiosity_map {
namespace {

/// Samples of direct light are taken in packets of this many.
constexpr std::uint32_t kDirectRun = 16;
/// Iterations before which the error is not judged, where it can end the bake.
constexpr std::uint32_t kFirstLook = 64;
/// Directions that find what is hidden where no sky asks for more.
constexpr std::uint32_t kProbeDirections = 16;

std::uint32_t first_direct(const proto::SolverSettings& settings, const SamplePlan& plan) {
  return std::min(settings.initial_samples, plan.shadow_rays);
}

/// Returns whether the error is judged after so many iterations: four times in each doubling.
bool looks_after(std::uint32_t iterations) {
  return iterations >= kFirstLook && iterations % (std::bit_floor(iterations) / 4) == 0;
}

}  // namespace

std::uint32_t kept_directions(const proto::SolverSettings& settings, const SamplePlan& plan,
                              double texels) {
  if (settings.series != proto::Series::kAveraged || bounce_limit(settings) == 0) return 0;
  const double budget = double(settings.hit_memory_mib) * double(1u << 20);
  const double fitting = budget / (sizeof(std::uint32_t) * std::max(1.0, texels));
  const auto most = std::uint32_t(std::clamp(fitting, 1.0, double(kKeptDirections)));
  return std::bit_floor(std::min(most, plan.directions));
}

std::vector<Step> averaged_steps(const proto::SolverSettings& settings, const SamplePlan& plan,
                                 double texels) {
  const std::uint32_t limit = plan.directions, direct_limit = plan.shadow_rays;
  const bool bounces = bounce_limit(settings) > 0;
  const std::uint32_t initial = first_direct(settings, plan);
  const std::uint32_t kept =
      bounces ? kept_directions(settings, plan, texels) : std::min(limit, kKeptDirections);
  std::vector<Step> steps(2);
  steps[0].name = "direct";
  steps[0].direct = {0, initial};
  steps[1].name = "trace";
  steps[1].trace = {0, kept};
  steps[1].keeps_hits = bounces;
  steps[1].probes = steps[1].finds_sky = true;
  std::uint32_t lit = initial;
  for (std::uint32_t done = bounces ? 0 : kept; done < limit;) {
    std::uint32_t count = bounces ? std::bit_floor(std::max(1u, done / kGrowth)) : kKeptDirections;
    count = std::min(count, (done < kept ? kept : limit) - done);
    Step step;
    step.name = bounces ? "iterations" : "trace";
    if (bounces) step.read = {done, count};
    if (done >= kept) step.trace = {done, count}, step.finds_sky = true;
    done += count;
    const std::uint32_t wanted = std::min(direct_limit, initial + done / kDirectRun * kDirectRun);
    step.direct = {lit, wanted - lit};
    lit = wanted;
    step.completes = plan.target_error > 0 && looks_after(done);
    steps.push_back(step);
  }
  if (lit < direct_limit) {
    Step& rest = steps.emplace_back();
    rest.name = "direct";
    rest.direct = {lit, direct_limit - lit};
  }
  steps.back().completes = true;
  return steps;
}

std::vector<Step> unbiased_beginning(const proto::SolverSettings& settings, const SamplePlan& plan,
                                     bool has_sky) {
  const std::uint32_t initial = first_direct(settings, plan), all = plan.shadow_rays;
  std::vector<Step> steps(1);
  steps[0].name = "direct";
  steps[0].direct = {0, initial};
  Step& rest = steps.emplace_back();
  rest.name = "trace";
  rest.direct = {initial, all - initial};
  rest.trace = {0, has_sky ? plan.directions : std::min(plan.directions, kProbeDirections)};
  rest.finds_sky = rest.probes = true;
  rest.completes = bounce_limit(settings) == 0;
  return steps;
}

Step unbiased_bounce(const SamplePlan& plan, std::uint32_t bounce) {
  Step step;
  step.name = "bounce";
  const std::uint32_t count = plan.directions;
  // Runs that begin at a multiple of a power of two are nets.
  step.trace = step.read = {std::bit_ceil(count) * (bounce + 1), count};
  return step;
}

std::vector<double> series_shares(std::span<const Step> steps, std::uint32_t orders) {
  std::vector<double> share(orders + 1, 0.0);
  share[0] = 1;
  for (const Step& step : steps) {
    if (step.read.count == 0) continue;
    const double before = step.read.first, more = step.read.count;
    for (std::uint32_t k = orders; k > 0; --k)
      share[k] = (before * share[k] + more * share[k - 1]) / (before + more);
  }
  return share;
}

double missing_share(std::span<const Step> steps, double albedo, std::uint32_t behind) {
  constexpr std::uint32_t kOrders = 512;
  const std::vector<double> share = series_shares(steps, kOrders + behind);
  double arrived = 0, order = 1 - albedo;
  for (const double s : std::span(share).subspan(behind)) arrived += s * order, order *= albedo;
  return 1 - arrived;
}

}  // namespace kiln::solver::radiosity_map
