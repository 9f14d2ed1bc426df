#pragma once

#include <memory>

#include "baker/solver/solver.h"

namespace kiln::solver::radiosity_map {

/// Makes the solver of the method `radiosity_map`: Monte-Carlo radiosity on the texels of the
/// lightmap, a sample of every texel at a time [Moreno-Fortuny ch. 3, 4].
///
/// Direct light: see EmitterLight. Indirect light is the mean radiosity of the texels that
/// cosine-distributed directions meet [eq. 3.7]; one that meets nothing brings the sky's radiance
/// [alg. C.9], which goes to its own plane. Two series lead from samples to bounces:
///
/// `averaged` [eqs. 3.14, 3.15]: each sample reads the mean of all before it, so that all orders of
/// reflection grow at once, and high ones are short of light. See averaged_steps() for its passes
/// and series_shares() for what it lacks; remarks() tells it.
///
/// `unbiased` [eq. 3.13]: all samples of a bounce are taken before the next one begins, each anew.
/// A bounce reads only what the one before has added. Ends at the limit on bounces, or when the
/// next one would change less than the tolerance.
///
/// Where `solver.emitters` is `transport`, what is read has what emitting texels send, too (see
/// sent_emittance()): the light of emitters then comes with the first order of reflection.
///
/// What lies hidden inside other geometry is mended as in `gather`.
std::unique_ptr<Solver> make_radiosity_map_solver(const World&);

}  // namespace kiln::solver::radiosity_map
