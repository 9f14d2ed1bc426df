#pragma once

#include <cstdint>
#include <cstdlib>
#include <stop_token>
#include <vector>

#include "baker/solver/footprint.h"
#include "baker/solver/pairwise/patch_columns.h"
#include "baker/solver/world.h"

namespace kiln::solver::pairwise {

/// The texels as patches that exchange light: the points between which view factors are taken.
/// Immutable; callable from many threads.
///
/// With one sample a pair, a patch has one point, in the middle of its texel [RTRad eq. 4.6]. With
/// more it has the sixteen points of its footprint, and pairs of them are drawn.
///
/// Where a part of a texel lies inside other geometry, see hidden_points(), the one point is among
/// those that do not, and visible_share() is below 1. RTRad does not know of that.
class Patches {
 public:
  static constexpr std::uint32_t kPoints = atlas::TextureGroup::kPointsPerTexel;

  /// Takes memory_per_texel() for every texel. When stopped, it ends early and must not be used.
  Patches(const World&, std::uint32_t pair_samples, const std::stop_token& = {});
  static double memory_per_texel(std::uint32_t pair_samples);

  std::uint32_t size() const { return texels_.size(); }
  std::uint32_t pair_samples() const { return pair_samples_; }
  float area_m2(std::uint32_t texel) const { return texels_.area_m2[texel]; }
  /// Returns the share of a texel's points that is not hidden.
  float visible_share(std::uint32_t texel) const { return visible_share_[texel]; }
  /// Returns what a view factor between the points of two texels is worth: the share of pairs of
  /// points that is not hidden, which rays between many points find out by themselves.
  float visible_pairs(std::uint32_t a, std::uint32_t b) const {
    return pair_samples_ == 1 ? visible_share_[a] * visible_share_[b] : 1;
  }
  /// Returns proto::SolverSettings::window, or what null stands for.
  std::uint32_t window() const { return std::uint32_t(window_); }

  Point point(std::uint32_t texel, std::uint32_t i) const {
    return pair_samples_ == 1 ? patches_[texel].point : points_[std::size_t(texel) * kPoints + i];
  }
  /// Returns all of them, where each is one point.
  const PatchColumns& columns() const { return patches_; }
  /// Returns a texel that is one point.
  Patch patch(std::uint32_t texel) const { return patches_[texel]; }
  /// Returns the point in the middle of a texel.
  Point middle(std::uint32_t texel) const;

  /// The points of sample k of the pair of two texels: for one unordered pair always the same,
  /// whichever of the two is asked about. The samples of a pair are different pairs of points, up
  /// to all 256; every sixteen in a row take each point of either texel once.
  struct Ends {
    std::uint32_t receiver = 0, sender = 0;
  };
  Ends ends(std::uint32_t receiver, std::uint32_t sender, std::uint32_t pair_key,
            std::uint32_t k) const;
  std::uint32_t pair_key(std::uint32_t receiver, std::uint32_t sender) const;

  /// Returns whether two texels are too near to each other on one chart to exchange light, see
  /// proto::SolverSettings::window.
  bool are_excluded(std::uint32_t a, std::uint32_t b) const {
    return texels_.chart[a] == texels_.chart[b] &&
           std::abs(std::int32_t(texels_.x[a]) - std::int32_t(texels_.x[b])) < window_ &&
           std::abs(std::int32_t(texels_.y[a]) - std::int32_t(texels_.y[b])) < window_;
  }

 private:
  Point middle_of(const World&, std::uint32_t texel, const Footprint&, std::uint32_t hidden) const;

  const atlas::TextureGroup& texels_;
  const std::uint32_t pair_samples_;
  const std::int32_t window_;  ///< texels
  const std::uint32_t seed_;
  PatchColumns patches_;       ///< with one sample a pair
  std::vector<Point> points_;  ///< with more: sixteen of each texel
  std::vector<float> visible_share_;
};

}  // namespace kiln::solver::pairwise
