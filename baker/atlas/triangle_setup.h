#pragma once

#include <vector>

#include "baker/atlas/clip.h"
#include "baker/scene/scene.h"

namespace kiln::atlas {

/// The values of a triangle that the rasterizer uses for many texels.
struct TriangleSetup {
  std::uint32_t triangle = 0xffffffffu;
  bool constant_albedo = false;
  Point p[3];                             ///< on the page, texels
  double ux = 0, uy = 0, vx = 0, vy = 0;  ///< u and v grow by these per texel
  double m2_per_texel2 = 0;               ///< world area per area on the page; the map is affine
  math::Vec3 normal;                      ///< geometric
  math::Rgb albedo;                       ///< valid where constant_albedo is set

  Polygon polygon() const { return {{p[0], p[1], p[2]}, 3}; }
  /// Returns the barycentric (u, v) of a page point. They leave [0, 1] when the point is outside.
  Point bary(Point q) const {
    const double dx = q.x - p[0].x, dy = q.y - p[0].y;
    return {dx * ux + dy * uy, dx * vx + dy * vy};
  }
};

/// Caches the set-ups of the triangles in use, since neighboring texels need the same ones.
class SetupCache {
 public:
  SetupCache(const scene::Scene& scene, const Atlas& atlas)
      : scene_(scene), atlas_(atlas), slots_(kSlots) {}

  /// Returns the set-up of a triangle. The reference is valid until the next call.
  const TriangleSetup& operator[](std::uint32_t triangle) {
    TriangleSetup& slot = slots_[triangle % kSlots];
    if (slot.triangle != triangle) fill(slot, triangle);
    return slot;
  }

 private:
  static constexpr std::uint32_t kSlots = 512;
  void fill(TriangleSetup&, std::uint32_t triangle) const;

  const scene::Scene& scene_;
  const Atlas& atlas_;
  std::vector<TriangleSetup> slots_;
};

}  // namespace kiln::atlas
