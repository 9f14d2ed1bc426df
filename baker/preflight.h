#pragma once

#include <cstdint>

#include "baker/scene/scene.h"
#include "proto/bake_settings.h"

namespace kiln::baker {

/// The most memory that a process takes for one bake of the scene: what is told before the atlas is
/// made, and what a service admits jobs by. An upper bound for surfaces of ordinary shape, within
/// half as much again of what is used; counts the scene itself and `kProcessBytes`. Bytes.
std::uint64_t estimate_memory(const scene::Scene&, const proto::BakeSettings&);

/// The part of that which a process has before it bakes anything: to be left out for a second bake
/// beside the first.
inline constexpr std::uint64_t kProcessBytes = std::uint64_t(28) << 20;

}  // namespace kiln::baker
