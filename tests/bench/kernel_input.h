#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "baker/simd/kernels.h"

namespace kiln::bench {

/// What the kernels are fed: points of a floor under a lamp, and hits that are spread over a page
/// of 1024² whose texels are all covered, two triangles of it.
struct KernelInput {
  static constexpr std::uint32_t kPage = 1024, kPackets = 1024;

  simd::PointFrames frames{};
  simd::LightShape lamp{};
  std::vector<std::uint32_t> x, y;  ///< Sobol points, 16 per packet

  KernelInput();

  void directions(const simd::Kernels&, std::uint32_t packet, simd::Directions&) const;
  void sample_light(const simd::Kernels&, std::uint32_t packet, simd::LightRays&) const;
  void look_up(const simd::Kernels&, std::uint32_t packet,
               std::array<std::uint32_t, 16>& texels) const;

 private:
  std::vector<std::int32_t> cells_;
  std::vector<float> hit_u_, hit_v_;
  std::array<simd::PlacedTriangle, 2> triangles_{};
};

}  // namespace kiln::bench
