#pragma once

#include <memory>

#include "baker/solver/solver.h"

namespace kiln::solver::path {

/// Makes the solver of the method `path`: unbiased path tracing of the same texels with next-event
/// estimation, the reference that every other method is measured against [Moreno-Fortuny 5.1].
///
/// A path starts at a point of the texel's footprint; each vertex samples one area light and one
/// punctual light; a ray that leaves the scene brings sky. Emitters are never counted by hits, but
/// with `solver.emitters` transport: then no vertex samples emitting surfaces, and each ray brings
/// what the surface it meets emits. The expectation is the same; that light lies in the plane of
/// indirect light. Paths end after `bounces` diffuse reflections. Passes are blocks of samples; the
/// light after a pass is the mean over the samples so far.
std::unique_ptr<Solver> make_path_solver(const World&);

}  // namespace kiln::solver::path
