#include "baker/solver/footprint.h"

#include "baker/sampling/shapes.h"
#include "baker/sampling/sobol.h"

namespace kiln::solver {

Footprint::Footprint(const World& in, std::uint32_t texel) {
  const bool back = in.texels.is_back(texel);
  const auto points = in.texels.points_of(texel);
  std::uint32_t last_triangle = trace::kNoHit;
  math::Vec3 ng, centroid;
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    const scene::Bary bary = points[i].bary();
    if (points[i].triangle != last_triangle) {
      last_triangle = points[i].triangle;
      ng = scene::geometric_normal(in.scene, last_triangle);
      centroid = position_at(in.scene, last_triangle, scene::kCentroid);
    }
    const auto& v = in.scene.triangles[last_triangle];
    math::Vec3 ns = normalize(
        interpolate(in.scene.normals[v[0]], in.scene.normals[v[1]], in.scene.normals[v[2]], bary),
        ng);
    if (dot(ns, ng) < 0) ns = -ns;
    position[i] = position_at(in.scene, last_triangle, bary);
    geometric_normal[i] = back ? -ng : ng;
    shading_normal[i] = back ? -ns : ns;
    origin[i] = in.rays.offset_origin(position[i], geometric_normal[i], centroid);
  }
}

simd::PointFrames Footprint::frames() const {
  simd::PointFrames f;
  const auto put = [](float(&plane)[3][kPoints], std::uint32_t i, math::Vec3 v) {
    plane[0][i] = v.x, plane[1][i] = v.y, plane[2][i] = v.z;
  };
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    const sampling::Frame frame(shading_normal[i]);
    put(f.position, i, position[i]);
    put(f.origin, i, origin[i]);
    put(f.geometric_normal, i, geometric_normal[i]);
    put(f.tangent_x, i, frame.x);
    put(f.tangent_y, i, frame.y);
    put(f.shading_normal, i, frame.z);
  }
  return f;
}

std::uint32_t texel_seed(const World& in, std::uint32_t texel, SampleStream stream) {
  const std::uint64_t seed = in.settings.seed;
  if (in.settings.same_directions) texel = 0;
  return sampling::hash(sampling::hash(std::uint32_t(seed), std::uint32_t(seed >> 32)), texel,
                        static_cast<std::uint32_t>(stream));
}

}  // namespace kiln::solver
