#include "baker/solver/pairwise/transport_pass.h"

#include <algorithm>
#include <utility>

#include "baker/solver/pairwise/passes.h"

namespace kiln::solver::pairwise {

using lightmap::PlaneId;

TransportPass::TransportPass(const Parts& parts, bool is_remembered, PassPlan plan)
    : Pass(std::move(plan)), parts_(parts), is_remembered_(is_remembered) {
  plan_.reads = lightmap::plane_set({PlaneId::kDirect, PlaneId::kSky, PlaneId::kIndirect});
  plan_.writes = lightmap::plane_set({PlaneId::kIndirect});
  if (is_remembered) plan_.reads.set(std::size_t(PlaneId::kSeen));
  if (clamps()) plan_.writes.set(std::size_t(PlaneId::kClamped));
  plan_.batch_texels = batch_texels(parts);
}

void TransportPass::read(const lightmap::Lightmap& before) {
  radiosity_.resize(before.size());
  float brightest = 0;
  for (std::uint32_t t = 0; t < before.size(); ++t) {
    const math::Rgb direct = parts_.reflectance(t) * (before.direct[t] + before.sky[t]);
    const math::Rgb own = parts_.emittance.empty() ? math::Rgb{} : parts_.emittance[t];
    radiosity_[t] = parts_.reflectance(t) * before.irradiance(t) + own;
    brightest = std::max(brightest, max_channel(direct + own));
  }
  clamp_.emplace(parts_.world.settings, brightest);
  if (is_remembered_) seen_.emplace(before.seen);
}

std::uint64_t TransportPass::add(std::uint32_t texel, const Senders& from, Sum& sum,
                                 double& lost) const {
  const bool clamps_it = clamps();
  const SeenPairs* seen = seen_ ? &*seen_ : nullptr;
  return parts_.factors.row(texel, from, seen, [&](std::uint32_t s, float factor) {
    const math::Rgb b = from.list[s].radiosity;
    if (!clamps_it) return sum += b * factor;
    const math::Rgb given = (*clamp_)(factor, b);
    lost += double(luminance(b * factor) - luminance(given));
    sum += given;
  });
}

}  // namespace kiln::solver::pairwise
