#include "baker/solver/sample_rounds.h"

#include <algorithm>
#include <cmath>

#include "baker/solver/work.h"

namespace kiln::baker {
namespace {

/// Light is judged against itself plus this share of the scene's mean.
constexpr float kDarkShare = 0.02f;
/// A part of the light takes more samples where it has this share of the variance or more.
constexpr float kMatters = 0.25f;
/// Power of the number of samples with which the error falls, about; and at worst, by which the
/// time that is left is told.
constexpr double kSlope = 0.65, kWorstSlope = 0.55;
/// Doublings of one round.
constexpr double kMostDoublings = 3;
/// Texels inside other geometry have nothing to judge.
constexpr float kHidden = 0.5f;

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

bool SampleRounds::judge(const Lightmap& light, const Workers& workers, proto::PassReport& report) {
  filtered_.reset();  // its memory first
  filtered_ = bank_.run(light, workers);
  if (!filtered_) return false;
  judged_ = &light;
  const TextureGroup& texels = in_.texels;
  const auto shown = [&](std::uint32_t t) {
    return luminance(filtered_->direct[t] + filtered_->sky[t] + filtered_->indirect[t]);
  };
  double sum = 0, area = 0;
  for (std::uint32_t t = 0; t < texels.front_count; ++t) {
    sum += double(texels.area_m2[t]) * shown(t);
    area += texels.area_m2[t];
  }
  const float dark = area > 0 ? kDarkShare * float(sum / area) : 0;
  error_.assign(texels.size(), 0);
  std::vector<float> judged;
  for (std::uint32_t t = 0; t < texels.size(); ++t) {
    const float e = shown(t) + dark;
    const float variance = filtered_->direct_variance[t] + filtered_->gathered_variance[t];
    error_[t] = e > 0 ? std::sqrt(variance) / e : 0;
    if (t < texels.front_count && light.validity[t] >= kHidden) judged.push_back(error_[t]);
  }
  report.standard_error = percentile_95(judged);
  foresee(light);
  return true;
}

bool SampleRounds::begin(const Lightmap& light, const Workers& workers) {
  proto::PassReport ignored;
  // A bake that goes on from a checkpoint has not judged this light yet.
  return error_.size() == light.size() || judge(light, workers, ignored);
}

std::optional<FilteredLight> SampleRounds::filtered(const Lightmap& light, const Workers& workers) {
  // The light of the last pass has been judged, unless a bake ends early, or goes on from its end.
  if (filtered_ && judged_ == &light) return std::move(filtered_);
  return bank_.run(light, workers);
}

/// The tile's 95th percentile over the target; 0 without one.
double SampleRounds::over_target(TexelRange tile) const {
  if (!(in_.plan.target_error > 0)) return 0;
  std::vector<float> errors(error_.begin() + tile.begin, error_.begin() + tile.end);
  return double(percentile_95(errors)) / double(in_.plan.target_error);
}

SampleRounds::Doublings SampleRounds::choose(TexelRange tile, const Lightmap& light) const {
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

/// Chooses the tiles of the next round, and looks ahead.
void SampleRounds::foresee(const Lightmap& light) {
  work_done_ += next_work_;
  next_work_ = 0;
  double all = 0;
  first_directions_.clear();
  adds_shadow_rays_ = false;
  tiles_.clear();
  for (std::uint32_t t = 0; t < light.size(); t += kTileTexels) {
    const TexelRange tile{t, std::min(t + kTileTexels, light.size())};
    const Doublings chosen = tiles_.emplace_back(choose(tile, light));
    const double share = double(tile.size()) / light.size();
    double work = 0;
    adds_shadow_rays_ = adds_shadow_rays_ || chosen.shadow_rays > 0;
    std::uint32_t had = light.direct_samples[t];
    for (std::uint32_t i = 0; i < chosen.shadow_rays; ++i) {
      work += share * cost(more_shadow_rays(had), 0);
      had += more_shadow_rays(had);
    }
    had = light.samples[t];
    for (std::uint32_t i = 0; i < chosen.directions && more_directions(had) > 0; ++i) {
      first_directions_.insert(had);
      work += share * cost(0, more_directions(had));
      had += more_directions(had);
    }
    next_work_ += work;
    all += work * std::exp2(doublings_left(tile));
  }
  if (next_work_ > 0) next_work_ += work::kFilter, all += work::kFilter;
  expected_work_ = work_done_ + all;
}

/// In shadow rays per texel. Most texels take no directions where they are gathered coarsely.
double SampleRounds::cost(std::uint32_t shadow_rays, std::uint32_t directions) const {
  constexpr double kGatherShare = 0.45;
  return shadow_rays + directions * work::kDirection * (in_.plan.coarse ? kGatherShare : 1);
}

void SampleRounds::guess(const Lightmap& light) {
  // About what the filter leaves of the variance, how bright the indirect light will be against the
  // direct, and how far the error that counts in a tile is above its mean.
  const double left_direct = in_.filter ? 0.6 : 1, left_gathered = in_.filter ? 0.2 : 1;
  constexpr double kIndirect = 0.3, kAboveMean = 1.4;
  if (!(in_.plan.target_error > 0) || light.size() == 0) return;
  double mean = 0;
  for (std::uint32_t t = 0; t < light.size(); ++t)
    mean += double(luminance(light.irradiance(t))) / light.size();
  struct Tile {
    double share, over, extra;
  };
  std::vector<Tile> tiles;
  double over_target = 0;
  for (std::uint32_t t = 0; t < light.size(); t += kTileTexels) {
    const TexelRange tile{t, std::min(t + kTileTexels, light.size())};
    const double n = tile.size(), share = n / light.size();
    double e = 0, direct = 0, gathered = 0;
    for (std::uint32_t i = tile.begin; i < tile.end; ++i) {
      e += double(luminance(light.irradiance(i))) / n;
      direct += left_direct * std::pow(double(light.direct_spread[i]), 2) / n;
      gathered +=
          left_gathered * std::pow(double(light.sky_spread[i] + light.indirect_spread[i]), 2) / n;
    }
    const double scale = e + (kIndirect + double(kDarkShare)) * mean;
    const double over = scale > 0 ? kAboveMean * std::sqrt(direct + gathered) /
                                        (scale * double(in_.plan.target_error))
                                  : 0;
    const double matters = double(kMatters) * (direct + gathered);
    const double times = std::exp2(std::ceil(std::log2(std::max(1.0, over)) / kWorstSlope)) - 1;
    const auto more = [&](bool can, double variance, std::uint32_t had, std::uint32_t most) {
      return can && variance >= matters ? std::min(times * had, double(most - had)) : 0.0;
    };
    const double rays = more(can_add_shadow_rays_, direct, in_.plan.shadow_rays,
                             in_.plan.most_shadow_rays),
                 directions = more(can_add_directions_, gathered, in_.plan.directions,
                                   in_.plan.most_directions);
    tiles.push_back({share, over, cost(std::uint32_t(rays), std::uint32_t(directions))});
    if (over > 1) over_target += share;
  }
  expected_work_ = 0;
  if (over_target <= 0.05) return;  // of the texels, that many may be
  for (const Tile& tile : tiles)
    if (tile.over > 1) expected_work_ += tile.share * tile.extra;
  expected_work_ += work::kFilter;
}

/// Doublings of a tile that rounds after the next one will have to make, as far as can be foreseen.
double SampleRounds::doublings_left(TexelRange tile) const {
  const double over = over_target(tile);
  if (!(over > 1)) return 0;
  return std::max(0.0, std::min(std::log2(over) / kWorstSlope, double(limit_)) - kMostDoublings);
}

}  // namespace kiln::baker
