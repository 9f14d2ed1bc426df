#pragma once

#include <cstdint>
#include <span>
#include <stop_token>

namespace kiln::atlas {

struct PackRect {
  std::uint32_t width = 0, height = 0;
  std::uint32_t x = 0, y = 0;  ///< result: lower corner
};

/// Places the rectangles in a square of `size` without overlap or rotation (skyline, tallest
/// first). Returns false when they do not all fit, or when stopped; x and y are then meaningless.
/// Equal input gives equal results. stb_rect_pack has the same skyline, but can't be stopped, and
/// would place the charts of every scene elsewhere: pages and resumed bakes would change.
bool pack_square(std::span<PackRect>, std::uint32_t size, const std::stop_token&);

}  // namespace kiln::atlas
