#pragma once

#include <memory>
#include <vector>

#include "baker/sampling/direction_set.h"
#include "baker/solver/emittance.h"
#include "baker/solver/gather/hemisphere.h"
#include "baker/solver/gather/packet_layout.h"
#include "baker/solver/pass.h"
#include "baker/solver/radiosity_map/emitter_light.h"
#include "baker/solver/radiosity_map/series.h"
#include "baker/solver/world.h"

namespace kiln::solver::radiosity_map {

/// What all passes of one bake share. Immutable; stays where it is.
struct Parts {
  /// @param w outlives this @param kept directions whose hits are kept
  Parts(const World& w, std::uint32_t kept);
  Parts(const Parts&) = delete;
  Parts& operator=(const Parts&) = delete;

  /// Returns directions of the texels' sequence, in the order in which they are traced.
  sampling::DirectionSet directions(Run) const;

  const World& world;
  const gather::PacketLayout packets;
  const gather::Hemisphere hemisphere;
  const EmitterLight emitters;
  const sampling::DirectionSet kept;       ///< those whose hits are kept; may be none
  const std::vector<math::Rgb> emittance;  ///< M of the texels, lx; empty when rays find it
};

/// Makes the pass that does a step. Sets in the plan what it reads, writes and costs.
std::unique_ptr<Pass> make_step_pass(const Parts&, PassPlan, const Step&);
/// Returns the expected effort of that pass.
Work step_work(const Parts&, const Step&);

}  // namespace kiln::solver::radiosity_map
