#include "baker/solver/pairwise/transport_pass.h"

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
  TexelLight light(parts_, before);
  radiosity_ = std::move(light.radiosity);
  clamp_.emplace(parts_.world.settings, light.brightest_direct);
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
