#include "baker/atlas/triangle_setup.h"

namespace kiln::atlas {

void SetupCache::fill(TriangleSetup& s, std::uint32_t triangle) const {
  const UvTriangle uv(atlas_, triangle);
  s.triangle = triangle;
  for (int i = 0; i < 3; ++i) s.p[i] = uv.p[i];
  const Point a{uv.p[1].x - uv.p[0].x, uv.p[1].y - uv.p[0].y};
  const Point b{uv.p[2].x - uv.p[0].x, uv.p[2].y - uv.p[0].y};
  s.ux = b.y / uv.det, s.uy = -b.x / uv.det;
  s.vx = -a.y / uv.det, s.vy = a.x / uv.det;
  s.m2_per_texel2 = double(triangle_area(scene_, triangle)) / uv.area();
  s.normal = geometric_normal(scene_, triangle);
  const auto& v = scene_.triangles[triangle];
  const scene::Material& material = scene_.material_of(triangle);
  s.constant_albedo = material.base_texture.image < 0 &&
                      scene_.colors[v[0]] == scene_.colors[v[1]] &&
                      scene_.colors[v[0]] == scene_.colors[v[2]];
  if (s.constant_albedo) s.albedo = albedo_at(scene_, triangle, {});
}

}  // namespace kiln::atlas
