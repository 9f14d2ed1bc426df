#pragma once

#include <memory>

#include "baker/solver/solver.h"

namespace kiln::solver::links {

/// Makes the solver of the method `links`: hierarchical radiosity [Hanrahan, Salzman and Aupperle,
/// SIGGRAPH 1991; Moreno-Fortuny 2.2.3]. Groups of texels exchange light over links (LinkTree), as
/// coarse as an energy-weighted bound on a link's error allows:
///
///   E_p ← E_direct,p + Σ_q F_pq B_q over the links of p and of all groups that p belongs to
///   F_pq = A_q mean_k cosθ_k cosθ'_k V_k / (π r_k²)   over sixteen pairs of texels, eq. 4.1 of
///   RTRad
///
/// A link carries a group's mean radiosity, and has a factor for each quarter of the receiver. It
/// is refined while the light of the sixteen pairs may be off by more than `solver.link_error` of
/// the mean radiosity of direct light: at the receiver where the quarters differ most, at the
/// sender where the pairs of one quarter do. It is also refined while the brightest pair, seen or
/// not, would bring kMostLight times as much. Where both ends are few texels, each pair of them has
/// the factor of `pairwise`, near field and window included.
///
/// A texel that sees nothing of what its group's links bring stays dark: it is asked for itself, so
/// that no light crosses a wall that parts a group.
///
/// The links of a receiver are found anew in each bounce, since they hang on the light. The light
/// comes from the passes `direct` and `sky`, and then a bounce a pass, as for `pairwise`.
std::unique_ptr<Solver> make_links_solver(const World&);

/// Returns the memory that the method takes for all texels beside the light, bytes.
double links_memory(const proto::SolverSettings&, double texels);

}  // namespace kiln::solver::links
