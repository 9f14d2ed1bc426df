#pragma once

#include <memory>

#include "baker/solver/solver.h"

namespace kiln::solver::gather {

/// Final gathering with lightmap feedback. Direct light is sampled explicitly; indirect light is
/// the mean radiosity that cosine-distributed directions meet, read from the previous bounce's
/// lightmap [RTRad 5.4, with E = π · mean L for cosine-distributed directions; Moreno-Fortuny ch.
/// 3].
///
/// Passes: `direct`; `trace`, which follows the directions once, remembers the texel that each one
/// met (4 bytes) and adds up the sky; `refine`, where texels between the sites do not agree (see
/// CoarseSites); one `bounce` per diffuse reflection, all look-ups; `tail`, the last of them, which
/// stands for all that would follow. Then a `round` wherever more samples are needed than the hits
/// were remembered of (see SampleRounds): these trace afresh, and read what the last bounce read.
/// @param hit_budget_bytes memory for remembered hits
std::unique_ptr<Solver> make_gather_solver(const SolverInput&, std::uint64_t hit_budget_bytes);

}  // namespace kiln::solver::gather
