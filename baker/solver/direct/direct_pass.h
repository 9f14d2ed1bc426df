#pragma once

#include <memory>

#include "baker/solver/pass.h"
#include "baker/solver/world.h"

namespace kiln::solver::direct {

/// Makes the pass that samples direct light: shadow rays from every texel, as many as the plan
/// sends at first. Methods that sample direct light apart begin with it. It fills in what the plan
/// reads, writes and costs. @param world outlives the pass
std::unique_ptr<Pass> make_direct_pass(const World& world, PassPlan plan);

/// Returns the expected effort of that pass.
Work direct_work(const World&);

}  // namespace kiln::solver::direct
