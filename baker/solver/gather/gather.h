#pragma once

#include <memory>

#include "baker/solver/solver.h"

namespace kiln::solver::gather {

/// Makes the solver of the method `gather`: final gathering with lightmap feedback. Direct light is
/// sampled explicitly. Indirect light is the mean radiosity that cosine-distributed directions
/// meet, read from the previous bounce's lightmap [RTRad 5.4, with E = π · mean L for
/// cosine-distributed directions; Moreno-Fortuny ch. 3].
///
/// Each pass is in a file of its own:
/// 1. `direct`: shadow rays are sent towards lights (solver/direct).
/// 2. `trace`: the directions are followed once, and what each one met is kept (trace_pass.cpp).
/// 3. `refine`: when light is gathered coarsely, texels whose sites disagree are traced
///    (refine_pass.cpp).
/// 4. `bounce`: one pass per diffuse reflection only looks up hits; the last of them, `tail`,
///    stands for all that would follow (bounce_pass.cpp).
/// 5. `round`: these follow while the error is above its target, or more samples are asked for than
///    there was memory for hits. They trace afresh and read what the last bounce read
///    (round_pass.cpp).
/// Where `solver.emitters` is `transport`, the look-ups find what emitting texels send, too (see
/// sent_emittance()), in one bounce more and at every texel.
/// @param hit_budget_bytes memory for the hits that are kept
std::unique_ptr<Solver> make_gather_solver(const World&, std::uint64_t hit_budget_bytes);

}  // namespace kiln::solver::gather
