#pragma once

#include <array>
#include <cstddef>

namespace kiln::solver {

/// The expected effort, only for the estimates of progress and of the remaining time. One unit is
/// about the cost of a shadow ray for every texel. Kinds of work are kept apart, since the ratios
/// between them differ by four from scene to scene, and are known once some of each has been done.
struct Work {
  enum Kind { kShadowRays, kDirections, kOther, kKinds };
  std::array<double, kKinds> of{};

  static Work shadow_rays(double n) { return {{n, 0, 0}}; }
  static Work directions(double n) { return {{0, n, 0}}; }
  static Work other(double n) { return {{0, 0, n}}; }

  double sum() const { return of[0] + of[1] + of[2]; }
  Work& operator+=(const Work& o) {
    for (std::size_t k = 0; k < kKinds; ++k) of[k] += o.of[k];
    return *this;
  }
  friend Work operator+(Work a, const Work& b) { return a += b; }
  friend Work operator*(Work a, double s) {
    for (double& k : a.of) k *= s;
    return a;
  }
};

/// The approximate cost of parts of a bake, measured over six scenes.
namespace work {

inline constexpr double kDirection = 1.1;    ///< a gathering ray
inline constexpr double kLookUp = 0.04;      ///< what a ray has met, looked up by a bounce
inline constexpr double kTexel = 1.2;        ///< a bounce, beside its look-ups
inline constexpr double kManyLightsRay = 3;  ///< a shadow ray where there are many lights
inline constexpr double kFilter = 14;        ///< filtering and judging the light of a texel
inline constexpr double kOutput = 7;         ///< writing a texel
/// Share of the texels that send directions of their own where light is gathered coarsely.
inline constexpr double kGatheredShare = 0.45;
/// Share of the shadow rays that are sent to few lights; where the first agree, no more follow.
inline constexpr double kUnculledShare = 0.6;

}  // namespace work
}  // namespace kiln::solver
