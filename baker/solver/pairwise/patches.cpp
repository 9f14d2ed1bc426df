#include "baker/solver/pairwise/patches.h"

#include <algorithm>
#include <bit>

#include "baker/sampling/sobol.h"
#include "baker/solver/hidden_points.h"
#include "baker/solver/pairwise/pairwise.h"

namespace kiln::solver::pairwise {
namespace {

constexpr std::uint32_t kLook = 4096;  ///< texels between two looks at the stop token

Point point_of(const Footprint& at, std::uint32_t i) {
  return {at.position[i], at.origin[i], at.geometric_normal[i], at.shading_normal[i]};
}

/// Returns that of the points in view which is nearest to their mean.
Point visible_middle(const Footprint& at, std::uint32_t hidden) {
  math::Vec3 mean;
  float count = 0;
  for (std::uint32_t i = 0; i < Patches::kPoints; ++i)
    if (!(hidden >> i & 1)) mean += at.position[i], ++count;
  mean = mean * (1 / count);
  std::uint32_t best = Patches::kPoints;
  float least = 0;
  for (std::uint32_t i = 0; i < Patches::kPoints; ++i) {
    const math::Vec3 way = at.position[i] - mean;
    if (hidden >> i & 1 || (best < Patches::kPoints && dot(way, way) >= least)) continue;
    best = i, least = dot(way, way);
  }
  return point_of(at, best);
}

}  // namespace

Patches::Patches(const World& world, std::uint32_t pair_samples, const std::stop_token& stop)
    : texels_(world.texels),
      pair_samples_(pair_samples),
      window_(std::int32_t(window_texels(world.settings, world.atlas.page_size))),
      seed_(sampling::hash(std::uint32_t(world.settings.seed),
                           std::uint32_t(world.settings.seed >> 32))),
      patches_(pair_samples == 1 ? size() : 0) {
  if (pair_samples > 1) points_.reserve(std::size_t(size()) * kPoints);
  visible_share_.reserve(size());
  for (std::uint32_t t = 0; t < size(); ++t) {
    if (t % kLook == 0 && stop.stop_requested()) return;
    const Footprint at(world, t);
    const std::uint32_t hidden = hidden_points(world, at);
    visible_share_.push_back(1 - float(std::popcount(hidden)) / kPoints);
    if (pair_samples == 1)
      patches_.set(t, {middle_of(world, t, at, hidden), texels_.area_m2[t], visible_share_[t],
                       std::int32_t(texels_.chart[t]), texels_.x[t], texels_.y[t]});
    else
      for (std::uint32_t i = 0; i < kPoints; ++i) points_.push_back(point_of(at, i));
  }
}

double Patches::memory_per_texel(std::uint32_t pair_samples) {
  return (pair_samples == 1 ? PatchColumns::kBytes : double(sizeof(Point)) * kPoints) +
         sizeof(float);
}

Point Patches::middle_of(const World& world, std::uint32_t texel, const Footprint& at,
                         std::uint32_t hidden) const {
  constexpr std::uint32_t kAll = (1u << kPoints) - 1;
  if (hidden != 0 && hidden != kAll) return visible_middle(at, hidden);
  const std::uint32_t triangle = texels_.triangle[texel];
  const float side = texels_.is_back(texel) ? -1.f : 1.f;
  Point p;
  p.position = texels_.position[texel];
  p.geometric_normal = side * geometric_normal(world.scene, triangle);
  p.shading_normal = texels_.shading_normal[texel];
  if (dot(p.shading_normal, p.geometric_normal) < 0) p.shading_normal = -p.shading_normal;
  p.origin = world.rays.offset_origin(p.position, p.geometric_normal,
                                      position_at(world.scene, triangle, scene::kCentroid));
  return p;
}

Point Patches::middle(std::uint32_t texel) const {
  Point p = point(texel, 0);
  p.origin += texels_.position[texel] - p.position;
  p.position = texels_.position[texel];
  return p;
}

std::uint32_t Patches::pair_key(std::uint32_t receiver, std::uint32_t sender) const {
  return sampling::hash(seed_, std::min(receiver, sender), std::max(receiver, sender));
}

Patches::Ends Patches::ends(std::uint32_t receiver, std::uint32_t sender, std::uint32_t pair_key,
                            std::uint32_t k) const {
  if (pair_samples_ == 1) return {};
  // Flips by the key, and the rows of a Latin square for each sixteen more.
  const std::uint32_t first = (k ^ pair_key) % kPoints;
  const std::uint32_t second =
      (Footprint::sample_of(k % kPoints) ^ k / kPoints ^ pair_key >> 4) % kPoints;
  return receiver < sender ? Ends{first, second} : Ends{second, first};
}

}  // namespace kiln::solver::pairwise
