#include "baker/solver/direct/lead_passes.h"

#include <utility>

#include "baker/solver/direct/direct_pass.h"
#include "baker/solver/direct/sky_pass.h"

namespace kiln::solver::direct {

Work lead_work(const World& world) {
  Work work = direct_work(world);
  if (world.scene.has_sky()) work += sky_work(world);
  return work;
}

std::unique_ptr<Pass> next_pass(const World& world, const BouncePasses& passes,
                                std::span<const proto::PassReport> done,
                                const std::function<std::unique_ptr<Pass>(PassPlan)>& make_bounce) {
  const auto next = passes.next(done);
  if (!next) return nullptr;
  PassPlan plan;
  plan.index = std::uint32_t(done.size());
  plan.name = to_string(next->kind);
  plan.completes = next->completes;
  switch (next->kind) {
    case BouncePasses::Kind::kDirect:
      return make_direct_pass(world, std::move(plan));
    case BouncePasses::Kind::kSky:
      return make_sky_pass(world, std::move(plan));
    case BouncePasses::Kind::kBounce:
      break;
  }
  return make_bounce(std::move(plan));
}

}  // namespace kiln::solver::direct
