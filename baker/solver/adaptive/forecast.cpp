#include "baker/solver/adaptive/forecast.h"

#include <cmath>
#include <vector>

#include "baker/solver/adaptive/tuned.h"
#include "baker/solver/direct/direct.h"
#include "baker/solver/emittance.h"

namespace kiln::solver::adaptive {
namespace {

double square(double x) {
  return x * x;
}

/// The means over a tile: luminance, and the variances of the halves.
struct Scatter {
  double light = 0, direct = 0, gathered = 0;
};

/// @param all_bounces factor on the indirect light
Scatter scatter_of(const lightmap::Lightmap& light, atlas::TexelRange tile, double all_bounces) {
  Scatter s;
  for (std::uint32_t t = tile.begin; t < tile.end; ++t) {
    s.light += double(luminance(light.direct[t] + light.sky[t])) +
               all_bounces * double(luminance(light.indirect[t]));
    s.direct += square(double(light.direct_difference[t]));
    s.gathered += square(double(light.sky_difference[t]) +
                         all_bounces * double(light.indirect_difference[t]));
  }
  const double n = tile.size();
  return {s.light / n, s.direct / n, s.gathered / n};
}

}  // namespace

RoundForecast::RoundForecast(const World& world, const AdaptiveSampling& sampling,
                             const SamplePlan& samples, bool smooth)
    : world_(world), sampling_(sampling), samples_(samples), smooth_(smooth) {}

void RoundForecast::see(const RoundOutlook& outlook) {
  if (next_.sum() > 0) done_ += next_ + judge_work();
  next_ = outlook.next;
  rounds_ = done_ + outlook.all;
  if (next_.sum() > 0) rounds_ += judge_work();
}

void RoundForecast::guess(const lightmap::Lightmap& light, Shows shows) {
  if (!(samples_.target_error > 0) || light.size() == 0) return;
  // 1. Assume what is usual for the light that is not known yet.
  const bool many_lights = direct::DirectLight::are_many(world_.lights);
  const double left_of_direct =
      smooth_ ? (many_lights ? tuned::kLeftOfManyLights : tuned::kLeftOfDirect) : 1;
  const double left_of_gathered = smooth_ ? tuned::kLeftOfGathered : 1;
  const bool first_bounce = shows == Shows::kFirstBounce;
  const double unknown = first_bounce || bounce_limit(world_.settings) == 0 ? 0 : tuned::kIndirect;
  const double all_bounces = first_bounce ? tuned::kAllBounces : 1;
  const double gather_error =
      tuned::kGatherError *
      std::pow(tuned::kGatherErrorDirections / samples_.directions, tuned::kGatherErrorSlope);
  double mean = 0;
  for (std::uint32_t t = 0; t < light.size(); ++t)
    mean += double(luminance(light.direct[t] + light.sky[t])) / light.size();

  // 2. Find the noise of every tile, and how far it is above the target.
  Work work;
  double above = 0, sum = 0;
  std::vector<TileNoise> tiles;
  for_tiles(light.size(), [&](atlas::TexelRange tile) {
    const double n = tile.size(), share = n / light.size();
    const Scatter s = scatter_of(light, tile, all_bounces);
    const double scale = s.light + (unknown + double(tuned::kDarkShare)) * mean;
    const double direct = left_of_direct * s.direct;
    const double gathered = left_of_gathered * (s.gathered + square(gather_error * unknown * mean));
    tiles.push_back({direct * n, gathered * n, n, sampling_.gather_share() * n,
                     samples_.shadow_rays, samples_.directions});
    sum += (s.light + unknown * mean) * n;
    if (!(scale > 0)) return;
    const double over =
        tuned::kAboveMean * std::sqrt(direct + gathered) / (scale * double(samples_.target_error));
    if (over > 1) above += share;
    work += sampling_.work_to_target(over, direct, gathered, samples_.shadow_rays,
                                     samples_.directions) *
            share;
  });

  // 3. Find what that will cost by the measure of the bake.
  if (samples_.measure == proto::ErrorMeasure::kPercentile95) {
    rounds_ = above > tuned::kMayBeAbove ? work + judge_work() : Work{};
    return;
  }
  const auto wanted = sampling_.by_mean_square(tiles, sum / light.size(), light.size());
  rounds_ = {};
  for (std::size_t i = 0; i < tiles.size(); ++i)
    rounds_ += sampling_.cost(wanted[i], samples_.shadow_rays, samples_.directions) *
               (tiles[i].texels / light.size());
  if (rounds_.sum() > 0) rounds_ += judge_work();
}

}  // namespace kiln::solver::adaptive
