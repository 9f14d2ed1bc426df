#pragma once

#include <functional>
#include <memory>
#include <span>

#include "baker/solver/bounces.h"
#include "baker/solver/pass.h"

namespace kiln::solver::direct {

/// Returns the expected work of the passes before the first bounce: `direct`, and `sky` where there
/// is one.
Work lead_work(const World&);

/// Makes the pass after those reported, of a method whose passes are these two and bounces that
/// `make_bounce` makes. Null: there is none. @param world outlives the pass
std::unique_ptr<Pass> next_pass(const World& world, const BouncePasses&,
                                std::span<const proto::PassReport> done,
                                const std::function<std::unique_ptr<Pass>(PassPlan)>& make_bounce);

}  // namespace kiln::solver::direct
