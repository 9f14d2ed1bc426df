#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <stop_token>
#include <string>

#include "baker/gltf/accessors.h"

namespace kiln::import {

/// The import's limits on geometry, less what all parts of a scene so far have taken.
class GeometryBudget {
 public:
  explicit GeometryBudget(const files::ImportLimits& limits)
      : limits_(limits), vertices_(limits.vertices), triangles_(limits.triangles) {}
  /// Errors: `limit_exceeded`, with nothing taken.
  proto::Expected<void> take(std::uint64_t vertices, std::uint64_t triangles,
                             const std::string& pointer);

 private:
  files::ImportLimits limits_;
  std::uint64_t vertices_, triangles_;  ///< numbers that are left
};

/// A checked glTF primitive that holds triangles, in its own space. Views into the document's
/// bytes.
struct PrimitiveSource {
  std::string pointer;
  int mode = 4;                               ///< glTF: list, strip or fan
  std::optional<gltf::AccessorView> indices;  ///< each within `positions`
  gltf::AccessorView positions;
  std::optional<gltf::AccessorView> normals, colors;
  std::map<std::uint32_t, gltf::AccessorView> uv_sets;  ///< key: n of TEXCOORD_n; may have gaps
  std::uint64_t triangle_count = 0;
  std::uint64_t vertex_bound = 0;  ///< at most as many vertices come of placing it

  /// Returns the vertices of triangle i < triangle_count.
  std::array<std::uint32_t, 3> triangle(std::uint64_t i) const;
};

/// Opens a primitive and checks its contents. Returns nothing when it holds no triangle: points,
/// lines, no positions (with a warning). Takes no memory; what placing it takes is first asked of
/// `budget`. Errors: `invalid_scene`, `unsupported_extension`, `limit_exceeded`, `canceled`.
proto::Expected<std::optional<PrimitiveSource>> open_primitive(gltf::Document&, gltf::Accessors&,
                                                               std::uint32_t mesh,
                                                               std::uint32_t primitive,
                                                               GeometryBudget& budget,
                                                               const std::stop_token&);

}  // namespace kiln::import
