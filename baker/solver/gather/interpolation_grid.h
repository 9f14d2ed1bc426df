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
  /// Returns the sites around a texel between which it may be interpolated: two or four, all of its
  /// own chart and with much the same normal. There are none for a site itself, or when one of them
  /// is missing.
  Sites around(std::uint32_t texel) const;

  /// Returns whether the sky and indirect light of the sites differs so little that their mean is
  /// good enough: it is within 6 % of what there is, direct light included, and no site is hidden
  /// even in part.
  bool agree(const Sites&, const lightmap::Lightmap&) const;

  /// Fills the texels that do not gather with the means of their sites: indirect light, and with
  /// `sky_too` sky light and the number of samples, which is `samples` at least. Returns false when
  /// stopped.
  bool interpolate(lightmap::Lightmap&, bool sky_too, std::uint32_t samples,
                   const exec::Workers&) const;

 private:
  const atlas::TextureGroup& texels_;
};

}  // namespace kiln::solver::gather
