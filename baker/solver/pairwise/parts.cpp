#include "baker/solver/pairwise/parts.h"

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

}  // namespace kiln::solver::pairwise
