#pragma once

#include <cstdint>
#include <vector>

#include "baker/solver/world.h"

namespace kiln::solver {

/// Returns whether emitters send their light as any texel does.
inline bool emitters_send(const proto::SolverSettings& s) {
  return s.emitters == proto::Emitters::kTransport;
}

/// Returns the most passes of light over the texels. One more than the bounces brings the light of
/// emitters that send it as any texel does.
inline std::uint32_t bounce_limit(const proto::SolverSettings& s) {
  return s.bounces + emitters_send(s);
}

/// Returns the light that each texel sends of itself, lx: M = π L_e, where L_e is the mean over its
/// sample points. For methods that transport the light of emitters as that of any texel
/// [RTRad 4.7]. Backs of double-sided emitters shine, too.
std::vector<math::Rgb> texel_emittance(const World&);
math::Rgb texel_emittance(const World&, std::uint32_t texel);
/// Returns the same where emitters send their light so, otherwise nothing.
std::vector<math::Rgb> sent_emittance(const World&);
/// Bytes that it takes.
inline double sent_emittance_memory_per_texel(const proto::SolverSettings& s) {
  return emitters_send(s) ? sizeof(math::Rgb) : 0;
}

}  // namespace kiln::solver
