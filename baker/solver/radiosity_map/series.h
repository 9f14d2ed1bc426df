#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "baker/solver/sample_plan.h"
#include "proto/bake_settings.h"

namespace kiln::solver::radiosity_map {

/// The samples [first, first + count) of every texel's sequence.
struct Run {
  std::uint32_t first = 0, count = 0;

  std::uint32_t end() const { return first + count; }
};

/// What one pass does to every texel.
struct Step {
  const char* name = "";
  Run direct;               ///< samples of direct light
  Run trace;                ///< directions that are followed
  Run read;                 ///< directions at whose hits radiosity is read: traced or kept ones
  bool keeps_hits = false;  ///< of the directions that are followed
  bool finds_sky = false;   ///< those that meet nothing bring the sky's light
  bool probes = false;      ///< finds what lies hidden inside other geometry
  bool completes = false;   ///< the light is judged afterwards
};

/// The most directions whose hits are kept for the first iterations. The thesis keeps 75 [4.4.2];
/// this is the power of two below.
inline constexpr std::uint32_t kKeptDirections = 64;
/// Iterations of one pass, at most, as a share of those before: 1 / kGrowth.
inline constexpr std::uint32_t kGrowth = 8;

/// Returns how many directions keep their hits within `solver.hit_memory_mib`, a power of two; 0
/// where nothing reads them.
std::uint32_t kept_directions(const proto::SolverSettings&, const SamplePlan&, double texels);

/// Returns the passes of the averaged series, in their order [Moreno-Fortuny algs. 4.1, 4.2]: the
/// first samples of direct light; the directions that are traced in advance; then iterations.
///
/// An iteration adds one indirect sample to the mean of those before, and reads the radiosity of
/// the pass before. As many iterations as 1 / kGrowth of those that are done form one pass, rounded
/// down to a power of two, so that 800 of them take 61 passes; the first 16 are passes of their
/// own, as all are in the thesis. Direct light takes sixteen samples in every sixteen iterations,
/// until its own limit.
std::vector<Step> averaged_steps(const proto::SolverSettings&, const SamplePlan&, double texels);

/// Returns the passes of the unbiased series [Moreno-Fortuny eq. 3.13] before its first bounce.
std::vector<Step> unbiased_beginning(const proto::SolverSettings&, const SamplePlan&, bool has_sky);
/// Returns its bounce, from 0: all samples of one application of the transport operator.
Step unbiased_bounce(const SamplePlan&, std::uint32_t bounce);

/// Returns κ_0 to κ_orders, the share that each order of reflection has in an averaged series of
/// these passes; order 0 is direct light. A pass of n iterations after m others makes it
///
///   κ_k ← (m κ_k + n κ_{k-1}) / (m + n)
///
/// where all on the right is what the pass before left. With n = 1 that is eq. 3.18.
std::vector<double> series_shares(std::span<const Step>, std::uint32_t orders);
/// Returns the share of all light that is missing for that in a closed room whose surfaces all have
/// this albedo: Σ_k (1 - κ_{k+n}) ρ^k (1 - ρ).
/// @param behind n: orders by which the light of emitters is behind, 1 where texels send it
double missing_share(std::span<const Step>, double albedo, std::uint32_t behind = 0);

}  // namespace kiln::solver::radiosity_map
