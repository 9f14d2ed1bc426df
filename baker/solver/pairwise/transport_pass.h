#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "baker/solver/pairwise/parts.h"
#include "baker/solver/pass.h"

namespace kiln::solver::pairwise {

/// The two clamps of RTRad's program [RTRad 4.7.3]. They take energy; how much is told.
class Clamps {
 public:
  /// @param brightest B that stands for 1, lx
  Clamps(const proto::SolverSettings& s, float brightest)
      : factor_(s.max_view_factor), light_(s.max_contribution) {
    if (light_) *light_ *= brightest;
  }
  static bool are_used(const proto::SolverSettings& s) {
    return s.max_view_factor || s.max_contribution;
  }
  /// Returns what a sender of radiosity b gives by a view factor.
  math::Rgb operator()(float factor, math::Rgb b) const {
    const math::Rgb given = b * (factor_ ? std::min(factor, *factor_) : factor);
    const float most = max_channel(given);
    return light_ && most > *light_ ? given * (*light_ / most) : given;
  }

 private:
  std::optional<float> factor_, light_;
};

/// A sum in double precision, in a fixed order.
struct Sum {
  double r = 0, g = 0, b = 0;
  void operator+=(math::Rgb c) { r += double(c.r), g += double(c.g), b += double(c.b); }
  math::Rgb rgb() const { return {float(r), float(g), float(b)}; }
};

/// What bounces and shots share: senders, and what they give to a texel.
class TransportPass : public Pass {
 protected:
  TransportPass(const Parts&, bool is_remembered, PassPlan);

  bool clamps() const { return Clamps::are_used(parts_.world.settings); }

  /// Takes from the light before what all texels send.
  void read(const lightmap::Lightmap& before);
  /// Adds what some senders give to a texel. @param lost the light that clamps take
  /// @return rays traced
  std::uint64_t add(std::uint32_t texel, const Senders& from, Sum& sum, double& lost) const;

  const Parts& parts_;
  const bool is_remembered_;
  std::vector<math::Rgb> radiosity_;  ///< B of the texels in the light before, lx

 private:
  std::optional<Clamps> clamp_;
  std::optional<SeenPairs> seen_;
};

}  // namespace kiln::solver::pairwise
