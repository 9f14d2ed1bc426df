#pragma once

#include <cstdint>
#include <span>
#include <stop_token>
#include <vector>

#include "proto/bake_settings.h"
#include "proto/expected.h"

namespace kiln::atlas {

/// A rectangle to place on a page: an unwrapped chart, or a whole source layout.
struct Block {
  std::uint32_t group = 0;       ///< blocks of one group lie on one page; ascending over the blocks
  double width = 0, height = 0;  ///< m
};

/// The place of a block on its page, in whole texels.
struct Place {
  std::uint32_t page = 0;
  std::uint32_t x = 0, y = 0, width = 0, height = 0;
};

struct Layout {
  double texels_per_metre = 0;
  std::uint32_t pages = 0;
  std::vector<Place> places;  ///< parallel to the blocks
};

/// Places all blocks with `gutter` empty texels around each. Sides are rounded up to whole texels,
/// at least one. With a density in the settings it takes as many pages as that density needs.
/// Without one it takes the highest density (to 0.2 %) that fits one page, and more pages only when
/// not even one texel per block fits. Errors: `atlas_full`, `canceled`.
proto::Expected<Layout> lay_out_blocks(std::span<const Block>, const proto::AtlasSettings&,
                                       std::stop_token);

/// The changes of one setting alone that would let lay_out_blocks() succeed; 0 where none would.
struct LayoutAdvice {
  std::uint32_t page_size = 0;  ///< the least power of two that is enough
  std::uint32_t max_pages = 0;  ///< the least that is enough
};

/// Finds advice for blocks that lay_out_blocks() refused as `atlas_full`. It takes the blocks as
/// they are, although unwrapping for another page size may cut them differently.
LayoutAdvice find_layout_advice(std::span<const Block>, const proto::AtlasSettings&,
                                std::stop_token);

}  // namespace kiln::atlas
