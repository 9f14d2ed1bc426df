#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "baker/light/area_light.h"
#include "baker/math/vec.h"
#include "baker/simd/kernels.h"

namespace kiln::light {

/// Holds area lights in groups of sixteen, for weighing many at once. Neighbors in the table are
/// neighbors in space, so that draws spread over it also spread over what hides lights. Immutable.
class LightTable {
 public:
  /// @param power_share of each light, summing to 1
  LightTable(std::span<const AreaLight>, std::span<const float> power_share);

  std::uint32_t groups() const { return static_cast<std::uint32_t>(groups_.size()); }
  const simd::LightGroup* data() const { return groups_.data(); }
  /// Returns the index of the light at each place of the table. Places after the last light hold
  /// any value.
  const std::vector<std::uint32_t>& light() const { return light_; }
  /// Returns the shares, with zeros after the last light, and their sums over each group.
  const std::vector<float>& share() const { return share_; }
  const std::vector<double>& group_share() const { return group_share_; }

 private:
  std::vector<simd::LightGroup> groups_;
  std::vector<std::uint32_t> light_;
  std::vector<float> share_;
  std::vector<double> group_share_;
};

/// The probabilities by which some texels choose among many lights: by what a few points of the
/// surface would get from each, and a small share by power alone, so that no light that some texel
/// sees has probability zero.
class LightChoice {
 public:
  explicit LightChoice(const LightTable&);

  /// Forgets all points.
  void clear();
  /// Adds what the surface around a viewpoint would get. `weigh_near(light)` weighs lights that are
  /// too near: it returns the irradiance there, luminance-weighted, lx.
  template <class WeighNear>
  void add(const simd::Viewpoint& from, WeighNear weigh_near) {
    weigh(from);
    for (std::uint32_t g = 0; g < table_.groups(); ++g)
      for (std::uint32_t bits = near_[g]; bits != 0; bits &= bits - 1) {
        const std::uint32_t place = g * kGroup + static_cast<std::uint32_t>(__builtin_ctz(bits));
        if (table_.share()[place] > 0) weight_[place] += weigh_near(table_.light()[place]);
      }
  }
  /// Ends the adding of points. It is called after the last point, before a walk.
  void finish();

  struct Pick {
    std::uint32_t light = 0;
    float probability = 0;
  };
  /// Picks lights by rising positions in [0, 1): each is picked by an interval as long as its
  /// probability.
  class Walk {
   public:
    explicit Walk(const LightChoice& choice) : choice_(choice) {}
    /// @param position not below the last one
    Pick at(double position);

   private:
    const LightChoice& choice_;
    std::uint32_t place_ = 0;  ///< index in the table
    double end_ = 0;           ///< end of the intervals before it
  };

 private:
  static constexpr std::uint32_t kGroup = 16;
  void weigh(const simd::Viewpoint&);
  double probability(std::uint32_t place) const;

  const LightTable& table_;
  const simd::Kernels& kernels_;
  std::vector<float> weight_;
  std::vector<std::uint32_t> near_;
  double by_weight_ = 0, by_power_ = 1;  ///< factors on weight and power share
  std::vector<double> group_end_;        ///< summed probabilities up to the end of each group
};

}  // namespace kiln::light
