#include "baker/solver/gather/interpolation_grid.h"

#include <algorithm>
#include <limits>

namespace kiln::solver::gather {
namespace {

/// The largest difference of the sites' light over its sum.
constexpr float kAgreement = 0.06f;
/// The least cosine between the normals of a texel and of its sites.
constexpr float kSameTurn = 0.95f;

}  // namespace

InterpolationGrid::Sites InterpolationGrid::around(std::uint32_t texel) const {
  const int dx = texels_.x[texel] & 1, dy = texels_.y[texel] & 1;
  Sites sites;
  if (!dx && !dy) return sites;
  for (int k = 0; k < 4; ++k) {
    // The sites are left and right in odd columns, above and below in odd rows, the corners in
    // both.
    if ((!dx && (k & 1)) || (!dy && (k & 2))) continue;
    const std::int32_t site = texels_.neighbor(texel, k & 1 ? dx : -dx, k & 2 ? dy : -dy);
    if (site == atlas::kNoTexel) return {};
    if (dot(texels_.shading_normal[site], texels_.shading_normal[texel]) < kSameTurn) return {};
    sites.texel[sites.count++] = std::uint32_t(site);
  }
  return sites;
}

bool InterpolationGrid::agree(const Sites& sites, const lightmap::Lightmap& light) const {
  float low = std::numeric_limits<float>::infinity(), high = 0, direct = low;
  for (const std::uint32_t s : sites.all()) {
    if (light.validity[s] < 1) return false;
    const float e = luminance(light.sky[s] + light.indirect[s]);
    low = std::min(low, e), high = std::max(high, e);
    direct = std::min(direct, luminance(light.direct[s]));
  }
  return high - low <= kAgreement * (high + low + 2 * direct);
}

bool InterpolationGrid::interpolate(lightmap::Lightmap& light, bool sky_too, std::uint32_t samples,
                                    const exec::Workers& workers) const {
  constexpr std::uint32_t kRunTexels = 4096;
  const auto fill = [](std::uint32_t t, const Sites& sites, auto& plane) {
    auto sum = plane[sites.texel[0]];
    for (const std::uint32_t s : sites.all().subspan(1)) sum += plane[s];
    plane[t] = sum * (1 / float(sites.count));
  };
  return workers.for_runs(texels_.size(), kRunTexels, [&](auto begin, auto end) {
    for (std::uint32_t t = begin; t < end; ++t) {
      if (light.is_gathered(t)) continue;
      const Sites sites = around(t);
      fill(t, sites, light.indirect);
      fill(t, sites, light.indirect_difference);
      if (!sky_too) continue;
      fill(t, sites, light.sky);
      fill(t, sites, light.sky_difference);
      light.samples[t] = std::max(light.samples[t], samples);
    }
  });
}

}  // namespace kiln::solver::gather
