#pragma once

#include <memory>
#include <vector>

#include "baker/lightmap/lightmap.h"
#include "baker/solver/emittance.h"
#include "baker/solver/pairwise/pairwise.h"
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
        emittance(sent_emittance(w)),
        visibility(make_visibility(w)),
        factors(w, patches, *visibility) {}
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
    if (visibility_kind(world.settings, patches.size()) != proto::VisibilityKind::kCached) return 0;
    return PairLayout::words_for(patches.size(), std::uint64_t(world.settings.visibility_cache_mib)
                                                     << 20);
  }
  /// Returns the share of all pairs that a pass before the bounces has remembered.
  double remembered_share() const {
    const std::uint32_t words = seen_words();
    return words > 0 ? PairLayout(patches.size(), words).coverage() : 0;
  }
  /// Returns the radiosity that others see for an irradiance of 1: ρ · albedo [RTRad eq. 4.8], over
  /// the share of the texel that can be seen, since E is the mean over all of it. What is nearly
  /// all hidden sends nothing.
  math::Rgb reflectance(std::uint32_t texel) const {
    constexpr float kHiddenShare = 0.1f;
    const float visible = patches.visible_share(texel);
    if (visible < kHiddenShare) return {};
    return world.texels.albedo[texel] * (world.settings.reflectivity_factor / visible);
  }

  const World& world;
  const Patches patches;
  const SenderStrategy senders;
  const std::vector<math::Rgb> emittance;  ///< M of the texels, lx; empty when rays find it
  const std::unique_ptr<const trace::Visibility> visibility;
  const ViewFactors factors;
};

/// Holds the light that the texels send in a bounce.
struct TexelLight {
  std::vector<math::Rgb> radiosity;  ///< B = ρ · albedo · E + M, lx
  /// The largest channel of what all texels send of direct light, and as emitters; lx. Shares of
  /// the brightest light are of this.
  float brightest_direct = 0;
  float mean_direct = 0;  ///< the same, as the mean by area

  TexelLight() = default;
  /// @param before the light of the pass before: direct, sky, indirect
  TexelLight(const Parts&, const lightmap::Lightmap& before);
};

}  // namespace kiln::solver::pairwise
