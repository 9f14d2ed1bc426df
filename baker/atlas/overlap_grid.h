#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "baker/atlas/clip.h"

namespace kiln::atlas {

/// Finds triangles of a plane layout that lie on each other, by one sample per grid cell: bounded
/// time and memory whatever the triangles are. A single overlap is `deep` when both triangles hold
/// the sample at least half a cell from their edges; shallow ones come from rounding at shared
/// edges, and matter by their number only.
class OverlapGrid {
 public:
  using Triangle = std::array<Point, 3>;  ///< in cells

  /// Starts a new layout on a grid of size x size cells. Takes no time for clearing: memory grows
  /// to the largest size that was asked for.
  void begin(std::uint32_t size);

  static constexpr std::uint32_t kNone = 0xffffffffu;
  struct Finding {
    std::uint64_t samples = 0;        ///< cells whose sample lies in the triangle
    std::uint64_t shallow = 0;        ///< of these, taken by others
    std::uint32_t deep_with = kNone;  ///< number of a triangle that overlaps deeply
  };
  /// What would be below the triangle. Stops at the first deep overlap.
  Finding probe(const Triangle&) const;
  /// Adds the triangle; they are numbered from 0 in order of adding. Cells that are taken stay with
  /// their first owner.
  void add(const Triangle&);

 private:
  template <class Visit>
  void for_samples(const Triangle&, Visit&&) const;

  std::uint32_t size_ = 0;
  std::uint32_t base_ = 0;  ///< owners below are of earlier layouts
  std::vector<std::uint32_t> owner_;
  std::vector<Triangle> triangles_;
};

}  // namespace kiln::atlas
