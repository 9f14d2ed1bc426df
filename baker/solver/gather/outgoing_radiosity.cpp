#include "baker/solver/gather/outgoing_radiosity.h"

namespace kiln::solver::gather {
namespace {

/// Texels with less of their footprint in view than this borrow their neighbors' radiosity.
constexpr float kHiddenShare = 0.1f;

}  // namespace

void OutgoingRadiosity::find_hidden(const lightmap::Lightmap& light) {
  repairs_.clear();
  for (std::uint32_t t = 0; t < world_.texels.front_count; ++t) {
    if (light.validity[t] >= kHiddenShare) continue;
    Repair repair;
    repair.texel = t;
    for (int k = 0; k < 9; ++k) {
      const std::int32_t n = world_.texels.neighbor(t, k % 3 - 1, k / 3 - 1);
      if (n != atlas::kNoTexel && light.validity[n] >= kHiddenShare)
        repair.neighbor[repair.count++] = std::uint32_t(n);
    }
    if (repair.count > 0) repairs_.push_back(repair);
  }
}

bool OutgoingRadiosity::read(const lightmap::Lightmap& light, const exec::Workers& workers,
                             bool once) {
  constexpr std::uint32_t kRunTexels = 16384;
  radiosity_.resize(world_.texels.size());
  const bool has_sent = light.radiosity.size() > 0;
  const bool whole = workers.for_runs(world_.texels.size(), kRunTexels, [&](auto begin, auto end) {
    for (std::uint32_t t = begin; t < end; ++t) {
      // E is the mean over the footprint; rays from outside meet its visible part only.
      const float visible = light.validity[t];
      const math::Rgb e = once ? light.direct[t] + light.sky[t] : light.irradiance(t);
      math::Rgb b = world_.texels.albedo[t] * e * (visible >= kHiddenShare ? 1 / visible : 1.f);
      if (!emittance_.empty()) b += emittance_[t];
      if (has_sent) b = b - light.radiosity[t];
      radiosity_[t] = {b.r, b.g, b.b, 0};
    }
  });
  if (!whole) return false;
  for (const Repair& repair : repairs_) {
    math::Rgb sum;
    for (std::uint32_t i = 0; i < repair.count; ++i) sum += radiosity(repair.neighbor[i]);
    const math::Rgb b = sum * (1 / float(repair.count));
    radiosity_[repair.texel] = {b.r, b.g, b.b, 0};
  }
  return true;
}

void OutgoingRadiosity::scale(float factor) {
  for (Radiosity& b : radiosity_) b.r *= factor, b.g *= factor, b.b *= factor;
}

void OutgoingRadiosity::restore(const lightmap::Plane<math::Rgb>& radiosity) {
  radiosity_.resize(radiosity.size());
  for (std::size_t t = 0; t < radiosity.size(); ++t)
    radiosity_[t] = {radiosity[t].r, radiosity[t].g, radiosity[t].b, 0};
}

sampling::Estimate OutgoingRadiosity::look_up(const sampling::DirectionSet& set,
                                              std::span<const std::uint32_t> hits) const {
  float sum[2][4] = {};
  const auto add = [&](float(&to)[4], std::uint32_t h) {
    if (h >= simd::kHitSky) return;  // or kHitNothing
    const Radiosity& b = radiosity_[h];
    to[0] += b.r, to[1] += b.g, to[2] += b.b;
  };
  const std::size_t n = hits.size(), whole = n / 16 * 16;
  for (std::size_t i = 0; i < whole; i += 16) {
    for (std::size_t k = 0; k < 8; ++k) add(sum[0], hits[i + k]);
    for (std::size_t k = 8; k < 16; ++k) add(sum[1], hits[i + k]);
  }
  for (std::size_t i = whole; i < n; ++i) add(sum[set.in_second_half(std::uint32_t(i))], hits[i]);
  return set.estimate({sum[0][0], sum[0][1], sum[0][2]}, {sum[1][0], sum[1][1], sum[1][2]});
}

}  // namespace kiln::solver::gather
