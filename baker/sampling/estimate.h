#pragma once

#include <cstdint>

#include "baker/math/vec.h"

namespace kiln::sampling {

/// The mean over some samples, and how far two halves of them differ. Both are linear: means of
/// estimates are estimates, and so are sums of independent ones.
struct Estimate {
  math::Rgb mean;
  /// The half of the difference of the luminance that the two halves give, as if they were
  /// independent: its square is an estimate of the variance of the mean's luminance.
  float half_difference = 0;

  Estimate& operator+=(const Estimate& o) {
    mean += o.mean, half_difference += o.half_difference;
    return *this;
  }
};

/// The halves of a net are not independent: where one is too high the other tends to be too low,
/// since together they are better than apart. If the error of a net falls with N^-a, half their
/// difference is the square root of 4^a - 1 times the error of the whole. Factors on it for what
/// was measured: a = 0.65, at the lower end of what gathers and samples of many lights have, and
/// 0.75 for the visible share of one lamp.
inline constexpr float kNetCorrection = 0.827f, kPolygonNetCorrection = 0.740f;
/// The same for a HemisphereSet, of a disc and of a hemicube, as measured.
inline constexpr float kDiscCorrection = 0.80f, kHemicubeCorrection = 0.69f;

/// Sums over two halves of the samples, each of which estimates half of what arrives.
struct HalfSums {
  math::Rgb half[2];

  Estimate estimate() const { return {half[0] + half[1], luminance(half[0]) - luminance(half[1])}; }
};

/// The estimate of `n` samples and one of `m` more.
template <class T>
T joined(const T& old, std::uint32_t n, const T& more, std::uint32_t m) {
  const float share = float(m) / (float(n) + float(m));
  return old * (1 - share) + more * share;
}

}  // namespace kiln::sampling
