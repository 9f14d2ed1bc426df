#include "baker/solver/footprint.h"

#include "baker/solver/sampling.h"
#include "baker/solver/sobol.h"

namespace kiln::baker {

Footprint::Footprint(const SolverInput& in, std::uint32_t texel) {
  const bool back = in.texels.is_back(texel);
  const auto points = in.texels.points_of(texel);
  std::uint32_t last_triangle = kNoHit;
  Vec3 ng, centroid;
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    const Bary bary = points[i].bary();
    if (points[i].triangle != last_triangle) {
      last_triangle = points[i].triangle;
      ng = baker::geometric_normal(in.scene, last_triangle);
      centroid = position_at(in.scene, last_triangle, kCentroid);
    }
    const auto& v = in.scene.triangles[last_triangle];
    Vec3 ns = normalize(
        interpolate(in.scene.normals[v[0]], in.scene.normals[v[1]], in.scene.normals[v[2]], bary),
        ng);
    if (dot(ns, ng) < 0) ns = -ns;
    position[i] = position_at(in.scene, last_triangle, bary);
    geometric_normal[i] = back ? -ng : ng;
    shading_normal[i] = back ? -ns : ns;
    origin[i] = in.rays.offset_origin(position[i], geometric_normal[i], centroid);
  }
}

PointFrames Footprint::frames() const {
  PointFrames f;
  const auto put = [](float(&plane)[3][kPoints], std::uint32_t i, Vec3 v) {
    plane[0][i] = v.x, plane[1][i] = v.y, plane[2][i] = v.z;
  };
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    const Frame frame(shading_normal[i]);
    put(f.position, i, position[i]);
    put(f.origin, i, origin[i]);
    put(f.geometric_normal, i, geometric_normal[i]);
    put(f.tangent_x, i, frame.x);
    put(f.tangent_y, i, frame.y);
    put(f.shading_normal, i, frame.z);
  }
  return f;
}

std::uint32_t texel_seed(const SolverInput& in, std::uint32_t texel, Purpose purpose) {
  const std::uint64_t seed = in.settings.seed;
  return hash(hash(std::uint32_t(seed), std::uint32_t(seed >> 32)), texel,
              static_cast<std::uint32_t>(purpose));
}

}  // namespace kiln::baker
