#pragma once

#include <cstdint>
#include <memory>

#include "baker/solver/pairwise/parts.h"
#include "baker/solver/pass.h"

namespace kiln::solver::pairwise {

/// Returns the expected rays of one bounce towards a texel, if nothing is remembered.
double bounce_rays(const Parts&);
/// Returns the expected effort of one bounce.
Work bounce_work(const Parts&);
/// Returns the texels of a batch: as many as the settings say, or take some tens of milliseconds.
std::uint32_t batch_texels(const Parts&);

/// Makes the pass that finds out once, for each unordered pair of texels that has a bit, whether
/// the two see each other (visibility "cached") [RTRad 5.2.3]. @param parts outlives the pass
std::unique_ptr<Pass> make_seeing_pass(const Parts& parts, PassPlan);

/// Makes a bounce: the texels of `tile` get the light of all senders anew; others keep theirs.
/// @param bounce from 0; random senders hang on it
/// @param is_remembered whether a seeing pass came before
std::unique_ptr<Pass> make_bounce_pass(const Parts& parts, std::uint32_t bounce,
                                       atlas::TexelRange tile, bool is_remembered, PassPlan);

/// Makes a step of progressive shooting [RTRad 2.8.5]: those texels that have most light unshot
/// send it to all others. Lightmap::radiosity holds what each has shot so far.
std::unique_ptr<Pass> make_shooting_pass(const Parts& parts, bool is_remembered, PassPlan);

/// The parts of the texels that one step of shooting takes, and that one step of Gauss-Seidel
/// computes. Sixteen steps show a picture often enough; more would be passes too short for their
/// barriers on small pages.
inline constexpr std::uint32_t kShots = 16, kTiles = 16;

}  // namespace kiln::solver::pairwise
