#pragma once

#include <cstdint>
#include <span>
#include <stop_token>
#include <vector>

#include "proto/bake_settings.h"
#include "proto/expected.h"

namespace kiln::atlas {

/// A rectangle that wants a place on a page: an unwrapped chart, or all of a source layout.
struct Block {
  std::uint32_t group = 0;       ///< blocks of one group lie on one page; ascending over the blocks
  double width = 0, height = 0;  ///< m
};

/// Where a block came to lie: whole texels.
struct Place {
  std::uint32_t page = 0;
  std::uint32_t x = 0, y = 0, width = 0, height = 0;
};

struct Layout {
  double texels_per_metre = 0;
  std::uint32_t pages = 0;
  std::vector<Place> places;  ///< parallel to the blocks
};

/// Places all blocks with `gutter` empty texels around each, sides rounded up to whole texels (at
/// least one). At the density of the settings, on as many pages as that takes; or at the highest
/// density (to 0.2 %) that fits one page, and on more pages only when not even one texel per block
/// fits. Errors: `atlas_full`, `canceled`.
proto::Expected<Layout> lay_out_blocks(std::span<const Block>, const proto::AtlasSettings&,
                                       std::stop_token);

/// Which change of one setting alone would let lay_out_blocks() succeed; 0 where none would.
struct Remedy {
  std::uint32_t page_size = 0;  ///< the least power of two
  std::uint32_t max_pages = 0;  ///< the least
};

/// For blocks that were refused as `atlas_full`. Blocks that another page size gave may differ.
Remedy find_remedy(std::span<const Block>, const proto::AtlasSettings&, std::stop_token);

}  // namespace kiln::atlas
