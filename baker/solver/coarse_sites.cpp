#include "baker/solver/coarse_sites.h"

#include <limits>

namespace kiln::baker {
namespace {

/// Largest difference of the sites' light over its sum.
constexpr float kAgreement = 0.06f;
/// Least cosine between the normals of a texel and of its sites.
constexpr float kSameTurn = 0.95f;

}  // namespace

CoarseSites::Sites CoarseSites::around(std::uint32_t texel) const {
  const bool back = texels_.is_back(texel);
  const int x = texels_.x[texel], y = texels_.y[texel];
  const int dx = x & 1, dy = y & 1;
  Sites sites;
  if (!dx && !dy) return sites;
  const TextureGroup::Page& page = texels_.pages[texels_.page[texel]];
  for (int k = 0; k < 4; ++k) {
    // Left and right in odd columns, above and below in odd rows, the corners in both.
    if ((!dx && (k & 1)) || (!dy && (k & 2))) continue;
    const int sx = x + (k & 1 ? dx : -dx), sy = y + (k & 2 ? dy : -dy);
    if (sx < 0 || sy < 0 || sx >= int(page.width) || sy >= int(page.height)) return {};
    std::int32_t site = page.texel_at[std::size_t(sy) * page.width + sx];
    if (site != kNoTexel && back) site = texels_.back[site];
    if (site == kNoTexel || texels_.chart[site] != texels_.chart[texel]) return {};
    if (dot(texels_.shading_normal[site], texels_.shading_normal[texel]) < kSameTurn) return {};
    sites.texel[sites.count++] = std::uint32_t(site);
  }
  return sites;
}

bool CoarseSites::agree(const Sites& sites, const Lightmap& light) const {
  float low = std::numeric_limits<float>::infinity(), high = 0, direct = low;
  for (const std::uint32_t s : sites.all()) {
    if (light.validity[s] < 1) return false;
    const float e = luminance(light.sky[s] + light.indirect[s]);
    low = std::min(low, e), high = std::max(high, e);
    direct = std::min(direct, luminance(light.direct[s]));
  }
  return high - low <= kAgreement * (high + low + 2 * direct);
}

}  // namespace kiln::baker
