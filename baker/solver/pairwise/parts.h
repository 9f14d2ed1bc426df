#pragma once

#include <memory>
#include <vector>

#include "baker/solver/emittance.h"
#include "baker/solver/pairwise/patches.h"
#include "baker/solver/pairwise/senders.h"
#include "baker/solver/pairwise/view_factors.h"
#include "baker/trace/visibility.h"

namespace kiln::solver::pairwise {

/// What all passes of one bake share. Immutable; stays where it is.
struct Parts {
  /// @param w outlives this
  explicit Parts(const World& w)
      : world(w),
        patches(w, w.settings.pair_samples),
        senders(w, patches),
        emittance(are_senders(w.settings) ? texel_emittance(w) : std::vector<math::Rgb>()),
        visibility(make_visibility(w)),
        factors(patches, *visibility, w.settings.distance_factor) {}
  Parts(const Parts&) = delete;
  Parts& operator=(const Parts&) = delete;

  /// Returns rays, or voxels in their place. @param w outlives the result
  static std::unique_ptr<const trace::Visibility> make_visibility(const World& w);
  /// Returns the voxels that a grid for the march of the settings has.
  static trace::VoxelFill voxel_fill(const proto::SolverSettings& s) {
    return s.voxel_march == proto::VoxelMarch::kExact ? trace::VoxelFill::kConservative
                                                      : trace::VoxelFill::kDominantAxis;
  }
  /// Returns the words per texel that remember what is seen; 0 when nothing does.
  std::uint32_t seen_words() const {
    if (world.settings.visibility != proto::VisibilityKind::kCached) return 0;
    return PairLayout::words_for(patches.size(), std::uint64_t(world.settings.visibility_cache_mib)
                                                     << 20);
  }
  /// Returns whether emitters send their light as any texel does.
  static bool are_senders(const proto::SolverSettings& s) {
    return s.emitters == proto::Emitters::kTransport;
  }

  /// Returns the share of the light on a texel that it sends on: ρ · albedo [RTRad eq. 4.8].
  math::Rgb reflectance(std::uint32_t texel) const {
    return world.texels.albedo[texel] * world.settings.reflectivity_factor;
  }

  const World& world;
  const Patches patches;
  const SenderStrategy senders;
  const std::vector<math::Rgb> emittance;  ///< M of the texels, lx; empty when rays find it
  const std::unique_ptr<const trace::Visibility> visibility;
  const ViewFactors factors;
};

}  // namespace kiln::solver::pairwise
