#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "baker/atlas/clip.h"

namespace kiln::atlas {

/// Finds triangles of a plane layout that overlap, by one sample per grid cell. Time and memory are
/// bounded whatever the triangles are. An overlap is `deep` when both triangles hold the sample at
/// least half a cell from their edges. Shallow overlaps come from rounding at shared edges; only
/// their number matters.
class OverlapGrid {
 public:
  using Triangle = std::array<Point, 3>;  ///< in cells

  /// Starts a new layout on a grid of size x size cells. It need not clear the cells. Memory grows
  /// to the largest size so far.
  void begin(std::uint32_t size);

  static constexpr std::uint32_t kNone = 0xffffffffu;
  struct Finding {
    std::uint64_t samples = 0;        ///< cells whose sample lies in the triangle
    std::uint64_t shallow = 0;        ///< those of these cells that other triangles own
    std::uint32_t deep_with = kNone;  ///< number of a triangle that overlaps deeply
  };
  /// Reports what the triangle would overlap. It stops at the first deep overlap.
  Finding probe(const Triangle&) const;
  /// Adds the triangle. Triangles are numbered from 0 in the order of adding. A cell stays with its
  /// first owner.
  void add(const Triangle&);

 private:
  template <class Visit>
  void for_samples(const Triangle&, Visit&&) const;

  std::uint32_t size_ = 0;
  std::uint32_t base_ = 0;  ///< smaller owners belong to earlier layouts
  std::vector<std::uint32_t> owner_;
  std::vector<Triangle> triangles_;
};

}  // namespace kiln::atlas
