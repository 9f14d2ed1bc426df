#include "baker/sampling/shapes.h"

#include <array>

namespace kiln::sampling {
namespace {

float clamped_acos(float x) {
  return std::acos(std::clamp(x, -1.f, 1.f));
}

/// Returns the angle between two unit vectors, accurate for small angles too.
float angle_between(math::Vec3 a, math::Vec3 b) {
  return 2 * std::atan2(length(a - b), length(a + b));
}

/// The part of `v` that is orthogonal to the unit vector `axis`, unit.
math::Vec3 orthogonal_part(math::Vec3 v, math::Vec3 axis) {
  return normalize(v - axis * dot(v, axis), axis);
}

/// A convex polygon of four corners that is clipped at two planes has at most six.
struct Polygon {
  std::array<math::Vec3, 6> corner;
  std::size_t count = 0;

  void add(math::Vec3 v) {
    if (count < corner.size()) corner[count++] = v;
  }
};

/// The part on the side of the plane through 0 that its normal points to.
Polygon clip(const Polygon& in, math::Vec3 normal) {
  Polygon out;
  for (std::size_t i = 0; i < in.count; ++i) {
    const math::Vec3 a = in.corner[i], b = in.corner[(i + 1) % in.count];
    const float ha = dot(a, normal), hb = dot(b, normal);
    if (ha >= 0) out.add(a);
    if ((ha < 0) != (hb < 0)) out.add(a + (b - a) * (ha / (ha - hb)));
  }
  return out;
}

}  // namespace

math::Vec3 cosine_direction(math::Vec2 u) {
  const float a = 2 * u.x - 1, b = 2 * u.y - 1;
  float r = 0, phi = 0;
  if (a * a > b * b) {
    r = a;
    phi = math::kPi / 4 * (b / a);
  } else if (b != 0) {
    r = b;
    phi = math::kPi / 2 - math::kPi / 4 * (a / b);
  }
  const float z2 = 1 - r * r;
  return {r * std::cos(phi), r * std::sin(phi), std::sqrt(std::max(0.f, z2))};
}

math::Vec2 uniform_triangle(math::Vec2 u) {
  const float s = std::sqrt(u.x);
  return {s * (1 - u.y), s * u.y};
}

SphericalTriangle::SphericalTriangle(math::Vec3 from, math::Vec3 p0, math::Vec3 p1, math::Vec3 p2)
    : a(normalize(p0 - from)), b(normalize(p1 - from)), c(normalize(p2 - from)) {
  // The formula of Van Oosterom and Strackee is free of the cancellation in the sum of the three
  // angles.
  const float numerator = std::abs(dot(a, cross(b, c)));
  const float denominator = 1 + dot(a, b) + dot(b, c) + dot(c, a);
  solid_angle = 2 * std::atan2(numerator, denominator);
}

math::Vec3 SphericalTriangle::sample(math::Vec2 u) const {
  const math::Vec3 ab = orthogonal_part(b, a), ac = orthogonal_part(c, a);
  const float alpha = angle_between(ab, ac);
  const float cos_ab = std::clamp(dot(a, b), -1.f, 1.f);
  // The sub-triangle of area u.x * solid_angle fixes the point c' on the edge from a to c.
  const float phi = u.x * solid_angle - alpha;
  const float s = std::sin(phi), t = std::cos(phi);
  const float v1 = t - std::cos(alpha), v2 = s + std::sin(alpha) * cos_ab;
  const float below = (v2 * s + v1 * t) * std::sin(alpha);
  const float above = (v2 * t - v1 * s) * std::cos(alpha) - v2;
  const float q = below != 0 ? std::clamp(above / below, -1.f, 1.f) : 1.f;
  const math::Vec3 c1 = a * q + ac * std::sqrt(std::max(0.f, 1 - q * q));
  const float z = 1 - u.y * (1 - dot(c1, b));
  return normalize(b * z + orthogonal_part(c1, b) * std::sqrt(std::max(0.f, 1 - z * z)), c1);
}

float polygon_irradiance(math::Vec3 p, math::Vec3 n, std::span<const math::Vec3> corners) {
  return polygon_irradiance(p, n, n, corners);
}

float polygon_irradiance(math::Vec3 p, math::Vec3 n, math::Vec3 geometric_normal,
                         std::span<const math::Vec3> corners) {
  Polygon v;
  for (const math::Vec3 corner : corners) v.add(corner - p);
  v = clip(v, n);
  if (!(geometric_normal == n)) v = clip(v, geometric_normal);
  if (v.count < 3) return 0;
  for (std::size_t i = 0; i < v.count; ++i) v.corner[i] = normalize(v.corner[i], n);
  float sum = 0;
  for (std::size_t i = 0; i < v.count; ++i) {
    const math::Vec3 a = v.corner[i], b = v.corner[(i + 1) % v.count];
    const math::Vec3 axis = cross(a, b);
    const float sine = length(axis);
    if (sine <= 1e-12f) continue;
    sum += clamped_acos(dot(a, b)) * dot(axis, n) / sine;
  }
  return std::abs(sum) / 2;
}

}  // namespace kiln::sampling
