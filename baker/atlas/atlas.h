#pragma once

#include <array>
#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

#include "baker/math/vec.h"
#include "baker/scene/scene.h"
#include "proto/bake_settings.h"
#include "proto/expected.h"

namespace kiln::atlas {

/// A vertex of the scene at one place on its page. A scene vertex on a seam between charts appears
/// once per chart.
struct AtlasVertex {
  std::uint32_t scene_vertex = 0;
  math::Vec2 uv;  ///< texels on the page, (0,0) = outer corner of the top left texel
};

/// A connected piece of surface laid flat, bounded by seams.
struct Chart {
  std::uint32_t instance = 0;
  std::uint32_t page = 0;
  math::Vec2 min, max;  ///< bounds in texels
};

/// The place of one instance on the pages, as the manifest reports it.
struct InstancePlacement {
  std::uint32_t page = 0;
  bool uses_source_uv = false;
  math::Vec2 scale{1, 1}, offset{0, 0};  ///< page uv (0..1) = source TEXCOORD_1 * scale + offset
  std::string reason;                    ///< the reason why TEXCOORD_1 is not used
};

/// The map from surface to pages. Immutable once built.
struct Atlas {
  std::uint32_t page_size = 0;
  std::uint32_t page_count = 0;
  float texels_per_metre = 0;                    ///< median over the surface
  std::vector<AtlasVertex> vertices;             ///< part k owns [part_first_vertex[k], [k+1])
  std::vector<std::uint32_t> part_first_vertex;  ///< parts + 1 entries
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< parallel to Scene::triangles
  std::vector<std::uint32_t> triangle_chart;            ///< parallel to Scene::triangles
  std::vector<Chart> charts;
  std::vector<InstancePlacement> placements;  ///< parallel to Scene::instances

  std::uint32_t page_of(std::uint32_t triangle) const {
    return charts[triangle_chart[triangle]].page;
  }
  /// Returns the page coordinates, in texels, of a point on a triangle.
  math::Vec2 uv_at(std::uint32_t triangle, scene::Bary t) const {
    const auto& v = triangles[triangle];
    return vertices[v[0]].uv * (1 - t.u - t.v) + vertices[v[1]].uv * t.u + vertices[v[2]].uv * t.v;
  }
};

/// Places every instance on the pages. It uses TEXCOORD_1 where that is a valid lightmap
/// parameterization and unwraps the instance otherwise. TEXCOORD_1 is valid when it is finite and
/// in [0, 1], its faces have area and do not overlap, and no connected piece folds over itself (a
/// piece mirrored as a whole is valid).
///
/// When all instances are valid and lie on one page without overlap, that page is taken as it is
/// and `texels_per_metre` does not apply. Beside unwrapped instances such a group keeps its shape
/// and is scaled as one. Otherwise each valid instance gets a rectangle of its own.
///
/// Errors: `invalid_lightmap_uv` (unwrap = existing), `canceled`, and `atlas_full`, whose message
/// names settings that are large enough. They are found by trying, which may take up to six times
/// as long again.
proto::Expected<Atlas> build_atlas(const scene::Scene&, const proto::AtlasSettings&,
                                   std::stop_token = {});

}  // namespace kiln::atlas
