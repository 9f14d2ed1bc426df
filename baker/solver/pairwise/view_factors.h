#pragma once

#include <algorithm>
#include <cstdint>

#include "baker/solver/pairwise/patches.h"
#include "baker/trace/visibility.h"

namespace kiln::solver::pairwise {

/// The view factors from one texel to others.
///
///   F_ij = 1/K Σ_k A_j cosθ_ki cosθ_kj / (π (s r_k)²) V(x_ki, x_kj)   [RTRad eqs. 4.1, 4.6, 4.7]
///
/// The share of the light that falls on i from a hemisphere as bright as j. π is part of F, unlike
/// in the thesis, so that a row of F sums to 1 in a closed scene [Moreno-Fortuny eqs. 2.12, 2.15].
/// s is `solver.distance_factor` [RTRad eq. 4.8, listing of AddContribution].
///
/// The formula holds for A_j much smaller than r². Nearer texels it overstates, without a limit as
/// r falls to zero; so A_i F_ij, which is A_j F_ji, is held down to the smaller of the two areas,
/// which no view factor exceeds. That keeps bounces from growing between surfaces that lie closer
/// to each other than their texels are wide.
///
/// Where shading normals are those of the surface, A_i F_ij = A_j F_ji bit for bit [RTRad
/// eq. 2.36]: both are taken from the same pairs of points, and a segment is traced from the texel
/// with the lower index, whichever is the receiver.
class ViewFactors {
 public:
  /// Both ways of a pair.
  struct Factors {
    float forth = 0, back = 0;  ///< F_ij and F_ji
  };

  /// Both outlive this.
  ViewFactors(const Patches& patches, const trace::Visibility& visibility, float distance_factor)
      : patches_(patches),
        visibility_(visibility),
        scale_(1 /
               (math::kPi * distance_factor * distance_factor * float(patches.pair_samples()))) {}

  /// Calls `use(j, F_ij)` for the senders of [begin, end) that give light to texel i, in rising
  /// order. Pairs of points that turn away from each other are skipped before they are traced, and
  /// so are those within a window. @param wanted tells of a sender whether it matters
  /// @return rays traced
  template <class Wanted, class Use>
  std::uint64_t row(std::uint32_t i, std::uint32_t begin, std::uint32_t end, const Wanted& wanted,
                    const Use& use) const {
    return walk(
        i, begin, end, wanted, [](Factors f) { return f.forth > 0; },
        [&](std::uint32_t j, Factors f) { use(j, f.forth); });
  }
  /// Calls `use(j, Factors)` for the texels of [begin, end) that exchange light with texel i,
  /// either way. @return rays traced
  template <class Use>
  std::uint64_t pairs(std::uint32_t i, std::uint32_t begin, std::uint32_t end,
                      const Use& use) const {
    return walk(
        i, begin, end, [](std::uint32_t) { return true; },
        [](Factors f) { return f.forth > 0 || f.back > 0; }, use);
  }

 private:
  template <class Wanted, class Matters, class Use>
  std::uint64_t walk(std::uint32_t i, std::uint32_t begin, std::uint32_t end, const Wanted& wanted,
                     const Matters& matters, const Use& use) const {
    Queue<Use> queue(*this, i, use);
    const std::uint32_t samples = patches_.pair_samples();
    for (std::uint32_t j = begin; j < end; ++j) {
      if (!wanted(j) || j == i) continue;
      const std::uint32_t key = samples > 1 ? patches_.pair_key(i, j) : 0;
      bool excluded = false, asked = false;
      for (std::uint32_t k = 0; k < samples && !excluded; ++k) {
        const Patches::Ends ends = patches_.ends(i, j, key, k);
        const Patches::Point& one = patches_.point(i, ends.receiver);
        const Patches::Point& other = patches_.point(j, ends.sender);
        const Factors kernel = unoccluded(one, other);
        if (!matters(kernel)) continue;
        if (!asked) excluded = patches_.are_excluded(i, j), asked = true;
        if (!excluded) queue.add(j, kernel, one.origin, other.origin);
      }
    }
    queue.finish();
    return queue.traced();
  }

  /// Returns cosθ cosθ'/r² either way, 1/m², without what may stand between; 0 when the points turn
  /// away from each other.
  static Factors unoccluded(const Patches::Point& a, const Patches::Point& b) {
    constexpr float kSamePlace = 1e-30f;  // m²
    const math::Vec3 way = b.position - a.position;
    const float r2 = dot(way, way);
    const float above_a = dot(a.geometric_normal, way), above_b = -dot(b.geometric_normal, way);
    if (!(above_a > 0 && above_b > 0 && r2 > kSamePlace)) return {};
    const float at_a = std::max(0.f, dot(a.shading_normal, way));
    const float at_b = std::max(0.f, -dot(b.shading_normal, way));
    return {(at_a / r2) * (above_b / r2), (at_b / r2) * (above_a / r2)};
  }

  /// Collects segments of a row until there are sixteen to trace. The segments of a pair follow
  /// each other, and their sum is passed on when those of the next pair begin.
  template <class Use>
  class Queue {
   public:
    Queue(const ViewFactors& factors, std::uint32_t i, const Use& use)
        : of_(factors), i_(i), use_(use) {}

    void add(std::uint32_t j, Factors kernel, math::Vec3 at_i, math::Vec3 at_j) {
      j_[packet_.count] = j, kernel_[packet_.count] = kernel;
      i_ < j ? packet_.add(at_i, at_j) : packet_.add(at_j, at_i);
      if (packet_.is_full()) trace();
    }
    void finish() {
      if (packet_.count > 0) trace();
      pass_on();
    }
    std::uint64_t traced() const { return traced_; }

   private:
    void trace() {
      const std::uint32_t blocked = of_.visibility_.blocked(packet_);
      for (std::uint32_t s = 0; s < packet_.count; ++s) {
        if (j_[s] != last_) pass_on(), last_ = j_[s];
        if (blocked >> s & 1) continue;
        sum_.forth += kernel_[s].forth, sum_.back += kernel_[s].back;
      }
      traced_ += packet_.count;
      packet_.count = 0;
    }
    void pass_on() {
      if (sum_.forth > 0 || sum_.back > 0) {
        const float a_i = of_.patches_.area_m2(i_), a_j = of_.patches_.area_m2(last_);
        use_(last_, Factors{std::min(sum_.forth * of_.scale_ * a_j, std::min(1.f, a_j / a_i)),
                            std::min(sum_.back * of_.scale_ * a_i, std::min(1.f, a_i / a_j))});
      }
      sum_ = {};
    }

    const ViewFactors& of_;
    const std::uint32_t i_;
    const Use& use_;
    trace::SegmentPacket packet_;
    std::uint32_t j_[16]{};
    Factors kernel_[16];
    std::uint32_t last_ = 0;
    Factors sum_;
    std::uint64_t traced_ = 0;
  };

  const Patches& patches_;
  const trace::Visibility& visibility_;
  const float scale_;
};

}  // namespace kiln::solver::pairwise
