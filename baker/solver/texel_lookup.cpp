#include "baker/solver/texel_lookup.h"

#include <array>

namespace kiln::baker {
namespace {

std::int32_t texel_at(const TextureGroup::Page& page, int x, int y) {
  if (x < 0 || y < 0 || x >= int(page.width) || y >= int(page.height)) return kNoTexel;
  return page.texel_at[std::size_t(y) * page.width + x];
}

}  // namespace

TexelLookup::TexelLookup(const Scene& scene, const Atlas& atlas, const TextureGroup& texels)
    : scene_(scene), atlas_(atlas), texels_(texels) {}

std::int32_t TexelLookup::pick(std::uint32_t triangle, Bary bary, bool back, float u) const {
  const bool double_sided = scene_.material_of(triangle).double_sided;
  if (back && !double_sided) return kNoTexel;
  const std::uint32_t chart = atlas_.triangle_chart[triangle];
  const TextureGroup::Page& page = texels_.pages[atlas_.charts[chart].page];
  const Vec2 uv = atlas_.uv_at(triangle, bary);
  const float x = std::floor(uv.x - 0.5f), y = std::floor(uv.y - 0.5f);
  const float fx = uv.x - 0.5f - x, fy = uv.y - 0.5f - y;
  const std::array<float, 4> bilinear{(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy};
  std::array<std::int32_t, 4> tap;
  std::array<float, 4> weight;
  float total = 0;
  for (int i = 0; i < 4; ++i) {
    tap[i] = texel_at(page, int(x) + (i & 1), int(y) + (i >> 1));
    const bool usable = tap[i] != kNoTexel && texels_.chart[tap[i]] == chart;
    weight[i] = usable ? bilinear[i] * texels_.coverage[tap[i]] : 0;
    total += weight[i];
  }
  std::int32_t texel = kNoTexel;
  if (total > 0) {
    float left = u * total;
    for (int i = 0; i < 4; ++i) {
      if (weight[i] == 0) continue;
      texel = tap[i];
      if (left < weight[i]) break;
      left -= weight[i];
    }
  } else {
    texel = nearest(page, chart, uv);
  }
  return texel != kNoTexel && back ? texels_.back[texel] : texel;
}

std::int32_t TexelLookup::nearest(const TextureGroup::Page& page, std::uint32_t chart,
                                  Vec2 uv) const {
  // A sliver may own no texel under its own point: another chart covered more of it.
  const int cx = int(std::floor(uv.x)), cy = int(std::floor(uv.y));
  constexpr int kReach = 2;
  std::int32_t best = kNoTexel;
  float best_distance = 0;
  for (int y = cy - kReach; y <= cy + kReach; ++y)
    for (int x = cx - kReach; x <= cx + kReach; ++x) {
      const std::int32_t texel = texel_at(page, x, y);
      if (texel == kNoTexel) continue;
      const Vec2 d = Vec2{float(x) + 0.5f, float(y) + 0.5f} - uv;
      // A texel of another chart serves only when there is none of our own.
      const float distance = dot(d, d) + (texels_.chart[texel] == chart ? 0.f : 1000.f);
      if (best == kNoTexel || distance < best_distance) best = texel, best_distance = distance;
    }
  return best;
}

}  // namespace kiln::baker
