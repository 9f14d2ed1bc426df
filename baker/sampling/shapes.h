#pragma once

#include <span>

#include "baker/math/vec.h"

namespace kiln::sampling {

/// An orthonormal basis around a unit normal [Duff et al., "Building an Orthonormal Basis,
/// Revisited", JCGT 2017].
struct Frame {
  math::Vec3 x, y, z;

  explicit Frame(math::Vec3 n) : z(n) {
    const float sign = std::copysign(1.f, n.z);
    const float a = -1 / (sign + n.z), b = n.x * n.y * a;
    x = {1 + sign * n.x * n.x * a, sign * b, -sign * n.x};
    y = {b, sign + n.y * n.y * a, -n.y};
  }
  math::Vec3 to_world(math::Vec3 v) const { return x * v.x + y * v.y + z * v.z; }
};

/// Returns a unit direction about +z with density cosθ/π, by Shirley and Chiu's concentric map,
/// which takes neighboring squares to compact solid angles.
math::Vec3 cosine_direction(math::Vec2 u);

/// Returns a uniform point of a triangle as weights of its second and third vertex.
math::Vec2 uniform_triangle(math::Vec2 u);

/// A triangle seen from a point, as unit vectors to its corners.
struct SphericalTriangle {
  math::Vec3 a, b, c;
  float solid_angle = 0;  ///< sr, unsigned

  SphericalTriangle(math::Vec3 from, math::Vec3 p0, math::Vec3 p1, math::Vec3 p2);
  /// Returns a unit direction with uniform density 1/solid_angle over the triangle [Arvo,
  /// "Stratified Sampling of Spherical Triangles", SIGGRAPH 1995].
  math::Vec3 sample(math::Vec2 u) const;
};

/// Returns the irradiance per unit radiance at `p` with unit normal `n` from a uniform Lambertian
/// polygon, flat and convex with 3 or 4 corners, clipped at the horizon, whichever side it shows
/// [Lambert 1760; Baum et al. 1989, eq. 2]. The result over π is the view factor from a point.
float polygon_irradiance(math::Vec3 p, math::Vec3 n, std::span<const math::Vec3> corners);
/// The same with the part below the plane of a second, geometric normal left out.
float polygon_irradiance(math::Vec3 p, math::Vec3 n, math::Vec3 geometric_normal,
                         std::span<const math::Vec3> corners);

}  // namespace kiln::sampling
