#include "baker/solver/adaptive/adaptive_sampling.h"

#include <algorithm>
#include <cmath>

#include "baker/solver/adaptive/allocation.h"
#include "baker/solver/direct/direct.h"
#include "baker/solver/work.h"

namespace kiln::solver::adaptive {
namespace {

/// Light is judged against itself plus this share of the scene's mean.
constexpr float kDarkShare = 0.02f;
/// A part of the light takes more samples where it has this share of the variance or more.
constexpr float kMatters = 0.25f;
/// Power of the number of samples with which the error falls, by which rounds are chosen; and what
/// it comes to with all rounds together, by which the time that is left is told.
constexpr double kSlope = 0.65, kExpectedSlope = 0.47;
/// Doublings of one round.
constexpr double kMostDoublings = 3;
/// Texels inside other geometry have nothing to judge.
constexpr float kHidden = 0.5f;
/// By the measure rms a round aims a little below the target, or another would follow for a trifle.
constexpr double kAim = 0.97;

/// Doublings from `from` to `to` or beyond.
std::uint32_t doublings(std::uint32_t from, std::uint32_t to) {
  std::uint32_t n = 0;
  for (std::uint64_t have = from; have < to; have *= 2) ++n;
  return n;
}

/// The value that 95 of 100 don't exceed; 0 of none.
float percentile_95(std::vector<float>& values) {
  if (values.empty()) return 0;
  const auto at = values.end() - 1 - std::ptrdiff_t(values.size() / 20);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

double square(double x) {
  return x * x;
}

/// Means over a tile: luminance, and the variances that the halves tell.
struct Scatter {
  double light = 0, direct = 0, gathered = 0;
};
/// @param all_bounces factor on the indirect light
Scatter scatter_of(const lightmap::Lightmap& light, atlas::TexelRange tile, double all_bounces) {
  Scatter s;
  for (std::uint32_t t = tile.begin; t < tile.end; ++t) {
    s.light += double(luminance(light.direct[t] + light.sky[t])) +
               all_bounces * double(luminance(light.indirect[t]));
    s.direct += square(double(light.direct_spread[t]));
    s.gathered +=
        square(double(light.sky_spread[t]) + all_bounces * double(light.indirect_spread[t]));
  }
  const double n = tile.size();
  return {s.light / n, s.direct / n, s.gathered / n};
}

}  // namespace

SampleRounds::SampleRounds(const SolverInput& in, std::uint32_t directions)
    : in_(in),
      bank_(in.texels, in.scene.sky, in.filter && in.settings.method == proto::Method::kGather,
            in.lights.sky() != nullptr),
      can_add_shadow_rays_((!in.lights.area().empty() || in.lights.has_bright_sky()) &&
                           in.plan.most_shadow_rays > in.plan.shadow_rays),
      can_add_directions_((in.settings.bounces > 0 || in.scene.has_sky()) &&
                          in.plan.most_directions > directions) {
  if (can_add_shadow_rays_) limit_ = doublings(in.plan.shadow_rays, in.plan.most_shadow_rays);
  if (can_add_directions_) {
    limit_ = std::max(limit_, doublings(directions, in.plan.most_directions));
    needed_ = doublings(directions, in.plan.directions);
  }
}

bool SampleRounds::wants_another(std::span<const proto::PassReport> done) const {
  const proto::PassReport& last = done.back();
  std::uint32_t rounds = 0;
  while (rounds < done.size() && done[done.size() - 1 - rounds].name == kName) ++rounds;
  if (rounds >= limit_) return false;
  if (rounds < needed_) return true;
  if (rounds > 0 && last.rays == 0) return false;  // what is left can't be helped by samples
  return in_.plan.target_error > 0 && last.standard_error.value_or(0) > in_.plan.target_error;
}

std::uint32_t SampleRounds::more_shadow_rays(std::uint32_t had) const {
  return std::min(had, in_.plan.most_shadow_rays - std::min(had, in_.plan.most_shadow_rays));
}

std::uint32_t SampleRounds::more_directions(std::uint32_t had) const {
  // What is needed first is taken to its number, which need not be a power of two.
  const std::uint32_t most =
      had < in_.plan.directions ? in_.plan.directions : in_.plan.most_directions;
  return std::min(had, most - std::min(had, most));
}

bool SampleRounds::judge(const lightmap::Lightmap& light, const exec::Workers& workers,
                         proto::PassReport& report) {
  filtered_.reset();  // its memory first
  filtered_ = bank_.run(light, workers);
  if (!filtered_) return false;
  judged_ = &light;
  tell_errors();
  report.standard_error = in_.plan.measure == proto::ErrorMeasure::kRms ? root_mean_square(light)
                                                                        : percentile_of_all(light);
  foresee(light);
  return true;
}

float SampleRounds::shown(std::uint32_t t) const {
  return luminance(filtered_->direct[t] + filtered_->sky[t] + filtered_->indirect[t]);
}

float SampleRounds::variance(std::uint32_t t) const {
  return filtered_->direct_variance[t] + filtered_->gathered_variance[t];
}

bool SampleRounds::counts(const lightmap::Lightmap& light, std::uint32_t t) const {
  return t < in_.texels.front_count && light.validity[t] >= kHidden;
}

/// The relative error of every texel.
void SampleRounds::tell_errors() {
  const atlas::TextureGroup& texels = in_.texels;
  double sum = 0, area = 0;
  for (std::uint32_t t = 0; t < texels.front_count; ++t) {
    sum += double(texels.area_m2[t]) * double(shown(t));
    area += double(texels.area_m2[t]);
  }
  const float dark = area > 0 ? kDarkShare * float(sum / area) : 0;
  error_.assign(texels.size(), 0);
  for (std::uint32_t t = 0; t < texels.size(); ++t) {
    const float e = shown(t) + dark;
    error_[t] = e > 0 ? std::sqrt(variance(t)) / e : 0;
  }
}

double SampleRounds::percentile_of_all(const lightmap::Lightmap& light) const {
  std::vector<float> judged;
  for (std::uint32_t t = 0; t < light.size(); ++t)
    if (counts(light, t)) judged.push_back(error_[t]);
  return double(percentile_95(judged));
}

double SampleRounds::root_mean_square(const lightmap::Lightmap& light) const {
  double mean = 0, square = 0;
  std::uint32_t judged = 0;
  for (std::uint32_t t = 0; t < light.size(); ++t) {
    if (!counts(light, t)) continue;
    mean += double(shown(t)), square += double(variance(t));
    ++judged;
  }
  return mean > 0 ? std::sqrt(square * judged) / mean : 0;
}

bool SampleRounds::begin(const lightmap::Lightmap& light, const exec::Workers& workers) {
  proto::PassReport ignored;
  // A bake that goes on from a checkpoint has not judged this light yet.
  return error_.size() == light.size() || judge(light, workers, ignored);
}

std::optional<denoise::FilteredLight> SampleRounds::filtered(const lightmap::Lightmap& light,
                                                             const exec::Workers& workers) {
  // The light of the last pass has been judged, unless a bake ends early, or goes on from its end.
  if (filtered_ && judged_ == &light) return std::move(filtered_);
  return bank_.run(light, workers);
}

/// The tile's 95th percentile over the target; 0 without one.
double SampleRounds::over_target(atlas::TexelRange tile) const {
  if (!(in_.plan.target_error > 0)) return 0;
  std::vector<float> errors(error_.begin() + tile.begin, error_.begin() + tile.end);
  return double(percentile_95(errors)) / double(in_.plan.target_error);
}

SampleRounds::Doublings SampleRounds::choose(atlas::TexelRange tile,
                                             const lightmap::Lightmap& light) const {
  Doublings chosen;
  const bool needs_directions =
      can_add_directions_ && light.samples[tile.begin] < in_.plan.directions;
  if (needs_directions) chosen.directions = 1;
  const double over = over_target(tile);
  if (!(over > 1)) return chosen;
  const auto doublings =
      std::uint32_t(std::clamp(std::floor(std::log2(over) / kSlope), 1.0, kMostDoublings));
  double direct = 0, gathered = 0;
  for (std::uint32_t t = tile.begin; t < tile.end; ++t) {
    direct += double(filtered_->direct_variance[t]);
    gathered += double(filtered_->gathered_variance[t]);
  }
  const double matters = kMatters * (direct + gathered);
  if (can_add_shadow_rays_ && direct >= matters) chosen.shadow_rays = doublings;
  if (can_add_directions_ && gathered >= matters && !needs_directions)
    chosen.directions = doublings;
  return chosen;
}

/// Shadow rays and directions of one tile after the other.
std::vector<SampleRounds::Doublings> SampleRounds::by_mean_square(std::span<const Noise> tiles,
                                                                  double mean,
                                                                  double texels) const {
  const double per_ray = cost(1, 0).sum(), per_direction = cost(0, 1).sum() / gather_share();
  std::vector<SampleLot> lots;
  for (const Noise& n : tiles) {
    const double most_rays = can_add_shadow_rays_ ? in_.plan.most_shadow_rays : 0;
    // Where none gathers, the noise is that of the sites around.
    const double most_directions =
        can_add_directions_ && n.gathering > 0 ? in_.plan.most_directions : 0;
    lots.push_back({n.direct, double(n.shadow_rays), most_rays, per_ray * n.texels});
    lots.push_back(
        {n.gathered, double(n.directions), most_directions, per_direction * n.gathering});
  }
  const double allowed = square(double(in_.plan.target_error) * kAim * mean) * texels;
  const auto times = least_doublings(lots, allowed, kSlope);
  std::vector<Doublings> doublings;
  for (std::size_t i = 0; i < tiles.size(); ++i)
    doublings.push_back({times[2 * i], times[2 * i + 1]});
  return doublings;
}

std::vector<SampleRounds::Doublings> SampleRounds::to_mean_square(
    const lightmap::Lightmap& light) const {
  std::vector<Noise> tiles;
  double sum = 0, texels = 0;
  for (std::uint32_t t = 0; t < light.size(); t += kTileTexels) {
    const atlas::TexelRange tile{t, std::min(t + kTileTexels, light.size())};
    Noise& n = tiles.emplace_back(
        Noise{0, 0, double(tile.size()), 0, light.direct_samples[t], light.samples[t]});
    for (std::uint32_t i = tile.begin; i < tile.end; ++i) {
      n.gathering += light.gathers[i] != 0;
      if (!counts(light, i)) continue;
      n.direct += double(filtered_->direct_variance[i]);
      n.gathered += double(filtered_->gathered_variance[i]);
      sum += double(shown(i)), texels += 1;
    }
  }
  return by_mean_square(tiles, texels > 0 ? sum / texels : 0, texels);
}

/// What a round may do of it.
SampleRounds::Doublings SampleRounds::limited(Doublings wanted, atlas::TexelRange tile,
                                              const lightmap::Lightmap& light) const {
  constexpr auto kMost = std::uint32_t(kMostDoublings);
  Doublings d{std::min(wanted.shadow_rays, kMost), std::min(wanted.directions, kMost)};
  if (can_add_directions_ && light.samples[tile.begin] < in_.plan.directions) d.directions = 1;
  return d;
}

/// Of every texel.
Work SampleRounds::cost(Doublings times, std::uint32_t shadow_rays,
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

/// Chooses the tiles of the next round, and looks ahead.
void SampleRounds::foresee(const lightmap::Lightmap& light) {
  if (next_work_.sum() > 0) work_done_ += next_work_ + judge_work();
  next_work_ = {};
  work_before_.assign(1, 0);
  Work all;
  first_directions_.clear();
  adds_shadow_rays_ = false;
  tiles_.clear();
  const bool rms = in_.plan.measure == proto::ErrorMeasure::kRms && in_.plan.target_error > 0;
  const std::vector<Doublings> wanted = rms ? to_mean_square(light) : std::vector<Doublings>{};
  for (std::uint32_t t = 0; t < light.size(); t += kTileTexels) {
    const atlas::TexelRange tile{t, std::min(t + kTileTexels, light.size())};
    const Doublings chosen = tiles_.emplace_back(rms ? limited(wanted[t / kTileTexels], tile, light)
                                                     : choose(tile, light));
    const double share = double(tile.size()) / light.size();
    adds_shadow_rays_ = adds_shadow_rays_ || chosen.shadow_rays > 0;
    std::uint32_t had = light.samples[t];
    for (std::uint32_t i = 0; i < chosen.directions && more_directions(had) > 0; ++i) {
      first_directions_.insert(had);
      had += more_directions(had);
    }
    const Work work = cost(chosen, light.direct_samples[t], light.samples[t]);
    next_work_ += work * share;
    work_before_.push_back(next_work_.sum());
    const Work to_target =
        rms ? cost(wanted[t / kTileTexels], light.direct_samples[t], light.samples[t])
            : work_to_target(tile, light);
    all += (to_target.sum() > work.sum() ? to_target : work) * share;
  }
  if (next_work_.sum() > 0) all += judge_work();
  expected_work_ = work_done_ + all;
}

double SampleRounds::work_share(double share) const {
  if (work_before_.empty() || !(work_before_.back() > 0)) return share;
  const double at = share * double(work_before_.size() - 1);
  const auto tile = std::min(std::size_t(at), work_before_.size() - 1);
  const double next = work_before_[std::min(tile + 1, work_before_.size() - 1)];
  const double here = work_before_[tile];
  return (here + (at - double(tile)) * (next - here)) / work_before_.back();
}

Work SampleRounds::work_to_target(atlas::TexelRange tile, const lightmap::Lightmap& light) const {
  double direct = 0, gathered = 0;
  for (std::uint32_t i = tile.begin; i < tile.end; ++i)
    direct += double(filtered_->direct_variance[i]),
        gathered += double(filtered_->gathered_variance[i]);
  return work_to_target(over_target(tile), direct, gathered, light.direct_samples[tile.begin],
                        light.samples[tile.begin]);
}

/// Most texels take no directions where they are gathered coarsely.
Work SampleRounds::cost(double shadow_rays, double directions) const {
  const bool many_lights = direct::DirectLight::are_many(in_.lights);
  return Work::shadow_rays(shadow_rays * (many_lights ? work::kManyLightsRay : 1)) +
         Work::directions(directions * work::kDirection * gather_share());
}

Work SampleRounds::work_to_target(double over, double direct, double gathered,
                                  std::uint32_t shadow_rays, std::uint32_t directions) const {
  if (!(over > 1)) return {};
  const double doublings =
      std::clamp(std::log2(over) / kExpectedSlope, 1.0, double(std::max(1u, limit_)));
  const double matters = kMatters * (direct + gathered), times = std::exp2(doublings) - 1;
  const auto more = [&](bool can, double variance, std::uint32_t had, std::uint32_t most) {
    return can && variance >= matters && most > had ? std::min(times * had, double(most - had))
                                                    : 0.0;
  };
  return cost(more(can_add_shadow_rays_, direct, shadow_rays, in_.plan.most_shadow_rays),
              more(can_add_directions_, gathered, directions, in_.plan.most_directions));
}

void SampleRounds::guess(const lightmap::Lightmap& light, Known known) {
  if (!(in_.plan.target_error > 0) || light.size() == 0) return;
  // Means over scenes. What the filter leaves of the variance; how far the error that counts in a
  // tile is above its mean; all indirect light over the direct, and over the first bounce; and the
  // error of a gather by 64 directions, relative to what they bring.
  const bool many_lights = direct::DirectLight::are_many(in_.lights);
  const double left_direct = in_.filter ? (many_lights ? 0.1 : 0.25) : 1,
               left_gathered = in_.filter ? 0.12 : 1;
  constexpr double kAboveMean = 1.4, kIndirect = 0.8, kAllBounces = 1.7, kGatherError = 0.1;
  const bool bounces = in_.settings.bounces > 0;
  const double unknown = known == Known::kFirstBounce || !bounces ? 0 : kIndirect,
               all_bounces = known == Known::kFirstBounce ? kAllBounces : 1;
  const double gather_error = kGatherError * std::pow(64.0 / in_.plan.directions, 0.7);
  double mean = 0;
  for (std::uint32_t t = 0; t < light.size(); ++t)
    mean += double(luminance(light.direct[t] + light.sky[t])) / light.size();
  Work work;
  double above = 0, sum = 0;
  std::vector<Noise> tiles;
  for (std::uint32_t t = 0; t < light.size(); t += kTileTexels) {
    const atlas::TexelRange tile{t, std::min(t + kTileTexels, light.size())};
    const double share = double(tile.size()) / light.size();
    const Scatter s = scatter_of(light, tile, all_bounces);
    const double scale = s.light + (unknown + double(kDarkShare)) * mean;
    const double direct = left_direct * s.direct,
                 gathered = left_gathered * (s.gathered + square(gather_error * unknown * mean));
    const double n = tile.size();
    tiles.push_back({direct * n, gathered * n, n, gather_share() * n, in_.plan.shadow_rays,
                     in_.plan.directions});
    sum += (s.light + unknown * mean) * n;
    if (!(scale > 0)) continue;
    const double over =
        kAboveMean * std::sqrt(direct + gathered) / (scale * double(in_.plan.target_error));
    if (over > 1) above += share;
    work +=
        work_to_target(over, direct, gathered, in_.plan.shadow_rays, in_.plan.directions) * share;
  }
  if (in_.plan.measure == proto::ErrorMeasure::kRms) {
    const auto wanted = by_mean_square(tiles, sum / light.size(), light.size());
    expected_work_ = {};
    for (std::size_t i = 0; i < tiles.size(); ++i)
      expected_work_ += cost(wanted[i], in_.plan.shadow_rays, in_.plan.directions) *
                        (tiles[i].texels / light.size());
    if (expected_work_.sum() > 0) expected_work_ += judge_work();
    return;
  }
  // Five texels in a hundred may be above the target.
  expected_work_ = above > 0.05 ? work + judge_work() : Work{};
}

}  // namespace kiln::solver::adaptive
