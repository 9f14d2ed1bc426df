#include "baker/solver/pairwise/near_field.h"

#include "baker/solver/footprint.h"

namespace kiln::solver::pairwise {
namespace {

void put(float (&plane)[3][NearField::Points::kCount], std::uint32_t i, math::Vec3 v) {
  plane[0][i] = v.x, plane[1][i] = v.y, plane[2][i] = v.z;
}

}  // namespace

NearField::Points::Points(const World& world, std::uint32_t texel) {
  const Footprint at(world, texel);
  for (std::uint32_t i = 0; i < kCount; ++i) {
    put(position, i, at.position[i]);
    put(geometric_normal, i, at.geometric_normal[i]);
    put(shading_normal, i, at.shading_normal[i]);
  }
}

NearField::Kernel NearField::mean(const Points& a, const Points& b) {
  constexpr std::uint32_t kCount = Points::kCount;
  constexpr float kSamePlace = 1e-30f;  // m²
  // Rotations of b's points: the sum over the pairs of one rotation has the same terms, in the same
  // lanes but for their order, whichever of the two texels comes first.
  double forth = 0, back = 0;
  for (std::uint32_t turn = 0; turn < kCount; ++turn) {
    float f[kCount], g[kCount];
    for (std::uint32_t i = 0; i < kCount; ++i) {
      const std::uint32_t j = i ^ turn;
      const float x = b.position[0][j] - a.position[0][i], y = b.position[1][j] - a.position[1][i],
                  z = b.position[2][j] - a.position[2][i];
      const float r2 = x * x + y * y + z * z;
      const auto along = [&](const float(&n)[3][kCount], std::uint32_t k) {
        return n[0][k] * x + n[1][k] * y + n[2][k] * z;
      };
      const float above_a = along(a.geometric_normal, i), above_b = -along(b.geometric_normal, j);
      const float at_a = std::max(0.f, along(a.shading_normal, i)),
                  at_b = std::max(0.f, -along(b.shading_normal, j));
      const bool faces = above_a > 0 && above_b > 0 && r2 > kSamePlace;
      const float inverse = faces ? 1 / r2 : 0;
      f[i] = (at_a * inverse) * (above_b * inverse);
      g[i] = (at_b * inverse) * (above_a * inverse);
    }
    for (std::uint32_t i = 0; i < kCount; ++i) forth += double(f[i]);
    for (std::uint32_t j = 0; j < kCount; ++j) back += double(g[j ^ turn]);
  }
  constexpr double kPairs = double(kCount) * kCount;
  return {float(forth / kPairs), float(back / kPairs)};
}

}  // namespace kiln::solver::pairwise
