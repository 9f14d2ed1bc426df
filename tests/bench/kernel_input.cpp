#include "tests/bench/kernel_input.h"

#include <algorithm>
#include <numeric>

#include "baker/sampling/shapes.h"
#include "baker/sampling/sobol.h"

namespace kiln::bench {

using sampling::hash;

KernelInput::KernelInput() : cells_(std::size_t(kPage) * kPage) {
  const sampling::Frame up({0, 1, 0});
  for (std::uint32_t i = 0; i < 16; ++i) {
    const math::Vec2 at = sampling::scrambled(sampling::sobol(i), 7);
    const math::Vec3 p{0.1f * at.x, 0, 0.1f * at.y};
    for (int k = 0; k < 3; ++k) {
      frames.position[k][i] = frames.origin[k][i] = p[k];
      frames.tangent_x[k][i] = up.x[k], frames.tangent_y[k][i] = up.y[k];
      frames.shading_normal[k][i] = frames.geometric_normal[k][i] = up.z[k];
    }
  }
  const float corner[4][3] = {{-1, 2, -1}, {1, 2, -1}, {1, 2, 1}, {-1, 2, 1}};
  std::copy(&corner[0][0], &corner[0][0] + 12, &lamp.corner[0][0]);
  lamp.normal[1] = -1;
  lamp.area_m2 = 4;
  lamp.corners = 4;

  std::iota(cells_.begin(), cells_.end(), simd::TexelGrid::kWhole);
  const float whole = float(kPage - 2);
  triangles_ = {
      {{{1, 1}, {whole, 0}, {0, whole}}, {{1 + whole, 1 + whole}, {-whole, 0}, {0, -whole}}}};
  for (std::uint32_t i = 0; i < 16 * kPackets; ++i) {
    const sampling::SobolPoint p = sampling::sobol(i);
    x.push_back(p.x), y.push_back(p.y);
    const math::Vec2 u = sampling::uniform_triangle(sampling::scrambled(p, 3));
    hit_u_.push_back(u.x), hit_v_.push_back(u.y);
  }
}

void KernelInput::directions(const simd::Kernels& k, std::uint32_t packet,
                             simd::Directions& out) const {
  const std::uint32_t first = packet % kPackets * 16, seed = sampling::hash(packet);
  simd::ScrambledPoints points;
  std::copy_n(&x[first], 16, points.x);
  std::copy_n(&y[first], 16, points.y);
  std::fill_n(points.seed_x, 16, seed);
  std::fill_n(points.seed_y, 16, sampling::hash(seed));
  k.directions(points, frames, out);
}

void KernelInput::sample_light(const simd::Kernels& k, std::uint32_t packet,
                               simd::LightRays& out) const {
  const std::uint32_t first = packet % kPackets * 16, seed = sampling::hash(packet);
  k.sample_light(lamp, &x[first], &y[first], seed % 16, seed, sampling::hash(seed), frames, 1e-4f,
                 out);
}

void KernelInput::look_up(const simd::Kernels& k, std::uint32_t packet,
                          std::array<std::uint32_t, 16>& texels) const {
  const std::uint32_t first = packet % kPackets * 16;
  alignas(64) std::uint32_t triangle[16], back[16] = {};
  alignas(64) float pick[16];
  for (std::uint32_t i = 0; i < 16; ++i) triangle[i] = i & 1, pick[i] = (float(i) + 0.5f) / 16;
  k.look_up({cells_.data(), triangles_.data(), std::int32_t(kPage)}, triangle, &hit_u_[first],
            &hit_v_[first], back, pick, texels.data());
}

}  // namespace kiln::bench
