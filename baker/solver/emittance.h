#pragma once

#include <vector>

#include "baker/solver/world.h"

namespace kiln::solver {

/// Returns whether emitters send their light as any texel does.
inline bool emitters_send(const proto::SolverSettings& s) {
  return s.emitters == proto::Emitters::kTransport;
}

/// Returns the light that each texel sends of itself, lx: M = π L_e, where L_e is the mean over its
/// sample points. For methods that transport the light of emitters as that of any texel
/// [RTRad 4.7]. Backs of double-sided emitters shine, too.
std::vector<math::Rgb> texel_emittance(const World&);
math::Rgb texel_emittance(const World&, std::uint32_t texel);

}  // namespace kiln::solver
