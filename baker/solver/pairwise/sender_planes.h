#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <stop_token>
#include <vector>

#include "baker/solver/world.h"

namespace kiln::solver::pairwise {

/// These functions show texel by texel how senders are chosen: planes to look at [RTRad 4.9]. They
/// say what `pairwise` would do with the settings of the world, whatever its method is. All of them
/// return nothing when stopped.

/// The quadtree of leaf_sides() where the settings have none.
inline constexpr float kUsualThreshold = 0.05f;

/// Returns the radiosity of all texels under an irradiance: ρ · albedo · E, and what they emit
/// where emitters are senders. `irradiance` gives lx.
std::optional<std::vector<math::Rgb>> texel_radiosity(
    const World&, const std::function<math::Rgb(std::uint32_t texel)>& irradiance,
    const std::stop_token&);

/// Returns for each texel the radiosity of the sender that Undersampling::kMipmap makes of it and
/// its like: the mean over the texels of its chart in its window, weighted by area.
std::optional<std::vector<math::Rgb>> window_means(const World&,
                                                   std::span<const math::Rgb> radiosity,
                                                   const std::stop_token&);

/// Returns the side of the leaf of the quadtree that each texel is in, texels.
std::optional<std::vector<std::uint8_t>> leaf_sides(const World&,
                                                    std::span<const math::Rgb> radiosity,
                                                    const std::stop_token&);

/// Returns the area that each texel sends for in the first bounce, m2; 0 where it does not. Where
/// every receiver has senders of its own, they are those of the first texel. @param radiosity after
/// the direct light
std::optional<std::vector<float>> sent_areas(const World&, std::span<const math::Rgb> radiosity,
                                             const std::stop_token&);

/// The most that these take, with their result and the radiosity. Bytes.
double window_means_memory(double texels);
double leaf_sides_memory(double texels, const proto::SolverSettings&);
double sent_areas_memory(double texels, const proto::SolverSettings&);

}  // namespace kiln::solver::pairwise
