#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <span>
#include <vector>

#include "baker/denoise/filter_bank.h"
#include "baker/solver/solver.h"

namespace kiln::solver::adaptive {

/// Which texels take more samples, once the light has all its bounces.
///
/// The error of a texel is the standard error of its luminance, as FilterBank tells it. By the
/// measure percentile_95 it counts over the luminance plus 2 % of the scene's mean, so that the
/// dark is not chased for ever, and a lightmap's error is the 95th percentile over its texels. Each
/// round doubles the samples of the tiles whose own 95th percentile is above the target, up to
/// three times where it is far above: shadow rays or directions, or both where both matter. By the
/// measure rms a lightmap's error is the root mean square over its texels, over their mean
/// luminance, and a round doubles where that lowers it most for its cost.
class SampleRounds {
 public:
  /// Texels that take samples together: a run of indices, an 8x8 block of a page as a rule.
  static constexpr std::uint32_t kTileTexels = 64;
  static constexpr const char* kName = "round";  ///< of the passes

  /// @param directions that were followed before the first round
  SampleRounds(const SolverInput&, std::uint32_t directions);

  /// Most rounds there can be.
  std::uint32_t limit() const { return limit_; }
  /// After the passes `done`, the last of which left the light complete.
  bool wants_another(std::span<const proto::PassReport> done) const;

  /// Looks at the light after a pass that left it complete: says in the report what its error is.
  /// False when stopped.
  bool judge(const lightmap::Lightmap&, const exec::Workers&, proto::PassReport&);
  enum class Known { kDirect, kFirstBounce };
  /// Before there is light to judge: guesses the effort of all rounds by how the samples scatter,
  /// and by what is usual of the light that is not known yet.
  void guess(const lightmap::Lightmap&, Known);
  /// Before a round: makes sure that its tiles are chosen. False when stopped.
  bool begin(const lightmap::Lightmap&, const exec::Workers&);

  /// How often the round that was begun doubles the samples of a tile.
  struct Doublings {
    std::uint32_t shadow_rays = 0, directions = 0;
  };
  const Doublings& of(atlas::TexelRange tile) const { return tiles_[tile.begin / kTileTexels]; }
  /// Whether any tile of the round that was begun takes more of them.
  bool adds_shadow_rays() const { return adds_shadow_rays_; }
  bool adds_directions() const { return !first_directions_.empty(); }
  /// How many samples follow on so many in one doubling: as many again, up to the limit.
  std::uint32_t more_shadow_rays(std::uint32_t had) const;
  std::uint32_t more_directions(std::uint32_t had) const;
  /// Numbers of directions that are doubled.
  const std::set<std::uint32_t>& first_directions() const { return first_directions_; }

  /// Expected effort: of the batches of the next round; and of all rounds, those done included.
  Work next_work() const { return next_work_; }
  Work expected_work() const { return expected_work_; }
  /// Share of the next round's effort in the first `share` of the texels.
  double work_share(double share) const;
  /// Of judge().
  static Work judge_work() { return Work::other(work::kFilter); }

  /// The light filtered. Nothing when stopped.
  std::optional<denoise::FilteredLight> filtered(const lightmap::Lightmap&, const exec::Workers&);

 private:
  /// What the samples of a tile leave: variances summed over its texels.
  struct Noise {
    double direct = 0, gathered = 0;
    double texels = 0, gathering = 0;  ///< how many there are, and how many of them take directions
    std::uint32_t shadow_rays = 0, directions = 0;  ///< each has
  };

  float shown(std::uint32_t texel) const;     ///< luminance, lx
  float variance(std::uint32_t texel) const;  ///< lx²
  /// Texels that are judged: on the front, and not inside other geometry.
  bool counts(const lightmap::Lightmap&, std::uint32_t texel) const;
  void tell_errors();
  double percentile_of_all(const lightmap::Lightmap&) const;
  double root_mean_square(const lightmap::Lightmap&) const;

  Doublings choose(atlas::TexelRange tile, const lightmap::Lightmap&) const;
  /// All that the target takes by the measure rms, for every tile.
  std::vector<Doublings> by_mean_square(std::span<const Noise>, double mean, double texels) const;
  std::vector<Doublings> to_mean_square(const lightmap::Lightmap&) const;
  Doublings limited(Doublings, atlas::TexelRange tile, const lightmap::Lightmap&) const;
  void foresee(const lightmap::Lightmap&);
  double over_target(atlas::TexelRange tile) const;
  double gather_share() const { return in_.plan.coarse ? 0.45 : 1; }
  Work cost(double shadow_rays, double directions) const;
  Work cost(Doublings, std::uint32_t shadow_rays, std::uint32_t directions) const;
  Work work_to_target(atlas::TexelRange tile, const lightmap::Lightmap&) const;
  /// Expected effort until an error that is `over` times the target has come down to it.
  /// @param direct variance of direct light, @param gathered of the rest: what is large matters
  Work work_to_target(double over, double direct, double gathered, std::uint32_t shadow_rays,
                      std::uint32_t directions) const;

  const SolverInput& in_;
  denoise::FilterBank bank_;
  bool can_add_shadow_rays_, can_add_directions_;
  std::uint32_t limit_ = 0, needed_ = 0;            ///< rounds at most, and at least
  std::optional<denoise::FilteredLight> filtered_;  ///< the light that was judged last
  const lightmap::Lightmap* judged_ = nullptr;      ///< which that was, by its address; never read
  std::vector<float> error_;                        ///< of each texel, relative
  std::vector<Doublings> tiles_;                    ///< of the next round
  std::set<std::uint32_t> first_directions_;
  bool adds_shadow_rays_ = false;
  std::vector<double> work_before_;  ///< of the next round: of all tiles before each, and of all
  Work next_work_, expected_work_, work_done_;
};

}  // namespace kiln::solver::adaptive
