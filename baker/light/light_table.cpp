#include "baker/light/light_table.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace kiln::light {
namespace {

/// The share of the choice that goes by power alone.
constexpr double kDefensiveShare = 0.02;

void put(float (&lanes)[3][16], std::size_t i, math::Vec3 v) {
  lanes[0][i] = v.x, lanes[1][i] = v.y, lanes[2][i] = v.z;
}

/// Spreads the low 21 bits of `v`, each to every third bit.
std::uint64_t spread(std::uint64_t v) {
  v &= 0x1fffff;
  v = (v | v << 32) & 0x1f00000000ffffull;
  v = (v | v << 16) & 0x1f0000ff0000ffull;
  v = (v | v << 8) & 0x100f00f00f00f00full;
  v = (v | v << 4) & 0x10c30c30c30c30c3ull;
  return (v | v << 2) & 0x1249249249249249ull;
}

/// Returns the indices of the lights, ordered by their centers along Morton's curve.
std::vector<std::uint32_t> morton_order(std::span<const AreaLight> lights) {
  math::Vec3 low{INFINITY, INFINITY, INFINITY}, high{-INFINITY, -INFINITY, -INFINITY};
  for (const AreaLight& l : lights) {
    const math::Vec3 c = l.center();
    low = {std::min(low.x, c.x), std::min(low.y, c.y), std::min(low.z, c.z)};
    high = {std::max(high.x, c.x), std::max(high.y, c.y), std::max(high.z, c.z)};
  }
  const float side = lights.empty() ? 1 : std::max(max_abs(high - low), 1e-30f);
  std::vector<std::pair<std::uint64_t, std::uint32_t>> keyed;
  for (std::uint32_t l = 0; l < lights.size(); ++l) {
    const math::Vec3 at = (lights[l].center() - low) * (float(0x1fffff) / side);
    keyed.emplace_back(spread(std::uint64_t(at.x)) | spread(std::uint64_t(at.y)) << 1 |
                           spread(std::uint64_t(at.z)) << 2,
                       l);
  }
  std::sort(keyed.begin(), keyed.end());
  std::vector<std::uint32_t> order;
  for (const auto& [key, light] : keyed) order.push_back(light);
  return order;
}

}  // namespace

LightTable::LightTable(std::span<const AreaLight> lights, std::span<const float> power_share)
    : groups_((lights.size() + 15) / 16),
      light_(morton_order(lights)),
      share_(groups_.size() * 16),
      group_share_(groups_.size()) {
  light_.resize(share_.size());
  for (std::size_t place = 0; place < lights.size(); ++place) {
    const AreaLight& light = lights[light_[place]];
    simd::LightGroup& group = groups_[place / 16];
    const std::size_t i = place % 16;
    put(group.center, i, light.center());
    put(group.normal, i, light.normal);
    for (const math::Vec3& corner : light.outline())
      group.radius[i] = std::max(group.radius[i], length(corner - light.center()));
    group.power[i] = luminance(light.radiance) * light.area_m2;
    group.back[i] = light.two_sided ? -1.f : 1.f;
    share_[place] = power_share[light_[place]];
    group_share_[place / 16] += double(share_[place]);
  }
}

LightChoice::LightChoice(const LightTable& table)
    : table_(table),
      kernels_(simd::kernels()),
      weight_(table.share().size()),
      near_(table.groups()),
      group_end_(table.groups()) {}

void LightChoice::clear() {
  std::fill(weight_.begin(), weight_.end(), 0.f);
}

void LightChoice::weigh(const simd::Viewpoint& from) {
  kernels_.weigh_lights(table_.data(), table_.groups(), from, weight_.data(), near_.data());
}

void LightChoice::finish() {
  double total = 0;
  for (std::uint32_t g = 0; g < table_.groups(); ++g) {
    // There are four chains of additions, in a fixed order: one alone would wait for each.
    double part[4] = {};
    for (std::uint32_t i = 0; i < kGroup; ++i) part[i % 4] += double(weight_[g * kGroup + i]);
    group_end_[g] = (part[0] + part[1]) + (part[2] + part[3]);
    total += group_end_[g];
  }
  by_weight_ = total > 0 ? (1 - kDefensiveShare) / total : 0;
  by_power_ = total > 0 ? kDefensiveShare : 1;
  double end = 0;
  for (std::uint32_t g = 0; g < table_.groups(); ++g)
    group_end_[g] = end += by_weight_ * group_end_[g] + by_power_ * table_.group_share()[g];
}

double LightChoice::probability(std::uint32_t place) const {
  return by_weight_ * double(weight_[place]) + by_power_ * double(table_.share()[place]);
}

LightChoice::Pick LightChoice::Walk::at(double position) {
  const auto& ends = choice_.group_end_;
  if (position >= ends[place_ / kGroup]) {
    const auto next = std::upper_bound(ends.begin() + place_ / kGroup, ends.end(), position);
    const auto g = std::min(std::size_t(next - ends.begin()), ends.size() - 1);
    place_ = std::uint32_t(g) * kGroup;
    end_ = g > 0 ? ends[g - 1] : 0;
  }
  const std::uint32_t last = place_ | (kGroup - 1);
  double p = choice_.probability(place_);
  while (place_ < last && position >= end_ + p) {
    end_ += p;
    p = choice_.probability(++place_);
  }
  return {choice_.table_.light()[place_], float(p)};
}

}  // namespace kiln::light
