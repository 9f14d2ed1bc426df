#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>

#include "baker/solver/pairwise/near_field.h"
#include "baker/solver/pairwise/patches.h"
#include "baker/solver/pairwise/seen_pairs.h"
#include "baker/solver/pairwise/senders.h"
#include "baker/trace/visibility.h"

namespace kiln::solver::pairwise {

/// The view factors from one texel to others.
///
///   F_ij = 1/K Σ_k A_j cosθ_ki cosθ_kj / (π (s r_k)²) V(x_ki, x_kj)   [RTRad eqs. 4.1, 4.6, 4.7]
///
/// The share of the light that falls on i from a hemisphere as bright as j. π is part of F, unlike
/// in the thesis, so that a row of F sums to 1 in a closed scene [Moreno-Fortuny eqs. 2.12, 2.15].
/// s is `solver.distance_factor` [RTRad eq. 4.8, listing of AddContribution]. A_j is the area that
/// the sender stands for, see Sender.
///
/// The formula holds for A_j much smaller than r². Nearer texels it overstates, without a limit as
/// r falls to zero. So with `solver.near_field` the mean over the pairs of points takes its place
/// where both are texels and near to each other (NearField), times the visible share of the
/// formula's own pairs; no further ray is traced. In any case A_i F_ij, which is A_j F_ji, is held
/// down to the smaller of the two areas, which no view factor exceeds. That keeps bounces from
/// growing between surfaces that lie closer to each other than their texels are wide.
///
/// Where shading normals are those of the surface, A_i F_ij = A_j F_ji bit for bit [RTRad
/// eq. 2.36]: both are taken from the same pairs of points, and a segment is traced from the texel
/// with the lower index, whichever is the receiver.
class ViewFactors {
 public:
  /// Both ways of a pair.
  struct Factors {
    float forth = 0, back = 0;  ///< F_ij and F_ji

    void operator+=(Factors f) { forth += f.forth, back += f.back; }
  };

  /// All outlive this.
  ViewFactors(const World& world, const Patches& patches, const trace::Visibility& visibility)
      : patches_(patches),
        visibility_(visibility),
        scale_(1 / (math::kPi * world.settings.distance_factor * world.settings.distance_factor)),
        per_sample_(1 / float(patches.pair_samples())) {
    if (world.settings.near_field) near_.emplace(world);
  }

