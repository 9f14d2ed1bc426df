#pragma once

#include <memory>

#include "baker/solver/pass.h"
#include "baker/solver/world.h"

namespace kiln::solver::direct {

/// The pass that all methods begin with which sample direct light apart from the rest: shadow rays
/// from every texel, as many as the plan sends at first. Sets of the plan what it reads, writes and
/// costs. @param world outlives the pass
std::unique_ptr<Pass> make_direct_pass(const World& world, PassPlan plan);

/// Its expected effort.
Work direct_work(const World&);

}  // namespace kiln::solver::direct
