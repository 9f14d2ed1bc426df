#pragma once

#include <memory>

#include "baker/solver/solver.h"

namespace kiln::solver::directional {

/// Makes the solver of the method `directional` [RTRad §5.4]: every texel sends one set of
/// directions about its normal, the same set in every pass, and reads the radiosity of the pass
/// before where they arrive. Directions have the density cosθ/π, so
///
///   E = E_direct + E_sky + 1/N Σ B(hit)     B = albedo · E of the pass before
///
/// or Σ weight · B for the cells of a hemicube. RTRad's eqs. 5.7 and 5.8 and alg. 8 add cosθ/(π r²)
/// to it, which belongs to sums over areas: `solver.rtrad_compat` does so too.
///
/// The passes are `direct` and `sky`, which such methods share, and one `bounce` for every
/// reflection. The sky has rays of its own: they need only know whether anything is in the way, are
/// drawn anew for every texel, and share the light of a sky map with the rays towards its bright
/// parts. Each bounce traces all rays again, as RTRad does; `gather` keeps what they hit.
std::unique_ptr<Solver> make_directional_solver(const World&);

/// The memory of a bounce, bytes a texel, beside the planes.
double directional_memory_per_texel(const proto::SolverSettings&);

}  // namespace kiln::solver::directional
