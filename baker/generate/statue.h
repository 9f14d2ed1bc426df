#pragma once

#include <cstdint>

#include "baker/generate/shapes.h"

namespace kiln::generate {

/// Adds a winged figure with a torch, 3.6 m tall, as one closed surface of 1,072 `cells`^2
/// triangles. It looks along +Z; its robe's hem is level with `foot`.
void add_statue(SceneBuilder&, const Part&, math::Vec3 foot, std::uint32_t cells);

}  // namespace kiln::generate
