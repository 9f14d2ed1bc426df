#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "baker/denoise/filter_bank.h"
#include "baker/exec/workers.h"
#include "baker/lightmap/lightmap.h"
#include "baker/solver/world.h"

namespace kiln::solver::adaptive {

/// A light as it is to be shown, and its error.
struct Judgement {
  denoise::FilteredLight filtered;
  std::vector<float> error;   ///< relative error of each texel
  double standard_error = 0;  ///< error of the lightmap, by the measure of the plan

  float luminance_of(std::uint32_t texel) const;  ///< lx
  float variance_of(std::uint32_t texel) const;   ///< variance of the luminance, lx²
};

/// Filters and judges the light of any method.
///
/// The error of a texel is the standard error of its luminance, as FilterBank estimates it. By the
/// measure percentile_95 it counts over the luminance plus 2 % of the scene's mean, so that dark
/// texels do not take samples without an end. A lightmap's error is then the 95th percentile over
/// its texels. By the measure rms a lightmap's error is the root mean square over its texels, over
/// their mean luminance.
class ErrorJudge {
 public:
  /// @param smooth false: the light is shown as it was sampled
  ErrorJudge(const World&, bool smooth);

  /// Returns nothing when stopped.
  std::optional<Judgement> judge(const lightmap::Lightmap&, const exec::Workers&);

 private:
  void fill_errors(Judgement&) const;

  const World& world_;
  denoise::FilterBank bank_;
};

/// Returns whether a texel is judged: it is on the front, and not inside other geometry.
inline bool is_judged(const World& world, const lightmap::Lightmap& light, std::uint32_t texel) {
  return texel < world.texels.front_count && light.validity[texel] >= lightmap::kValidShare;
}

/// Returns the value that 95 of 100 don't exceed; 0 when there are none. Reorders the values.
float percentile_95(std::vector<float>& values);

}  // namespace kiln::solver::adaptive
