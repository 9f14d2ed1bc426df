// Which pairs of texels see each other, found out once.
#include <algorithm>
#include <utility>

#include "baker/solver/pairwise/pairwise.h"
#include "baker/solver/pairwise/passes.h"

namespace kiln::solver::pairwise {
namespace {

using lightmap::PlaneId;

/// Fills Lightmap::seen. Each texel owns its pairs with those that follow it, so that each
/// unordered pair is traced once, and no two batches write to one word [RTRad 4.7.4].
class SeeingPass final : public Pass {
 public:
  SeeingPass(const Parts& parts, PassPlan plan)
      : Pass(std::move(plan)), parts_(parts), layout_(parts.patches.size(), parts.seen_words()) {
    plan_.writes = lightmap::plane_set({PlaneId::kSeen});
    plan_.batch_texels = batch_texels(parts);
    plan_.work = Work::directions(kFacingShare * layout_.reach());
  }

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap&,
                    const lightmap::LightmapView& after) const override {
    std::uint64_t rays = 0;
    const std::uint32_t size = parts_.patches.size();
    for (std::uint32_t i = range.begin; i < range.end; ++i) {
      const auto words = after.seen.of(i);
      std::ranges::fill(words, 0u);
      const auto remember = [&](std::uint32_t j, const ViewFactors::Factors&) {
        PairLayout::Place at;
        if (layout_.find(i, j, at) && at.texel == i) words[at.bit / 32] |= 1u << at.bit % 32;
      };
      const std::uint32_t end = i + layout_.reach() + 1;
      rays += parts_.factors.pairs(i, i + 1, std::min(size, end), remember);
      if (end > size) rays += parts_.factors.pairs(i, 0, end - size, remember);
    }
    return rays;
  }

 private:
  const Parts& parts_;
  const PairLayout layout_;
};

}  // namespace

std::unique_ptr<Pass> make_seeing_pass(const Parts& parts, PassPlan plan) {
  return std::make_unique<SeeingPass>(parts, std::move(plan));
}

}  // namespace kiln::solver::pairwise
