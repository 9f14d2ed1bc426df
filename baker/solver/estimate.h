#pragma once

#include <cstdint>

#include "baker/math/vec.h"

namespace kiln::baker {

/// The mean over some samples, and how far two halves of them differ. Both are linear: means of
/// estimates are estimates, and so are sums of independent ones.
struct Estimate {
  Rgb mean;
  /// Half the difference of the luminance that the two halves give. Its square is an unbiased
  /// estimate of the variance of the mean's luminance if the samples are independent; samples of
  /// one net are spread better than that, and it comes out too large then, never too small.
  float spread = 0;

  Estimate& operator+=(const Estimate& o) {
    mean += o.mean, spread += o.spread;
    return *this;
  }
};

/// Sums over two halves of the samples, each of which estimates half of what arrives.
struct Halves {
  Rgb half[2];

  Estimate estimate() const { return {half[0] + half[1], luminance(half[0]) - luminance(half[1])}; }
};

/// The estimate of `n` samples and one of `m` more.
template <class T>
T joined(const T& old, std::uint32_t n, const T& more, std::uint32_t m) {
  const float share = float(m) / (float(n) + float(m));
  return old * (1 - share) + more * share;
}

}  // namespace kiln::baker
