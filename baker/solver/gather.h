#pragma once

#include <memory>

#include "baker/solver/solver.h"

namespace kiln::baker {

/// Final gathering with lightmap feedback. Direct light is sampled explicitly; indirect light is
/// the mean radiosity that cosine-distributed directions meet, read from the previous bounce's
/// lightmap [RTRad 5.4, with E = π · mean L for cosine-distributed directions; Moreno-Fortuny ch.
/// 3].
///
/// Passes: `direct`; `trace`, which follows the directions once, remembers the texel that each one
/// met (4 bytes) and adds up the sky; one `bounce` per diffuse reflection, all look-ups. Where the
/// hits of all samples would not fit the budget, fewer are kept, and a `final gather` with the full
/// number traces afresh at the end.
/// @param hit_budget_bytes memory for remembered hits
std::unique_ptr<Solver> make_gather_solver(const SolverInput&, std::uint64_t hit_budget_bytes);

}  // namespace kiln::baker
