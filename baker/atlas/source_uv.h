#pragma once

#include <cstdint>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "baker/scene/scene.h"

namespace kiln::atlas {

/// Whether an instance's TEXCOORD_1 can hold a lightmap.
struct SourceUv {
  bool valid = false;
  std::string reason;               ///< why not
  std::uint32_t part = 0;           ///< where
  math::Vec2 min{0, 0}, max{1, 1};  ///< bounds of a valid one, within [0, 1]
  double uv_area = 0;               ///< of a valid one, page = 1
  double world_area = 0;            ///< m2, of the faces with area in UV
};

/// Checks each instance by itself. Valid means: every primitive has TEXCOORD_1, finite and within
/// [0, 1]; nearly all of the surface has area in UV space; no connected piece folds over itself; no
/// two faces overlap deeper than rounding does. A piece that is mirrored as a whole is valid:
/// irradiance has no direction on the page, and tools write such layouts. `texels`: side of the
/// page that the layout will have at most, which sets how fine the overlap test is. Empty when
/// stopped.
std::vector<SourceUv> check_source_uv(const scene::Scene&, std::uint32_t texels, std::stop_token);

/// Whether the layouts of these instances, valid each by itself, share one page without overlap.
bool share_one_page(const scene::Scene&, std::span<const std::uint32_t> instances,
                    std::uint32_t texels, std::stop_token);

}  // namespace kiln::atlas
