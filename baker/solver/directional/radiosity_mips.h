#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "baker/exec/workers.h"
#include "baker/lightmap/lightmap.h"
#include "baker/solver/world.h"

namespace kiln::solver::directional {

/// The radiosity of all texels, and its means over squares of 2, 4, 8 and more texels a side
/// [RTRad §5.4: a ray reads a higher mip level]. A square's mean is over the texels of one chart
/// and one side, weighted by the area of theirs that can be seen, so that charts are never mixed
/// and empty texels count for nothing. The squares of a level are aligned to the page.
class RadiosityMips {
 public:
  /// The coarsest level: squares of 256 texels a side.
  static constexpr int kCoarsest = 8;
  /// The memory of a texel and of its part of the squares, bytes, while they are made.
  static constexpr double kMemoryPerTexel = 60;

  /// Takes the radiosity of a light. E is the mean over a texel's footprint, and rays meet only
  /// what of it is not inside other geometry: B = albedo · E / validity. What is nearly all hidden
  /// reads the mean of the square around it. Returns false when stopped. @param emittance M of the
  /// texels, lx, which they send besides; may be empty
  bool read(const World&, const lightmap::Lightmap&, std::span<const math::Rgb> emittance,
            const exec::Workers&);

  /// Returns the radiosity around a texel, lx: the mean over the largest square around it whose
  /// area is at most about `spread_m2`, or the texel's own.
  math::Rgb at(std::uint32_t texel, float spread_m2) const {
    const Square* square = &squares_[texel];
    std::uint32_t index = texel;
    float texels = spread_m2 * square->texels_per_m2;
    for (int level = 0; texels >= 4 && level < kCoarsest; ++level, texels *= 0.25f)
      index = parent_[index];
    square = &squares_[index];
    return {square->r, square->g, square->b};
  }

 private:
  struct alignas(16) Square {
    float r = 0, g = 0, b = 0;
    float texels_per_m2 = 0;  ///< of a texel; not set for larger squares
  };
  struct Level;

  void read_texels(const World&, const lightmap::Lightmap&, std::span<const math::Rgb> emittance,
                   std::uint32_t begin, std::uint32_t end);
  Level first_level(const World&) const;
  Level next_level(const World&, const Level&);

  std::vector<Square> squares_;        ///< the texels first, then level by level
  std::vector<std::uint32_t> parent_;  ///< the square around each; itself where there is none
  std::vector<float> seen_m2_;         ///< area of each that can be seen
};

}  // namespace kiln::solver::directional
