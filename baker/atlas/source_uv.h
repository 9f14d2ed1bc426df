#pragma once

#include <cstdint>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "baker/scene/scene.h"

namespace kiln::atlas {

/// The verdict on an instance's TEXCOORD_1: can it hold a lightmap?
struct SourceUv {
  bool valid = false;
  std::string reason;               ///< why it can't
  std::uint32_t part = 0;           ///< the part that is at fault
  math::Vec2 min{0, 0}, max{1, 1};  ///< bounds of a valid one, within [0, 1]
  double uv_area = 0;               ///< area of a valid layout, page = 1
  double world_area = 0;            ///< m2, of the faces with area in UV
};

/// Checks each instance by itself. An instance is valid when every primitive has TEXCOORD_1, finite
/// and within [0, 1]; nearly all of the surface has area in UV space; no connected piece folds over
/// itself; and no two faces overlap deeper than rounding does. A piece that is mirrored as a whole
/// is valid: irradiance has no direction on the page, and tools write such layouts. `texels` is the
/// largest side of the page that the layout may get; it sets how fine the overlap test is. Returns
/// nothing when stopped.
std::vector<SourceUv> check_source_uv(const scene::Scene&, std::uint32_t texels, std::stop_token);

/// Returns whether the layouts of these instances, each valid by itself, share one page without
/// overlap. The answer means nothing when stopped.
bool share_one_page(const scene::Scene&, std::span<const std::uint32_t> instances,
                    std::uint32_t texels, std::stop_token);

}  // namespace kiln::atlas
