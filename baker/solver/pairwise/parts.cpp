#include "baker/solver/pairwise/parts.h"

#include <algorithm>

#include "baker/trace/voxel_grid.h"

namespace kiln::solver::pairwise {

std::unique_ptr<const trace::Visibility> Parts::make_visibility(const World& w) {
  const proto::SolverSettings& s = w.settings;
  if (s.visibility != proto::VisibilityKind::kVoxel)
    return std::make_unique<trace::RayVisibility>(w.rays);
  const bool is_exact = s.voxel_march == proto::VoxelMarch::kExact;
  // Nothing stops this: the largest grid takes less than a second.
  auto grid = trace::VoxelGrid::build(w.scene, s.voxel_grid, voxel_fill(s));
  using enum trace::VoxelVisibility::March;
  return std::make_unique<trace::VoxelVisibility>(std::move(*grid), is_exact ? kExact : kFixedSteps,
                                                  s.voxel_ratio, w.rays);
}

TexelLight::TexelLight(const Parts& parts, const lightmap::Lightmap& before)
    : radiosity(before.size()) {
  double sum = 0, area = 0;
  for (std::uint32_t t = 0; t < before.size(); ++t) {
    const math::Rgb direct = parts.reflectance(t) * (before.direct[t] + before.sky[t]);
    const math::Rgb own = parts.emittance.empty() ? math::Rgb{} : parts.emittance[t];
    radiosity[t] = parts.reflectance(t) * before.irradiance(t) + own;
    brightest_direct = std::max(brightest_direct, max_channel(direct + own));
    sum += double(max_channel(direct + own)) * double(parts.patches.area_m2(t));
    area += double(parts.patches.area_m2(t));
  }
  mean_direct = area > 0 ? float(sum / area) : 0;
}

}  // namespace kiln::solver::pairwise
