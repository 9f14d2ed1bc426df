#include "baker/solver/adaptive/rounds.h"

#include <algorithm>
#include <cmath>

#include "baker/solver/adaptive/allocation.h"
#include "baker/solver/adaptive/tuned.h"
#include "baker/solver/direct/direct.h"
#include "baker/solver/emittance.h"

namespace kiln::solver::adaptive {
namespace {

/// Returns the doublings from `from` to `to` or beyond.
std::uint32_t doublings(std::uint32_t from, std::uint32_t to) {
  std::uint32_t n = 0;
  for (std::uint64_t have = from; have < to; have *= 2) ++n;
  return n;
}

double square(double x) {
  return x * x;
}

/// The variances of direct and of gathered light, summed over a tile.
struct Variances {
  double direct = 0, gathered = 0;

  Variances(const Judgement& judgement, atlas::TexelRange tile) {
    for (std::uint32_t t = tile.begin; t < tile.end; ++t) {
      direct += double(judgement.filtered.direct_variance[t]);
      gathered += double(judgement.filtered.gathered_variance[t]);
    }
  }
};

}  // namespace

AdaptiveSampling::AdaptiveSampling(const World& world, const SamplePlan& samples)
    : world_(world),
      samples_(samples),
      can_add_shadow_rays_((!world.lights.area().empty() || world.lights.has_bright_sky()) &&
                           samples.most_shadow_rays > samples.shadow_rays),
      can_add_directions_((bounce_limit(world.settings) > 0 || world.scene.has_sky()) &&
                          samples.most_directions > samples.followed_first()) {
  if (can_add_shadow_rays_) limit_ = doublings(samples.shadow_rays, samples.most_shadow_rays);
  if (can_add_directions_) {
    limit_ = std::max(limit_, doublings(samples.followed_first(), samples.most_directions));
    needed_ = doublings(samples.followed_first(), samples.directions);
  }
}

bool AdaptiveSampling::wants_another(std::uint32_t rounds, const proto::PassReport& last) const {
  if (rounds >= limit_) return false;
  if (rounds < needed_) return true;
  if (rounds > 0 && last.rays == 0) return false;  // samples can't lower what is left
  return samples_.target_error > 0 && last.standard_error.value_or(0) > samples_.target_error;
}

std::uint32_t AdaptiveSampling::more_shadow_rays(std::uint32_t had) const {
  return std::min(had, samples_.most_shadow_rays - std::min(had, samples_.most_shadow_rays));
}

std::uint32_t AdaptiveSampling::more_directions(std::uint32_t had) const {
  // The first directions are taken up to their number, which need not be a power of two.
  const std::uint32_t most =
      had < samples_.directions ? samples_.directions : samples_.most_directions;
  return std::min(had, most - std::min(had, most));
}

bool AdaptiveSampling::goes_by_rms() const {
  return samples_.measure == proto::ErrorMeasure::kRms && samples_.target_error > 0;
}

/// Returns the tile's 95th percentile over the target; 0 without a target.
double AdaptiveSampling::over_target(const Judgement& judgement, atlas::TexelRange tile) const {
  if (!(samples_.target_error > 0)) return 0;
  std::vector<float> errors(judgement.error.begin() + tile.begin,
                            judgement.error.begin() + tile.end);
  return double(percentile_95(errors)) / double(samples_.target_error);
}

WantedDoublings AdaptiveSampling::choose_by_percentile(const Judgement& judgement,
                                                       atlas::TexelRange tile,
                                                       const lightmap::Lightmap& light) const {
  WantedDoublings chosen;
  const bool needs_directions =
      can_add_directions_ && light.samples[tile.begin] < samples_.directions;
  if (needs_directions) chosen.directions = 1;
  const double over = over_target(judgement, tile);
  if (!(over > 1)) return chosen;
  const auto times = std::uint32_t(
      std::clamp(std::floor(std::log2(over) / tuned::kSlope), 1.0, tuned::kMostDoublings));
  const Variances noise(judgement, tile);
  const double least = tuned::kMinVarianceShare * (noise.direct + noise.gathered);
  if (can_add_shadow_rays_ && noise.direct >= least) chosen.shadow_rays = times;
  if (can_add_directions_ && noise.gathered >= least && !needs_directions)
    chosen.directions = times;
  return chosen;
}

/// The units are the shadow rays and the directions of one tile after the other.
std::vector<WantedDoublings> AdaptiveSampling::by_mean_square(std::span<const TileNoise> tiles,
                                                              double mean, double texels) const {
  const double per_ray = cost(1, 0).sum(), per_direction = cost(0, 1).sum() / gather_share();
  std::vector<AllocationUnit> units;
  for (const TileNoise& n : tiles) {
    const double most_rays = can_add_shadow_rays_ ? samples_.most_shadow_rays : 0;
    // When no texel of the tile gathers, the noise is that of the texels around.
    const double most_directions =
        can_add_directions_ && n.gathering > 0 ? samples_.most_directions : 0;
    units.push_back({n.direct, double(n.shadow_rays), most_rays, per_ray * n.texels});
    units.push_back(
        {n.gathered, double(n.directions), most_directions, per_direction * n.gathering});
  }
  const double allowed =
      square(double(samples_.target_error) * tuned::kTargetMargin * mean) * texels;
  const auto times = allocate_samples(units, allowed, tuned::kSlope);
  std::vector<WantedDoublings> wanted;
  for (std::size_t i = 0; i < tiles.size(); ++i) wanted.push_back({times[2 * i], times[2 * i + 1]});
  return wanted;
}

std::vector<WantedDoublings> AdaptiveSampling::choose_by_mean_square(
    const Judgement& judgement, const lightmap::Lightmap& light) const {
  std::vector<TileNoise> tiles;
  double sum = 0, texels = 0;
  for_tiles(light.size(), [&](atlas::TexelRange tile) {
    TileNoise& n = tiles.emplace_back(TileNoise{
        0, 0, double(tile.size()), 0, light.direct_samples[tile.begin], light.samples[tile.begin]});
    for (std::uint32_t i = tile.begin; i < tile.end; ++i) {
      n.gathering += light.is_gathered(i);
      if (!is_judged(world_, light, i)) continue;
      n.direct += double(judgement.filtered.direct_variance[i]);
      n.gathered += double(judgement.filtered.gathered_variance[i]);
      sum += double(judgement.luminance_of(i)), texels += 1;
    }
  });
  return by_mean_square(tiles, texels > 0 ? sum / texels : 0, texels);
}

/// Returns the part of it that one round may do.
WantedDoublings AdaptiveSampling::limited(WantedDoublings wanted, atlas::TexelRange tile,
                                          const lightmap::Lightmap& light) const {
  constexpr auto kMost = std::uint32_t(tuned::kMostDoublings);
  WantedDoublings d{std::min(wanted.shadow_rays, kMost), std::min(wanted.directions, kMost)};
  if (can_add_directions_ && light.samples[tile.begin] < samples_.directions) d.directions = 1;
  return d;
}

Work AdaptiveSampling::cost(WantedDoublings times, std::uint32_t shadow_rays,
                            std::uint32_t directions) const {
  Work work;
  for (std::uint32_t i = 0; i < times.shadow_rays; ++i) {
    work += cost(more_shadow_rays(shadow_rays), 0);
    shadow_rays += more_shadow_rays(shadow_rays);
  }
  for (std::uint32_t i = 0; i < times.directions; ++i) {
    work += cost(0, more_directions(directions));
    directions += more_directions(directions);
  }
  return work;
}

RoundOutlook AdaptiveSampling::choose(const Judgement& judgement, lightmap::Lightmap& light) const {
  RoundOutlook outlook;
  const bool rms = goes_by_rms();
  const auto wanted =
      rms ? choose_by_mean_square(judgement, light) : std::vector<WantedDoublings>{};
  light.doublings.clear();
  for_tiles(light.size(), [&](atlas::TexelRange tile) {
    const std::uint32_t t = tile.begin;
    const WantedDoublings chosen = rms ? limited(wanted[t / kSampleTileTexels], tile, light)
                                       : choose_by_percentile(judgement, tile, light);
    for (std::uint32_t i = tile.begin; i < tile.end; ++i)
      light.doublings[i] = {std::uint8_t(chosen.shadow_rays), std::uint8_t(chosen.directions)};
    const double share = double(tile.size()) / light.size();
    const Work work =
        cost(chosen, std::as_const(light).direct_samples[t], std::as_const(light).samples[t]);
    const Work to_target =
        rms ? cost(wanted[t / kSampleTileTexels], std::as_const(light).direct_samples[t],
                   std::as_const(light).samples[t])
            : work_to_target(judgement, tile, light);
    outlook.next += work * share;
    outlook.all += (to_target.sum() > work.sum() ? to_target : work) * share;
  });
  return outlook;
}

Work AdaptiveSampling::work_to_target(const Judgement& judgement, atlas::TexelRange tile,
                                      const lightmap::Lightmap& light) const {
  const Variances noise(judgement, tile);
  return work_to_target(over_target(judgement, tile), noise.direct, noise.gathered,
                        light.direct_samples[tile.begin], light.samples[tile.begin]);
}

Work AdaptiveSampling::cost(double shadow_rays, double directions) const {
  const bool many_lights = direct::DirectLight::are_many(world_.lights);
  return Work::shadow_rays(shadow_rays * (many_lights ? work::kManyLightsRay : 1)) +
         Work::directions(directions * work::kDirection * gather_share());
}

Work AdaptiveSampling::work_to_target(double over, double direct, double gathered,
                                      std::uint32_t shadow_rays, std::uint32_t directions) const {
  if (!(over > 1)) return {};
  const double times = std::exp2(std::clamp(std::log2(over) / tuned::kExpectedSlope, 1.0,
                                            double(std::max(1u, limit_)))) -
                       1;
  const double least = tuned::kMinVarianceShare * (direct + gathered);
  const auto more = [&](bool can, double variance, std::uint32_t had, std::uint32_t most) {
    return can && variance >= least && most > had ? std::min(times * had, double(most - had)) : 0.0;
  };
  return cost(more(can_add_shadow_rays_, direct, shadow_rays, samples_.most_shadow_rays),
              more(can_add_directions_, gathered, directions, samples_.most_directions));
}

}  // namespace kiln::solver::adaptive
