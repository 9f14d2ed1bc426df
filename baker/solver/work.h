#pragma once

/// About what parts of a bake cost, in shadow rays: for the estimates of progress and of the time
/// that is left, nothing else. Measured over six scenes, and rough: the ratios
/// differ by two from scene to scene.
namespace kiln::baker::work {

inline constexpr double kDirection = 1.1;  ///< a gathering ray
inline constexpr double kLookUp = 0.04;    ///< what a ray has met, looked up by a bounce
inline constexpr double kTexel = 0.5;      ///< a bounce, beside its look-ups
inline constexpr double kFilter = 11;      ///< filtering and judging the light of a texel
inline constexpr double kOutput = 7;       ///< writing a texel

}  // namespace kiln::baker::work
