#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <stop_token>
#include <vector>

#include "baker/solver/pairwise/patches.h"
#include "baker/solver/pairwise/windows.h"

namespace kiln::solver::pairwise {

/// What sends light to all texels: a texel, or one that stands for several.
struct Sender {
  static constexpr std::uint32_t kTexelsOwn = 0xffffffff;

  std::uint32_t texel = 0;           ///< the texel that it is, or whose place it takes
  std::uint32_t point = kTexelsOwn;  ///< of Senders::points; kTexelsOwn: the points of the texel
  float area_m2 = 0;                 ///< of all texels that it stands for
  math::Rgb radiosity;               ///< B, lx
};

/// The senders of a pass, without those that are black.
struct Senders {
  std::vector<Sender> list;
  std::vector<Point> points;
  PatchColumns columns;  ///< all of `list` once more, see gather()

  void clear() { list.clear(), points.clear(); }
  /// Fills `columns`. Does nothing where texels have many points.
  void gather(const Patches&);
};

/// Picks the senders of each pass, as the settings ask for. Whatever the choice, the areas of all
/// senders sum to the surface's. Immutable; callable from many threads.
///
/// - All texels.
/// - Undersampling [RTRad 5.1.1, 5.1.2]: one sender for each window, see Windows. It carries the
///   area of all texels of the window (eq. 5.1 has their number).
///   - stride: the upper left texel. Where several charts lie in the window, one of them is drawn
///   by
///     its area, once for the whole bake, and its upper left texel is taken.
///   - monte_carlo: a texel drawn by area, so that the mean over many draws is the light of all
///     texels. The draw hangs on the seed, the bounce and the window; with
///     SenderSeed::kReceiver on the receiver, too.
///   - mipmap: the mean position, normal and radiosity of the texels, weighted by area; one sender
///     for each chart in the window, so that no light leaks from one surface to another. Its point
///     is raised along its normal to the highest of the texels, so that a surface which bends
///     within the window does not hide it.
/// - A quadtree [RTRad 5.1.3], see Quadtree: one sender for each leaf, with the mean radiosity of
///   its texels, at that of them which is nearest to their mean position.
class SenderStrategy {
 public:
  /// Both outlive this. When stopped, it ends early and must not be used.
  SenderStrategy(const World&, const Patches&, const std::stop_token& = {});
  /// The most that senders, and what they are picked from, take. Bytes.
  static double memory_per_texel(const proto::SolverSettings&);

  /// Returns whether every receiver has senders of its own.
  bool are_per_receiver() const;
  /// Returns about how many senders a pass has, at most.
  double expected() const;
  /// Returns the senders of all receivers, or nothing when stopped. @param radiosity of the texels
  /// @param bounce from 0
  std::optional<Senders> pick(std::span<const math::Rgb> radiosity, std::uint32_t bounce,
                              const std::stop_token&) const;
  /// Puts the next senders of one receiver in place of `senders`: a few thousand, so that they stay
  /// in the caches. @param first the window to begin with @return the one to go on with, or 0 at
  /// the end
  std::uint32_t pick_for(std::uint32_t receiver, std::span<const math::Rgb> radiosity,
                         std::uint32_t bounce, std::uint32_t first, Senders& senders) const;

 private:
  void add_all(std::span<const math::Rgb> radiosity, Senders&) const;
  void add_first(std::uint32_t window, std::span<const math::Rgb> radiosity, Senders&) const;
  void add_drawn(std::uint32_t window, std::uint32_t seed, std::span<const math::Rgb> radiosity,
                 Senders&) const;
  void add_means(std::uint32_t window, std::span<const math::Rgb> radiosity, Senders&) const;
  void add_mean(std::span<const std::uint32_t> texels, std::span<const math::Rgb> radiosity,
                Senders&) const;
  bool add_leaves(std::span<const math::Rgb> radiosity, std::uint32_t bounce,
                  const std::stop_token&, Senders&) const;

  const atlas::TextureGroup& texels_;
  const Patches& patches_;
  const proto::SolverSettings& settings_;
  const std::uint32_t seed_;
  /// Of undersampling, or as large as the largest leaf of the quadtree; none when every texel
  /// sends.
  std::optional<Windows> windows_;
};

}  // namespace kiln::solver::pairwise
