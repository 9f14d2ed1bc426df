#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "baker/simd/kernels.h"
#include "baker/solver/footprint.h"
#include "baker/solver/world.h"

namespace kiln::solver::direct {

/// Estimates a texel's light from one uniform lamp: Lambert's polygon formula at each point of the
/// footprint times the visible share that shadow rays find, the rays weighted by what they would
/// bring. When nothing or everything stands between, the result is exact. In the half-shadow the
/// ratio has a bias of the order of 1/rays, without the noise of the unoccluded light.
class PolygonLight {
 public:
  explicit PolygonLight(const World& world)
      : world_(world),
        kernels_(simd::kernels()),
        low_discrepancy_(world.settings.uses(proto::Technique::kLowDiscrepancy)) {}

  /// A lamp as the points of one texel see it.
  struct View {
    float irradiance[Footprint::kPoints];  ///< at unit radiance; 0 where the lamp is turned away
    float mean = 0;                        ///< mean over the points
    bool exact = true;  ///< false: the closed form has lost its digits, good for importance only
  };
  /// Views the lamp from the first `points` of the footprint. The others' irradiance is left out of
  /// the mean, and not set. Four give a good estimate of the mean for a quarter of the time when
  /// the lamp crosses the horizon.
  View view(const light::AreaLight&, const Footprint&, const simd::PointFrames&,
            std::uint32_t points = Footprint::kPoints) const;

  /// The irradiance per unit radiance, with half the difference between two halves of the rays.
  struct Arrived {
    float irradiance = 0, half_difference = 0;
  };
  class Shadow;

 private:
  const World& world_;
  const simd::Kernels& kernels_;
  const bool low_discrepancy_;
};

/// Sends the shadow rays of one texel to one lamp. The objects that it refers to must outlive it.
class PolygonLight::Shadow {
 public:
  /// @param first packets that were sent before, of the same sequence
  /// @param packets one shadow ray from each point; at least 1
  Shadow(const PolygonLight&, const light::AreaLight&, const View&, const Footprint&,
         const simd::PointFrames&, std::uint32_t first, std::uint32_t packets, std::uint32_t seed);

  std::uint32_t packets() const { return packets_; }
  /// Sends the packets up to the `end`th. @return rays traced
  std::uint64_t send_until(std::uint32_t end);
  /// Return whether any ray has arrived, or met something.
  bool lit() const { return lit_; }
  bool blocked() const { return blocked_; }
  /// Returns the light by the packets sent so far.
  Arrived arrived() const;

 private:
  struct Sums {
    float sent = 0, arrived = 0, rays = 0;
  };
  void take_samples();
  void near_rays(simd::LightRays&) const;
  void add(const trace::RayPacket&, const simd::LightRays&, std::uint32_t blocked);
  float irradiance(const Sums&) const;

  const PolygonLight& all_;
  const light::AreaLight& light_;
  const View& view_;
  const Footprint& at_;
  const simd::PointFrames& frames_;
  std::uint32_t first_, packets_, seed_, flip_, next_ = 0;
  bool near_, lit_ = false, blocked_ = false;
  std::uint32_t x_[Footprint::kPoints], y_[Footprint::kPoints];  ///< points of packet next_
  std::uint32_t second_ = 0;  ///< bits of its points whose ray belongs to the second half
  Sums half_[2];
};

}  // namespace kiln::solver::direct
