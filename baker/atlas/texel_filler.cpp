#include "baker/atlas/texel_filler.h"

#include <optional>

namespace kiln::atlas {
namespace {

/// Returns the point of a convex polygon that is nearest to `p`.
Point closest_point(const Polygon& polygon, Point p) {
  Point best = polygon.v[0];
  double best_d2 = INFINITY;
  bool left = false, right = false;
  for (int i = 0; i < polygon.n; ++i) {
    const Point a = polygon.v[i], b = polygon.v[i + 1 < polygon.n ? i + 1 : 0];
    const double side = cross(a, b, p);
    (side >= 0 ? left : right) = true;
    const Point ab{b.x - a.x, b.y - a.y};
    const double l2 = ab.x * ab.x + ab.y * ab.y;
    const double dot = (p.x - a.x) * ab.x + (p.y - a.y) * ab.y;
    const double t = l2 > 0 ? std::clamp(dot / l2, 0.0, 1.0) : 0.0;
    const Point q{a.x + ab.x * t, a.y + ab.y * t};
    const double d2 = (p.x - q.x) * (p.x - q.x) + (p.y - q.y) * (p.y - q.y);
    if (d2 < best_d2) best_d2 = d2, best = q;
  }
  return left != right ? p : best;
}

/// Returns the centroid of a polygon, times its area.
Point first_moment(const Polygon& p) {
  Point m;
  for (int i = 1; i + 1 < p.n; ++i) {
    const double a = std::abs(cross(p.v[0], p.v[i], p.v[i + 1])) / 2;
    m.x += a * (p.v[0].x + p.v[i].x + p.v[i + 1].x) / 3;
    m.y += a * (p.v[0].y + p.v[i].y + p.v[i + 1].y) / 3;
  }
  return m;
}

/// Returns the mean over the points. A value that is constant on a triangle is evaluated once.
template <class Constant, class Value>
math::Rgb mean_over(SetupCache& setups, std::span<const SamplePoint> points, Constant constant,
                    Value value) {
  math::Rgb sum, last;
  std::uint32_t last_triangle = 0xffffffffu;
  for (const SamplePoint& p : points) {
    if (p.triangle != last_triangle) {
      const std::optional<math::Rgb> same = constant(setups[p.triangle]);
      last = same ? *same : value(p);
      last_triangle = same ? p.triangle : 0xffffffffu;
    }
    sum += last;
  }
  return sum * (1.f / float(points.size()));
}

}  // namespace

bool TexelFiller::fill(TextureGroup& group, std::uint32_t texel,
                       std::span<const Fragment> fragments) {
  fill_surface(group, texel, fragments);
  const std::span<SamplePoint> points(
      group.points.data() + std::size_t(texel) * TextureGroup::kPointsPerTexel,
      TextureGroup::kPointsPerTexel);
  place_points(setups_, group.page[texel], group.x[texel], group.y[texel], fragments, points);
  return fill_albedo(group, texel);
}

/// Fills area, coverage and the representative point, which lies on the triangle that covers most,
/// as near to the footprint's centroid as that allows.
void TexelFiller::fill_surface(TextureGroup& group, std::uint32_t texel,
                               std::span<const Fragment> fragments) {
  const std::uint32_t x = group.x[texel], y = group.y[texel];
  double area = 0, covered = 0;
  Fragment most;
  Point moment;
  for (const Fragment& f : fragments) {
    const TriangleSetup& setup = setups_[f.triangle];
    area += f.area * setup.m2_per_texel2;
    covered += f.area;
    if (f.area > most.area || (f.area == most.area && f.triangle < most.triangle)) most = f;
    if (fragments.size() == 1 && f.area == 1) continue;
    const Point m = first_moment(clip_to_texel(setup.polygon(), x, y));
    moment.x += m.x, moment.y += m.y;
  }
  const TriangleSetup& setup = setups_[most.triangle];
  Point at{double(x) + 0.5, double(y) + 0.5};
  if (most.area < 1) {
    const Point centroid{moment.x / covered, moment.y / covered};
    const Polygon footprint = clip_to_texel(setup.polygon(), x, y);
    at = footprint.n >= 3 ? closest_point(footprint, centroid) : centroid;
  }
  const scene::Bary bary = make_point(most.triangle, setup.bary(at)).bary();
  group.position[texel] = position_at(scene_, most.triangle, bary);
  group.shading_normal[texel] = shading_normal(scene_, most.triangle, bary);
  group.area_m2[texel] = float(area);
  group.coverage[texel] = float(std::min(covered, 1.0));
  group.triangle[texel] = most.triangle;
}

bool TexelFiller::fill_albedo(TextureGroup& group, std::uint32_t texel) {
  const std::span<const SamplePoint> points = group.points_of(texel);
  const math::Rgb albedo = mean_over(
      setups_, points,
      [](const TriangleSetup& t) {
        return t.constant_albedo ? std::optional(t.albedo) : std::nullopt;
      },
      [&](const SamplePoint& p) { return albedo_at(scene_, p.triangle, p.bary()); });
  const math::Rgb capped{std::min(albedo.r, scene::kMaxAlbedo),
                         std::min(albedo.g, scene::kMaxAlbedo),
                         std::min(albedo.b, scene::kMaxAlbedo)};
  group.albedo[texel] = capped;
  return capped != albedo;
}

}  // namespace kiln::atlas
