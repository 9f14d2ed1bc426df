#pragma once

#include <span>

#include "baker/atlas/texture_group.h"
#include "baker/lightmap/lightmap.h"

namespace kiln::solver::radiosity_map {

/// Returns the light as a preview shows it while a bake runs, with the temporary ambient term
/// [Moreno-Fortuny 6.3; Cohen et al., "A Progressive Refinement Approach to Fast Radiosity Image
/// Generation", SIGGRAPH 1988]: every texel gets the mean indirect light that is still missing.
///
/// In a closed room the mean of E is that of B, so with the mean albedo ρ and the mean b of what
/// direct light and the sky leave reflected, b / (1 - ρ) will arrive in the end. Where a scene is
/// open that is too much: the term never goes into the light of a bake.
/// @param emittance M of the texels where they send it, see sent_emittance(): it adds to b
lightmap::Lightmap with_ambient_term(const atlas::TextureGroup&, lightmap::Lightmap,
                                     std::span<const math::Rgb> emittance = {});

}  // namespace kiln::solver::radiosity_map
