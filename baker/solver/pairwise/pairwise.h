#pragma once

#include <cstdint>
#include <memory>

#include "baker/solver/solver.h"

namespace kiln::solver::pairwise {

/// Makes the solver of the method `pairwise`: progressive radiosity over all pairs of texels
/// [RTRad alg. 3]. A texel is a patch, whose view factors to all others are taken anew in every
/// pass (see ViewFactors). A pass is one bounce, by Jacobi's iteration:
///
///   E_i ← E_direct,i + Σ_j F_ij B_j,  B_j = ρ · albedo_j · E_j of the pass before
///   [RTRad eqs. 2.34, 4.8; Moreno-Fortuny eq. 2.14]
///
/// ρ is `solver.reflectivity_factor`. Light that comes straight from emitters, lights and the sky
/// is sampled by the passes `direct` and `sky`, which all such methods share. Passes end at the
/// limit on bounces, or when the next one would change less than the tolerance. Texels without
/// radiosity send nothing, and are not traced.
///
/// Where `solver.emitters` is `transport`, emitting texels send their light in the bounces, too:
/// B_j has M_j = π L_e,j besides, and there is one bounce more. That light lies in the plane of
/// indirect light then.
///
/// j need not be every texel: undersampling and the quadtree put fewer senders in their place, see
/// SenderStrategy.
///
/// Where the memory for it holds all pairs, each unordered pair is traced once, in a pass before
/// the bounces that writes one bit to one texel [RTRad 4.7.4, 5.2]; see visibility_kind().
/// Otherwise a bounce traces both directions of a pair, each by the batch that owns the receiver:
/// reciprocity within a bounce [RTRad alg. 4] would write light to two texels, and the batches of a
/// Pass own one range of texels each.
std::unique_ptr<Solver> make_pairwise_solver(const World&);

/// Makes the solver of the method `matrix`: the exact solution of the system that `pairwise`
/// iterates, for all bounces at once [RTRad eq. 2.40]:
///
///   (I - F diag(ρ · albedo)) E = E_direct, for each channel
///
/// F is kept, 4 bytes a pair of texels. Each unordered pair is traced once [RTRad eq. 2.36]. The
/// system is solved in double precision by BiCGSTAB [van der Vorst, SIAM J. Sci. Stat. Comput. 13,
/// 1992] until what is left of the right side is below kMatrixResidual of it, so to the precision
/// of the light. `solver.bounces` 0 leaves the direct light; all other limits, and the tolerance,
/// don't matter.
std::unique_ptr<Solver> make_matrix_solver(const World&);

/// The residual of the matrix solution, relative to the direct light (root mean square).
inline constexpr double kMatrixResidual = 1e-9;

/// Most scenes have converged after this many bounces, and this share of all pairs face each other;
/// for estimates of work only.
inline constexpr std::uint32_t kTypicalBounces = 10;
inline constexpr double kFacingShare = 0.25;

/// Returns the window of the settings, or what null stands for.
std::uint32_t window_texels(const proto::SolverSettings&, std::uint32_t page_size);

/// Returns the setting `visibility`, or what kAuto stands for with so many texels; never kAuto.
/// That is kCached where bounces of `pairwise` go over pairs of single texels, which it can
/// remember (see SeenPairs), and `solver.visibility_cache_mib` holds all of them; otherwise kRay.
proto::VisibilityKind visibility_kind(const proto::SolverSettings&, std::uint32_t texels);

/// The rays of one pass of `pairwise` over so many texels, with a sender in each window, if all
/// faced each other; and the memory of the methods. Bytes.
double pass_rays(double texels, std::uint32_t pair_samples, std::uint32_t window = 1);
/// The rays of so many bounces, a pass that remembers pairs included, of the pairs that face each
/// other.
double bake_rays(const proto::SolverSettings&, double texels, std::uint32_t window, double bounces);
double pairwise_memory_per_texel(const proto::SolverSettings&);
/// What remembered visibility, voxels, shooting and clamps take beside that, of all texels.
double pairwise_extra_memory(const proto::SolverSettings&, double texels);
double matrix_memory(double texels, const proto::SolverSettings&);  ///< of all texels

}  // namespace kiln::solver::pairwise
