#include "baker/solver/gather/interpolation_grid.h"

#include <limits>

namespace kiln::solver::gather {
namespace {

/// Largest difference of the sites' light over its sum.
constexpr float kAgreement = 0.06f;
/// Least cosine between the normals of a texel and of its sites.
constexpr float kSameTurn = 0.95f;

}  // namespace

CoarseSites::Sites CoarseSites::around(std::uint32_t texel) const {
  const int dx = texels_.x[texel] & 1, dy = texels_.y[texel] & 1;
  Sites sites;
  if (!dx && !dy) return sites;
  for (int k = 0; k < 4; ++k) {
    // Left and right in odd columns, above and below in odd rows, the corners in both.
    if ((!dx && (k & 1)) || (!dy && (k & 2))) continue;
    const std::int32_t site = texels_.neighbour(texel, k & 1 ? dx : -dx, k & 2 ? dy : -dy);
    if (site == atlas::kNoTexel) return {};
    if (dot(texels_.shading_normal[site], texels_.shading_normal[texel]) < kSameTurn) return {};
    sites.texel[sites.count++] = std::uint32_t(site);
  }
  return sites;
}

bool CoarseSites::agree(const Sites& sites, const lightmap::Lightmap& light) const {
  float low = std::numeric_limits<float>::infinity(), high = 0, direct = low;
  for (const std::uint32_t s : sites.all()) {
    if (light.validity[s] < 1) return false;
    const float e = luminance(light.sky[s] + light.indirect[s]);
    low = std::min(low, e), high = std::max(high, e);
    direct = std::min(direct, luminance(light.direct[s]));
  }
  return high - low <= kAgreement * (high + low + 2 * direct);
}

}  // namespace kiln::solver::gather
