#pragma once

#include <algorithm>
#include <bit>
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
        kernels_(simd::kernels()),
        rule_{1 / (math::kPi * world.settings.distance_factor * world.settings.distance_factor), 0,
              std::int32_t(patches.window())} {
    if (!world.settings.near_field) return;
    near_.emplace(world);
    rule_.near_widths2 = NearField::kReach * NearField::kReach;
  }

  /// Calls `use(s, F)` for the senders that give light to texel i, in their order; `s` is the place
  /// in the list. Pairs of points that turn away from each other are skipped before they are
  /// traced, and so are those within a window.
  /// @param senders gathered, see Senders::gather()
  /// @param seen what is known already; may be null, and needs senders that are texels, with one
  ///        sample a pair. The factors are the same without it.
  /// @return rays traced
  template <class Use>
  std::uint64_t row(std::uint32_t i, const Senders& senders, const SeenPairs* seen,
                    const Use& use) const {
    return walk(i, Listed{patches_, senders}, 0, std::uint32_t(senders.list.size()), seen,
                Ways::kForth, [&](std::uint32_t s, Factors f) { use(s, f.forth); });
  }
  /// Calls `use(j, Factors)` for the texels of [begin, end) that exchange light with texel i,
  /// either way. @return rays traced
  template <class Use>
  std::uint64_t pairs(std::uint32_t i, std::uint32_t begin, std::uint32_t end,
                      const Use& use) const {
    return walk(i, Texels{patches_}, begin, end, nullptr, Ways::kBoth, use);
  }

  /// Returns cosθ cosθ'/r² either way, 1/m², without what may stand between; 0 when the points turn
  /// away from each other.
  static Factors unoccluded(const Point& a, const Point& b) {
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
    Point point(std::uint32_t j, std::uint32_t k) const { return patches.point(j, k); }
    const PatchColumns& columns() const { return patches.columns(); }
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
    Point point(std::uint32_t s, std::uint32_t k) const {
      const Sender& sender = senders.list[s];
      return sender.point == Sender::kTexelsOwn ? patches.point(sender.texel, k)
                                                : senders.points[sender.point];
    }
    const PatchColumns& columns() const { return senders.columns; }
  };

  /// Which ways of a pair count.
  enum class Ways { kForth, kBoth };

  /// The factors of one texel with those that are near to it.
  class NearFactors {
   public:
    NearFactors(const ViewFactors& of, std::uint32_t i) : of_(of), i_(i) {}

    /// @param far the factors by the formula; the mean takes the place of those above 0
    /// @param open share of the formula's own pairs of points that is open
    Factors operator()(std::uint32_t j, Factors far, Factors open = {1, 1}) {
      if (!points_) points_ = of_.near_->points(i_);
      const NearField::Kernel all = NearField::mean(*points_, of_.near_->points(j));
      const Factors mean{far.forth > 0 ? all.forth * open.forth : 0,
                         far.back > 0 ? all.back * open.back : 0};
      return of_.factors(mean, of_.patches_.visible_pairs(i_, j), of_.patches_.area_m2(i_),
                         of_.patches_.area_m2(j));
    }

   private:
    const ViewFactors& of_;
    const std::uint32_t i_;
    std::optional<NearField::Points> points_;  ///< of texel i, once a near one needs them
  };

  template <class Others, class Use>
  std::uint64_t walk(std::uint32_t i, const Others& others, std::uint32_t begin, std::uint32_t end,
                     const SeenPairs* seen, Ways ways, const Use& use) const {
    if (patches_.pair_samples() == 1) return walk_patches(i, others, begin, end, seen, ways, use);
    return walk_samples(i, others, begin, end, ways, use);
  }

  /// Goes through pairs of texels that are one point each, sixteen at a time.
  template <class Others, class Use>
  std::uint64_t walk_patches(std::uint32_t i, const Others& others, std::uint32_t begin,
                             std::uint32_t end, const SeenPairs* seen, Ways ways,
                             const Use& use) const {
    const simd::PatchColumns one = patches_.columns().view(), all = others.columns().view();
    const math::Vec3 origin = patches_.columns().origin(i);
    NearFactors near(*this, i);
    const auto pass_on = [&](std::uint32_t s, Factors f, bool is_near) {
      use(s, is_near && others.is_texel(s) ? near(others.texel(s), f) : f);
    };
    Segments<decltype(pass_on)> segments(visibility_, pass_on);
    simd::Exchange exchange;
    for (std::uint32_t first = begin; first < end; first += 16) {
      kernels_.exchange(one, i, all, first, rule_, exchange);
      std::uint32_t left = exchange.gives | (ways == Ways::kBoth ? exchange.takes : 0);
      if (end - first < 16) left &= (1u << (end - first)) - 1;
      for (; left != 0; left &= left - 1) {
        const auto lane = std::uint32_t(std::countr_zero(left));
        const std::uint32_t s = first + lane, j = others.texel(s);
        const auto known = seen ? seen->ask(i, j) : SeenPairs::Answer::kUnknown;
        if (known == SeenPairs::Answer::kApart) continue;
        segments.add(s, {exchange.forth[lane], exchange.back[lane]}, exchange.near >> lane & 1,
                     known == SeenPairs::Answer::kSeen, i < j, origin, others.columns().origin(s));
      }
    }
    return segments.finish();
  }

  /// Collects segments of a row until there are sixteen, traces those of which nothing is known,
  /// and passes on those that are open, in the order in which they came.
  template <class PassOn>
  class Segments {
   public:
    Segments(const trace::Visibility& visibility, const PassOn& pass_on)
        : visibility_(visibility), pass_on_(pass_on) {}

    void add(std::uint32_t s, Factors factors, bool is_near, bool is_open, bool from_one,
             math::Vec3 one, math::Vec3 other) {
      number_[count_] = s, factors_[count_] = factors, near_ |= std::uint32_t(is_near) << count_;
      lane_[count_] = is_open ? kOpen : packet_.count;
      if (!is_open) from_one ? packet_.add(one, other) : packet_.add(other, one);
      if (++count_ == 16) settle();
    }
    /// @return rays traced
    std::uint64_t finish() {
      settle();
      return traced_;
    }

   private:
    /// The lane of a segment that is known to be open: no bit of an answer.
    static constexpr std::uint32_t kOpen = 31;

    void settle() {
      const std::uint32_t blocked = packet_.count > 0 ? visibility_.blocked(packet_) : 0;
      for (std::uint32_t k = 0; k < count_; ++k)
        if (!(blocked >> lane_[k] & 1)) pass_on_(number_[k], factors_[k], near_ >> k & 1);
      traced_ += packet_.count;
      packet_.count = count_ = near_ = 0;
    }

    const trace::Visibility& visibility_;
    const PassOn& pass_on_;
    trace::SegmentPacket packet_;
    std::uint32_t number_[16], lane_[16], count_ = 0, near_ = 0;
    Factors factors_[16];
    std::uint64_t traced_ = 0;
  };

  /// Goes through pairs of texels with several points each.
  template <class Others, class Use>
  std::uint64_t walk_samples(std::uint32_t i, const Others& others, std::uint32_t begin,
                             std::uint32_t end, Ways ways, const Use& use) const {
    Samples<Others, Use> samples(*this, i, others, use);
    for (std::uint32_t s = begin; s < end; ++s) {
      const std::uint32_t j = others.texel(s);
      if (patches_.are_excluded(i, j)) continue;
      const std::uint32_t key = patches_.pair_key(i, j);
      for (std::uint32_t k = 0; k < patches_.pair_samples(); ++k) {
        const Patches::Ends ends = patches_.ends(i, j, key, k);
        const Point one = patches_.point(i, ends.receiver), other = others.point(s, ends.sender);
        const Factors kernel = unoccluded(one, other);
        if (kernel.forth > 0 || (ways == Ways::kBoth && kernel.back > 0))
          samples.add(s, kernel, one.origin, other.origin);
      }
    }
    return samples.finish();
  }

  /// Collects samples of pairs until there are sixteen, and traces them. Those of a pair follow
  /// each other, and its factors are passed on when the samples of the next pair begin.
  template <class Others, class Use>
  class Samples {
   public:
    Samples(const ViewFactors& factors, std::uint32_t i, const Others& others, const Use& use)
        : of_(factors), near_(factors, i), i_(i), others_(others), use_(use) {}

    void add(std::uint32_t s, Factors kernel, math::Vec3 one, math::Vec3 other) {
      number_[packet_.count] = s, kernel_[packet_.count] = kernel;
      i_ < others_.texel(s) ? packet_.add(one, other) : packet_.add(other, one);
      if (packet_.is_full()) settle();
    }
    /// @return rays traced
    std::uint64_t finish() {
      settle();
      pass_on();
      return traced_;
    }

   private:
    void settle() {
      const std::uint32_t blocked = packet_.count > 0 ? of_.visibility_.blocked(packet_) : 0;
      for (std::uint32_t k = 0; k < packet_.count; ++k) {
        if (number_[k] != last_) pass_on(), last_ = number_[k];
        all_ += kernel_[k];
        if (!(blocked >> k & 1)) open_ += kernel_[k];
      }
      traced_ += packet_.count;
      packet_.count = 0;
    }
    void pass_on() {
      if (open_.forth > 0 || open_.back > 0) {
        const std::uint32_t j = others_.texel(last_);
        const float part = 1 / float(of_.patches_.pair_samples());
        const Factors far = of_.factors({open_.forth * part, open_.back * part}, 1,
                                        of_.patches_.area_m2(i_), others_.area_m2(last_));
        const bool is_near = of_.near_ && others_.is_texel(last_) && of_.near_->is_near(i_, j);
        use_(last_,
             is_near ? near_(j, far, {share(open_.forth, all_.forth), share(open_.back, all_.back)})
                     : far);
      }
      open_ = all_ = {};
    }
    static float share(float part, float whole) { return whole > 0 ? part / whole : 0; }

    const ViewFactors& of_;
    NearFactors near_;
    const std::uint32_t i_;
    const Others& others_;
    const Use& use_;
    trace::SegmentPacket packet_;
    std::uint32_t number_[16];
    Factors kernel_[16];
    std::uint32_t last_ = 0;
    Factors open_, all_;  ///< sums of the samples of the last pair
    std::uint64_t traced_ = 0;
  };

  /// Returns view factors of a mean kernel. @param worth share of the pairs of points that counts
  Factors factors(Factors mean, float worth, float a_i, float a_j) const {
    const float scale = rule_.scale * worth;
    return {std::min(mean.forth * scale * a_j, std::min(1.f, a_j / a_i)),
            std::min(mean.back * scale * a_i, std::min(1.f, a_i / a_j))};
  }

  const Patches& patches_;
  const trace::Visibility& visibility_;
  const simd::Kernels& kernels_;
  simd::ExchangeRule rule_;
  std::optional<NearField> near_;  ///< none: the formula everywhere
};

}  // namespace kiln::solver::pairwise