  /// Calls `use(s, F)` for the senders that give light to texel i, in their order; `s` is the place
  /// in the list. Pairs of points that turn away from each other are skipped before they are
  /// traced, and so are those within a window. @param seen what is known already; may be null, and
  /// needs senders that are texels, with one sample a pair. The factors are the same without it.
  /// @return rays traced
  template <class Use>
  std::uint64_t row(std::uint32_t i, const Senders& senders, const SeenPairs* seen,
                    const Use& use) const {
    return walk(
        i, Listed{patches_, senders}, 0, std::uint32_t(senders.list.size()), seen,
        [](Factors f) { return f.forth > 0; },
        [&](std::uint32_t s, Factors f) { use(s, f.forth); });
  }
  /// Calls `use(j, Factors)` for the texels of [begin, end) that exchange light with texel i,
  /// either way. @return rays traced
  template <class Use>
  std::uint64_t pairs(std::uint32_t i, std::uint32_t begin, std::uint32_t end,
                      const Use& use) const {
    return walk(
        i, Texels{patches_}, begin, end, nullptr,
        [](Factors f) { return f.forth > 0 || f.back > 0; }, use);
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

 private:
  /// The other ends of pairs, by numbers: all texels, or the senders of a list.
  struct Texels {
    const Patches& patches;

    std::uint32_t texel(std::uint32_t j) const { return j; }
    float area_m2(std::uint32_t j) const { return patches.area_m2(j); }
    /// Returns whether the end is a texel that stands for itself alone.
    bool is_texel(std::uint32_t) const { return true; }
    float visible_pairs(std::uint32_t i, std::uint32_t j) const {
      return patches.visible_pairs(i, j);
    }
    const Patches::Point& point(std::uint32_t j, std::uint32_t i) const {
      return patches.point(j, i);
    }
  };
  struct Listed {
    const Patches& patches;
    const Senders& senders;

    std::uint32_t texel(std::uint32_t s) const { return senders.list[s].texel; }
    float area_m2(std::uint32_t s) const { return senders.list[s].area_m2; }
    bool is_texel(std::uint32_t s) const {
      const Sender& sender = senders.list[s];
      return sender.point == Sender::kTexelsOwn && sender.area_m2 == patches.area_m2(sender.texel);
    }
    float visible_pairs(std::uint32_t i, std::uint32_t s) const {
      const Sender& sender = senders.list[s];
      return sender.point == Sender::kTexelsOwn ? patches.visible_pairs(i, sender.texel)
                                                : patches.visible_pairs(i);
    }
    const Patches::Point& point(std::uint32_t s, std::uint32_t i) const {
      const Sender& sender = senders.list[s];
      return sender.point == Sender::kTexelsOwn ? patches.point(sender.texel, i)
                                                : senders.points[sender.point];
    }
  };

  template <class Others, class Matters, class Use>
  std::uint64_t walk(std::uint32_t i, const Others& others, std::uint32_t begin, std::uint32_t end,
                     const SeenPairs* seen, const Matters& matters, const Use& use) const {
    Queue<Others, Use> queue(*this, i, others, use);
    const std::uint32_t samples = patches_.pair_samples();
    for (std::uint32_t s = begin; s < end; ++s) {
      const std::uint32_t j = others.texel(s);
      if (j == i) continue;
      const auto known = seen ? seen->ask(i, j) : SeenPairs::Answer::kUnknown;
      if (known == SeenPairs::Answer::kApart) continue;
      const std::uint32_t key = samples > 1 ? patches_.pair_key(i, j) : 0;
      bool excluded = false, asked = false;
      for (std::uint32_t k = 0; k < samples && !excluded; ++k) {
        const Patches::Ends ends = patches_.ends(i, j, key, k);
        const Patches::Point& one = patches_.point(i, ends.receiver);
        const Patches::Point& other = others.point(s, ends.sender);
        const Factors kernel = unoccluded(one, other);
        if (!matters(kernel)) continue;
        if (!asked) excluded = patches_.are_excluded(i, j), asked = true;
        if (excluded) continue;
        queue.add(s, kernel, one.origin, other.origin, known == SeenPairs::Answer::kSeen);
      }
    }
    queue.finish();
    return queue.traced();
  }

  /// Collects segments of a row until there are sixteen, and traces those of which nothing is
  /// known. The segments of a pair follow each other, and their sum is passed on when those of the
  /// next pair begin.
  template <class Others, class Use>
  class Queue {
   public:
    Queue(const ViewFactors& factors, std::uint32_t i, const Others& others, const Use& use)
        : of_(factors), i_(i), others_(others), use_(use) {}

    void add(std::uint32_t j, Factors kernel, math::Vec3 at_i, math::Vec3 at_j, bool is_open) {
      j_[count_] = j, kernel_[count_] = kernel;
      lane_[count_] = is_open ? kOpen : packet_.count;
      if (!is_open) i_ < others_.texel(j) ? packet_.add(at_i, at_j) : packet_.add(at_j, at_i);
      if (++count_ == 16) settle();
    }
    void finish() {
      settle();
      pass_on();
    }
    std::uint64_t traced() const { return traced_; }

   private:
    /// The lane of a segment that is known to be open: no bit of an answer.
    static constexpr std::uint32_t kOpen = 31;

    void settle() {
      const std::uint32_t blocked = packet_.count > 0 ? of_.visibility_.blocked(packet_) : 0;
      for (std::uint32_t s = 0; s < count_; ++s) {
        if (j_[s] != last_) pass_on(), last_ = j_[s];
        all_ += kernel_[s];
        if (!(blocked >> lane_[s] & 1)) sum_ += kernel_[s];
      }
      traced_ += packet_.count;
      packet_.count = count_ = 0;
    }
    void pass_on() {
      if (sum_.forth > 0 || sum_.back > 0) {
        const float a_i = of_.patches_.area_m2(i_), a_j = others_.area_m2(last_);
        const float scale = of_.scale_ * others_.visible_pairs(i_, last_);
        const Factors mean = mean_kernel();
        use_(last_, Factors{std::min(mean.forth * scale * a_j, std::min(1.f, a_j / a_i)),
                            std::min(mean.back * scale * a_i, std::min(1.f, a_i / a_j))});
      }
      sum_ = all_ = {};
    }
    /// Returns the mean over the samples of the last pair, what is hidden left out.
    Factors mean_kernel() {
      const std::uint32_t j = others_.texel(last_);
      if (!of_.near_ || !others_.is_texel(last_) || !of_.near_->is_near(i_, j))
        return {sum_.forth * of_.per_sample_, sum_.back * of_.per_sample_};
      if (!points_) points_ = of_.near_->points(i_);
      const NearField::Kernel all = NearField::mean(*points_, of_.near_->points(j));
      return {sum_.forth > 0 ? all.forth * (sum_.forth / all_.forth) : 0,
              sum_.back > 0 ? all.back * (sum_.back / all_.back) : 0};
    }

    const ViewFactors& of_;
    const std::uint32_t i_;
    const Others& others_;
    const Use& use_;
    trace::SegmentPacket packet_;
    std::uint32_t j_[16]{}, lane_[16]{}, count_ = 0;
    Factors kernel_[16];
    std::uint32_t last_ = 0;
    Factors sum_, all_;                        ///< kernels of the last pair: seen, and hidden too
    std::optional<NearField::Points> points_;  ///< of texel i, once a near one needs them
    std::uint64_t traced_ = 0;
  };

  const Patches& patches_;
  const trace::Visibility& visibility_;
  const float scale_, per_sample_;
  std::optional<NearField> near_;  ///< none: the formula everywhere
};

}  // namespace kiln::solver::pairwise
