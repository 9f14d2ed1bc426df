#pragma once

#include <cstdint>

#include "proto/bake_settings.h"

namespace kiln::solver {
struct World;
}

namespace kiln::solver::gather {

/// How the rays of a gather are put into packets of sixteen: packets are fast where their rays stay
/// together. Any pattern gives unbiased light; which one a bake has fixes its samples.
class PacketLayout {
 public:
  /// @param directions of each texel at first; what is added later keeps the plan
  PacketLayout(const World&, std::uint32_t directions);

  /// As the setting solver.ray_pattern names it, never "auto".
  const char* name() const;
  /// Texels whose rays share a packet.
  std::uint32_t texels() const;
  /// Whether the directions of one texel are put in an order that keeps neighbors together.
  bool sorts_directions() const;
  /// Bits of the coordinates of a direction that all texels of a tile scramble alike. Each has the
  /// same cells of the hemisphere then, one after the other, and places its own directions inside
  /// them: its samples are a scrambled net of its own, whose errors are its own as well. There are
  /// two directions to a cell, one of either half of the samples, so that the halves of neighbors
  /// don't differ alike.
  std::uint32_t shared_x() const { return shared_x_; }
  std::uint32_t shared_y() const { return shared_y_; }

 private:
  proto::RayPattern pattern_;
  std::uint32_t shared_x_ = 0, shared_y_ = 0;
};

}  // namespace kiln::solver::gather
