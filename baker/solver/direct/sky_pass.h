#pragma once

#include <memory>

#include "baker/solver/pass.h"
#include "baker/solver/world.h"

namespace kiln::solver::direct {

/// The pass for the sky of methods that follow no directions of their own. From every texel it
/// sends as many cosine-distributed directions as the plan has; E = π · mean L of those that meet
/// nothing. The direct pass has drawn the bright parts of a sky map, and this one weighs what is
/// left of them (see SkyShares). Sets of the plan what it reads, writes and costs. @param world
/// outlives the pass
std::unique_ptr<Pass> make_sky_pass(const World& world, PassPlan plan);

/// Its expected effort.
Work sky_work(const World&);

}  // namespace kiln::solver::direct
