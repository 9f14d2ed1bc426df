#include "baker/trace/texel_surface.h"

#include <array>

namespace kiln::trace {
namespace {

std::int32_t texel_at(const atlas::TextureGroup::Page& page, int x, int y) {
  if (x < 0 || y < 0 || x >= int(page.width) || y >= int(page.height)) return atlas::kNoTexel;
  return page.texel_at[std::size_t(y) * page.width + x];
}

}  // namespace

TexelLookup::TexelLookup(const scene::Scene& scene, const atlas::Atlas& atlas,
                         const atlas::TextureGroup& texels)
    : scene_(scene), atlas_(atlas), texels_(texels) {
  fill_grid();
}

void TexelLookup::fill_grid() {
  constexpr float kFull = 0.999f;
  width_ = std::int32_t(atlas_.page_size);
  for (const atlas::TextureGroup::Page& page : texels_.pages)
    cells_.insert(cells_.end(), page.texel_at.begin(), page.texel_at.end());
  const auto full = [&](std::int32_t cell, std::uint32_t chart) {
    const std::int32_t t = cell & (simd::TexelGrid::kWhole - 1);
    return cell != atlas::kNoTexel && texels_.chart[t] == chart && texels_.coverage[t] > kFull;
  };
  const std::int32_t per_page = width_ * width_;
  for (std::int32_t c = 0; c < std::int32_t(cells_.size()); ++c) {
    const std::int32_t x = c % width_, y = c % per_page / width_;
    if (cells_[c] == atlas::kNoTexel || x + 1 >= width_ || y + 1 >= width_) continue;
    const std::uint32_t chart = texels_.chart[cells_[c]];
    if (full(cells_[c], chart) && full(cells_[c + 1], chart) && full(cells_[c + width_], chart) &&
        full(cells_[c + width_ + 1], chart))
      cells_[c] |= simd::TexelGrid::kWhole;
  }
  for (std::uint32_t t = 0; t < scene_.triangles.size(); ++t) {
    const auto& v = atlas_.triangles[t];
    const math::Vec2 p = atlas_.vertices[v[0]].uv, e1 = atlas_.vertices[v[1]].uv - p,
                     e2 = atlas_.vertices[v[2]].uv - p;
    triangles_.push_back({{p.x, p.y},
                          {e1.x, e1.y},
                          {e2.x, e2.y},
                          std::int32_t(atlas_.page_of(t)) * per_page,
                          scene_.material_of(t).double_sided});
  }
}

std::int32_t TexelLookup::pick(std::uint32_t triangle, scene::Bary bary, bool back, float u) const {
  const bool double_sided = scene_.material_of(triangle).double_sided;
  if (back && !double_sided) return atlas::kNoTexel;
  const std::uint32_t chart = atlas_.triangle_chart[triangle];
  const atlas::TextureGroup::Page& page = texels_.pages[atlas_.charts[chart].page];
  const math::Vec2 uv = atlas_.uv_at(triangle, bary);
  const float x = std::floor(uv.x - 0.5f), y = std::floor(uv.y - 0.5f);
  const float fx = uv.x - 0.5f - x, fy = uv.y - 0.5f - y;
  const std::array<float, 4> bilinear{(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy};
  std::array<std::int32_t, 4> tap;
  std::array<float, 4> weight;
  float total = 0;
  for (int i = 0; i < 4; ++i) {
    tap[i] = texel_at(page, int(x) + (i & 1), int(y) + (i >> 1));
    const bool usable = tap[i] != atlas::kNoTexel && texels_.chart[tap[i]] == chart;
    weight[i] = usable ? bilinear[i] * texels_.coverage[tap[i]] : 0;
    total += weight[i];
  }
  std::int32_t texel = atlas::kNoTexel;
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
  return texel != atlas::kNoTexel && back ? texels_.back[texel] : texel;
}

std::int32_t TexelLookup::nearest(const atlas::TextureGroup::Page& page, std::uint32_t chart,
                                  math::Vec2 uv) const {
  // A sliver may own no texel under its own point: another chart covered more of it.
  const int cx = int(std::floor(uv.x)), cy = int(std::floor(uv.y));
  constexpr int kReach = 2;
  std::int32_t best = atlas::kNoTexel;
  float best_distance = 0;
  for (int y = cy - kReach; y <= cy + kReach; ++y)
    for (int x = cx - kReach; x <= cx + kReach; ++x) {
      const std::int32_t texel = texel_at(page, x, y);
      if (texel == atlas::kNoTexel) continue;
      const math::Vec2 d = math::Vec2{float(x) + 0.5f, float(y) + 0.5f} - uv;
      // A texel of another chart serves only when there is none of our own.
      const float distance = dot(d, d) + (texels_.chart[texel] == chart ? 0.f : 1000.f);
      if (best == atlas::kNoTexel || distance < best_distance)
        best = texel, best_distance = distance;
    }
  return best;
}

}  // namespace kiln::trace
