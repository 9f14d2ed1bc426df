#pragma once

#include <cstdint>

#include "baker/solver/footprint.h"

namespace kiln::solver {

/// Returns bits of the points of a texel that lie inside other geometry, or behind it: the ray
/// along the normal meets the back of a one-sided surface, and so do three that are tilted by 60
/// degrees. `gather` asks all its rays instead.
std::uint32_t hidden_points(const World&, const Footprint&);

}  // namespace kiln::solver
