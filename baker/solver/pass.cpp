#include "baker/solver/pass.h"

#include <algorithm>
#include <chrono>

namespace kiln::solver {
namespace {

using lightmap::PlaneId;

/// Copies some planes of a range of texels into a light of its own.
lightmap::Lightmap cut_out(const lightmap::Lightmap& light, atlas::TexelRange range,
                           const lightmap::PlaneSet& some) {
  std::vector<lightmap::PlaneSpec> state;
  if (light.hits.size() > 0) state.push_back({PlaneId::kHits, light.hits.words_per_texel()});
  if (light.seen.size() > 0) state.push_back({PlaneId::kSeen, light.seen.words_per_texel()});
  for (const PlaneId id : {PlaneId::kRadiosity, PlaneId::kGathers, PlaneId::kClamped})
    state.push_back({id});
  lightmap::Lightmap cut(range.size(), state);
  std::vector<std::span<const std::byte>> from;
  lightmap::Lightmap::for_planes(light, some, [&](PlaneId, const auto& plane) {
    from.push_back(plane.bytes(range.begin, range.end));
  });
  std::size_t i = 0;
  lightmap::Lightmap::for_planes(cut, some, [&](PlaneId, auto& plane) {
    lightmap::copy_where_different(from[i++], plane.bytes(0, range.size()).data());
  });
  return cut;
}

}  // namespace

lightmap::TexelPatch compute_patch(const Pass& pass, atlas::TexelRange range,
                                   const lightmap::Lightmap& before) {
  const auto start = std::chrono::steady_clock::now();
  const PassPlan& plan = pass.plan();
  lightmap::Lightmap after = cut_out(before, range, plan.writes);
  lightmap::PatchHead head;
  head.pass = plan.index;
  head.texels = range;
  head.writes = plan.writes;
  head.rays = pass.run(range, before, lightmap::LightmapView(after, plan.writes, range.begin));
  head.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return lightmap::TexelPatch::of(head, after, range.begin);
}

lightmap::PatchForm patch_form(const PassPlan& plan, const lightmap::Lightmap& light) {
  return {plan.index, plan.writes, light.size(), plan.batch_texels, light.texel_bytes(plan.writes)};
}

}  // namespace kiln::solver
