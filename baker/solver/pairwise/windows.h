#pragma once

#include <cstdint>
#include <span>
#include <stop_token>
#include <vector>

#include "baker/solver/world.h"

namespace kiln::solver::pairwise {

/// The texels by windows: every page is tiled with squares of so many texels, from its upper left
/// corner on. The backs of texels have windows of their own. A window has at least one texel, and
/// may have texels of several charts. Windows are in the order of their first texels. Immutable.
class Windows {
 public:
  /// When stopped, it ends early and must not be used. @param texels outlives this
  Windows(const atlas::TextureGroup& texels, std::uint32_t side, const std::stop_token& = {});

  std::uint32_t size() const { return std::uint32_t(places_.size()); }
  /// Returns the texels of a window, in rising order.
  std::span<const std::uint32_t> texels(std::uint32_t window) const {
    return {order_.data() + starts_[window], starts_[window + 1] - starts_[window]};
  }
  float area_m2(std::uint32_t window) const { return area_up_to_[starts_[window + 1] - 1]; }
  /// Returns a number of the window that hangs on its place on the pages alone.
  std::uint32_t place(std::uint32_t window) const { return places_[window]; }
  /// Returns the texel at the share `u` of the window's area, in [0, 1).
  std::uint32_t texel_at(std::uint32_t window, float u) const;

 private:
  std::vector<std::uint32_t> order_;   ///< texels, by windows
  std::vector<std::uint32_t> starts_;  ///< of the windows in `order_`, and the end of the last
  std::vector<std::uint32_t> places_;
  std::vector<float> area_up_to_;  ///< parallel to `order_`: area of the window's texels so far
};

}  // namespace kiln::solver::pairwise
