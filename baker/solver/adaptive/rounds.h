#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "baker/lightmap/lightmap.h"
#include "baker/solver/adaptive/error.h"
#include "baker/solver/work.h"
#include "baker/solver/world.h"
#include "proto/manifest.h"

namespace kiln::solver::adaptive {

/// A tile of texels that take samples together, with the variances of its light summed over its
/// texels.
struct TileNoise {
  double direct = 0, gathered = 0;
  double texels = 0, gathering = 0;  ///< number of texels, and of those that take directions
  std::uint32_t shadow_rays = 0, directions = 0;  ///< each has
};

/// The doublings of a tile until the target is reached; rounds may do only some of them.
struct WantedDoublings {
  std::uint32_t shadow_rays = 0, directions = 0;
};

/// The work that choose() expects of rounds.
struct RoundOutlook {
  Work next;  ///< work of the batches of the next round
  Work all;   ///< work of all rounds that follow
};

/// Chooses which texels take more samples, once the light has all its bounces. Immutable.
///
/// By the measure percentile_95 each round doubles the samples of the tiles whose own 95th
/// percentile is above the target, up to three times where it is far above: shadow rays or
/// directions, or both where both matter. By the measure rms a round doubles where that lowers the
/// error most for its cost (see allocate_samples).
class AdaptiveSampling {
 public:
  /// @param samples those that the passes before the first round take, and the limits
  AdaptiveSampling(const World&, const SamplePlan& samples);

  /// Returns the largest possible number of rounds.
  std::uint32_t limit() const { return limit_; }
  /// Returns whether a round follows.
  /// @param rounds number that have been made
  /// @param last the last report
  bool wants_another(std::uint32_t rounds, const proto::PassReport& last) const;

  /// Chooses what the next round doubles, into light.doublings.
  RoundOutlook choose(const Judgement&, lightmap::Lightmap&) const;

  /// Return how many samples the next doubling adds: as many again, up to the limit.
  std::uint32_t more_shadow_rays(std::uint32_t had) const;
  std::uint32_t more_directions(std::uint32_t had) const;

  /// Returns the expected effort of every texel. Most texels take no directions when they are
  /// gathered coarsely.
  Work cost(double shadow_rays, double directions) const;
  Work cost(WantedDoublings, std::uint32_t shadow_rays, std::uint32_t directions) const;
  /// Returns the expected effort until an error that is `over` times the target has come down to
  /// it.
  /// @param direct variance of direct light
  /// @param gathered variance of the rest: what is large matters
  Work work_to_target(double over, double direct, double gathered, std::uint32_t shadow_rays,
                      std::uint32_t directions) const;
  /// Returns all doublings that the target takes by the measure rms, for every tile.
  std::vector<WantedDoublings> by_mean_square(std::span<const TileNoise>, double mean,
                                              double texels) const;
  /// Returns the expected share of texels that take directions.
  double gather_share() const { return samples_.coarse ? work::kGatheredShare : 1; }

 private:
  bool goes_by_rms() const;
  double over_target(const Judgement&, atlas::TexelRange tile) const;
  WantedDoublings choose_by_percentile(const Judgement&, atlas::TexelRange tile,
                                       const lightmap::Lightmap&) const;
  std::vector<WantedDoublings> choose_by_mean_square(const Judgement&,
                                                     const lightmap::Lightmap&) const;
  WantedDoublings limited(WantedDoublings, atlas::TexelRange tile, const lightmap::Lightmap&) const;
  Work work_to_target(const Judgement&, atlas::TexelRange tile, const lightmap::Lightmap&) const;

  const World& world_;
  const SamplePlan samples_;
  const bool can_add_shadow_rays_, can_add_directions_;
  std::uint32_t limit_ = 0, needed_ = 0;  ///< rounds at most, and at least
};

/// The tiles of a light, in order.
template <class Use>
void for_tiles(std::uint32_t texels, const Use& use) {
  for (std::uint32_t t = 0; t < texels; t += kSampleTileTexels)
    use(atlas::TexelRange{t, t + kSampleTileTexels < texels ? t + kSampleTileTexels : texels});
}

}  // namespace kiln::solver::adaptive
