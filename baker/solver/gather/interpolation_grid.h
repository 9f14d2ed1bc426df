#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "baker/atlas/texture_group.h"
#include "baker/exec/workers.h"
#include "baker/lightmap/lightmap.h"
#include "baker/trace/texel_surface.h"

namespace kiln::solver::gather {

/// Indirect light varies slowly over a surface: it is gathered at every second texel of a row and
/// of a column, the sites, and interpolated between them where they agree.
class InterpolationGrid {
 public:
  explicit InterpolationGrid(const atlas::TextureGroup& texels) : texels_(texels) {}

  struct Sites {
    std::array<std::uint32_t, 4> texel{};
    std::uint32_t count = 0;
    std::span<const std::uint32_t> all() const { return {texel.data(), count}; }
  };
  /// The sites around a texel between which it may be interpolated: two or four, all of its own
  /// chart and turned much as it is. None for a site itself, and where one of them is missing.
  Sites around(std::uint32_t texel) const;

  /// Whether the sky and indirect light of the sites differs so little that their mean will do:
  /// within 6 % of what there is, direct light included, none of them hidden even in part.
  bool agree(const Sites&, const lightmap::Lightmap&) const;

  /// Fills the texels that do not gather with the means of their sites: indirect light, and sky
  /// light with `sky_too`, which says the number of samples as well: `samples` at least. False when
  /// stopped.
  bool interpolate(lightmap::Lightmap&, bool sky_too, std::uint32_t samples,
                   const exec::Workers&) const;

 private:
  const atlas::TextureGroup& texels_;
};

}  // namespace kiln::solver::gather
