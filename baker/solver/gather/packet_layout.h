#pragma once

#include <cstdint>

#include "proto/bake_settings.h"

namespace kiln::solver {
struct World;
}

namespace kiln::solver::gather {

/// Decides how the rays of a gather are put into packets of sixteen. Packets are fast when their
/// rays stay together. Any pattern gives unbiased light; the pattern of a bake fixes its samples.
class PacketLayout {
 public:
  /// @param directions of each texel at first; what is added later keeps the plan
  PacketLayout(const World&, std::uint32_t directions);

  /// Returns the pattern's name in the setting solver.ray_pattern, never "auto".
  const char* name() const;
  /// Returns the number of texels whose rays share a packet.
  std::uint32_t texels() const;
  /// Returns whether the directions of one texel are ordered so that neighbors stay together.
  bool sorts_directions() const;
  /// Returns the bits of the coordinates of a direction that all texels of a tile scramble alike.
  /// Each texel then has the same cells of the hemisphere, one after the other, and places its own
  /// directions inside them: its samples are a scrambled net of its own, with errors of its own.
  /// There are two directions to a cell, one of either half of the samples, so that the halves of
  /// neighbors don't differ alike.
  std::uint32_t shared_x() const { return shared_x_; }
  std::uint32_t shared_y() const { return shared_y_; }

 private:
  proto::RayPattern pattern_;
  std::uint32_t shared_x_ = 0, shared_y_ = 0;
};

}  // namespace kiln::solver::gather
