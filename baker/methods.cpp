#include "baker/methods.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>

#include "baker/solver/directional/directional.h"
#include "baker/solver/emittance.h"
#include "baker/solver/gather/gather.h"
#include "baker/solver/links/links.h"
#include "baker/solver/pairwise/pairwise.h"
#include "baker/solver/path/path.h"
#include "baker/solver/radiosity_map/radiosity_map.h"
#include "baker/solver/radiosity_map/series.h"

namespace kiln::baker {
namespace {

constexpr double kHitBytes = sizeof(std::uint32_t);
/// Hits of a texel that leave memory pages to rows of texels of their own: those of texels that are
/// interpolated are then never taken. The share that is, at most.
constexpr double kOwnPages = 512, kGatheredShare = 0.7;
/// The bytes of what light, half differences and numbers of samples take in a round, or in a pass
/// of paths.
constexpr double kSampledPlanes = 56;
/// The bytes of indirect light, its half difference and the radiosity read, which a bounce makes
/// anew, and of the radiosity as the look-ups read it.
constexpr double kBouncedPlanes = 28, kRadiosity = 16;

/// A bake over pairs of texels that needs more than this is refused as too expensive.
constexpr double kMostPairRays = 1e12, kMostMatrixTexels = 8192;
/// The largest `solver.window` [settings_table.cpp].
constexpr double kMostWindow = 256;
/// The rate that a refusal assumes, for its figure in hours: the same on every machine.
constexpr double kRaysPerSecond = 1e7;

double hit_budget(const proto::SolverSettings& settings) {
  return double(std::uint64_t(settings.hit_memory_mib) << 20);
}

MethodMemory gather_memory(const proto::SolverSettings& settings, const solver::SamplePlan& plan,
                           double texels) {
  MethodMemory memory;
  double hits = std::min(hit_budget(settings), texels * kHitBytes * plan.directions);
  if (plan.coarse && hits >= texels * kOwnPages) hits *= kGatheredShare;
  memory.all_passes = hits;
  memory.texel_state =
      sizeof(math::Rgb) + sizeof(std::uint8_t) + solver::sent_emittance_memory_per_texel(settings);
  memory.texel_pass = kBouncedPlanes + kRadiosity;
  memory.texel_complete = plan.target_error > 0 ? kSampledPlanes : kBouncedPlanes;
  return memory;
}

MethodMemory path_memory(const proto::SolverSettings&, const solver::SamplePlan&, double) {
  return {0, 0, kSampledPlanes, kSampledPlanes};
}

MethodMemory pairwise_memory(const proto::SolverSettings& settings, const solver::SamplePlan&,
                             double texels) {
  MethodMemory memory;
  using namespace solver::pairwise;
  memory.all_passes =
      texels * pairwise_memory_per_texel(settings) + pairwise_extra_memory(settings, texels);
  memory.texel_pass = kBouncedPlanes;
  memory.texel_complete = kSampledPlanes;
  return memory;
}

/// What matrix refuses takes no memory.
MethodMemory matrix_memory(const proto::SolverSettings& settings, const solver::SamplePlan& plan,
                           double texels) {
  MethodMemory memory = pairwise_memory(settings, plan, texels);
  const double most = settings.allow_expensive ? texels : std::min(texels, kMostMatrixTexels);
  memory.all_passes = solver::pairwise::matrix_memory(most, settings);
  return memory;
}

MethodMemory radiosity_map_memory(const proto::SolverSettings& settings,
                                  const solver::SamplePlan& plan, double texels) {
  MethodMemory memory;
  memory.all_passes =
      texels * kHitBytes * solver::radiosity_map::kept_directions(settings, plan, texels);
  memory.texel_state = solver::sent_emittance_memory_per_texel(settings);
  if (settings.ambient_term) memory.texel_state *= 2;  // previews look for it, too
  if (settings.series == proto::Series::kUnbiased) memory.texel_state += sizeof(math::Rgb);
  memory.texel_pass = memory.texel_complete = kSampledPlanes + kBouncedPlanes + kRadiosity;
  return memory;
}

MethodMemory directional_memory(const proto::SolverSettings& settings, const solver::SamplePlan&,
                                double) {
  const double own = solver::directional::directional_memory_per_texel(settings);
  MethodMemory memory;
  memory.texel_pass = kBouncedPlanes + own;
  memory.texel_complete = kSampledPlanes + own;
  return memory;
}

MethodMemory links_memory(const proto::SolverSettings& settings, const solver::SamplePlan&,
                          double texels) {
  MethodMemory memory;
  memory.all_passes = solver::links::links_memory(settings, texels);
  memory.texel_pass = kBouncedPlanes;
  memory.texel_complete = kSampledPlanes;
  return memory;
}

/// Returns two digits of a number, as "0.34", "1200" or "4.4e+13".
std::string rounded(double value) {
  char text[32];
  if (value >= 100 && value < 1e6) {
    const double unit = std::pow(10, std::floor(std::log10(value)) - 1);
    std::snprintf(text, sizeof text, "%.0f", std::round(value / unit) * unit);
  } else {
    std::snprintf(text, sizeof text, "%.2g", value);
  }
  return text;
}
std::string count(double value) {
  return std::to_string(std::uint64_t(value));
}
std::string gib(double bytes) {
  return rounded(bytes / double(1u << 30)) + " GiB";
}
std::string hours(double rays) {
  return rounded(rays / kRaysPerSecond / 3600) + " hours at 10 million rays a second";
}

std::optional<TooExpensive> pairwise_cost(const proto::SolverSettings& settings, double texels) {
  using namespace solver::pairwise;
  const double bounces = std::min(solver::bounce_limit(settings), kTypicalBounces);
  const bool has_windows = settings.undersampling != proto::Undersampling::kNone;
  const std::uint32_t window = has_windows ? settings.window.value_or(2) : 1;
  const double rays = bake_rays(settings, texels, window, bounces);
  if (rays <= kMostPairRays) return std::nullopt;
  TooExpensive found;
  const bool has_leaves = settings.subdivision_threshold.has_value();
  found.cost =
      "pairwise would trace " + std::string(has_leaves ? "up to " : "") + "about " + rounded(rays) +
      " rays between " + count(texels) + " texels in " + count(bounces) +
      (bounces == 1 ? " bounce" : " bounces") + ": about " + hours(rays) + ", and " +
      gib(texels * pairwise_memory_per_texel(settings) + pairwise_extra_memory(settings, texels)) +
      " of memory.";
  // Texels go with the square of the page's side, and rays with the square of texels, or with the
  // texels over the square of the window's side.
  const double finer = std::sqrt(std::sqrt(kMostPairRays / rays));
  const double wider = std::ceil(window * std::sqrt(rays / kMostPairRays));
  if (!has_leaves && wider <= kMostWindow)
    found.advice = "solver.undersampling with a solver.window of " + count(wider) + ", or ";
  found.advice += "make the side of atlas.page_size " + rounded(finer) + " times as long, or less";
  return found;
}

std::optional<TooExpensive> matrix_cost(const proto::SolverSettings& settings, double texels) {
  if (texels <= kMostMatrixTexels) return std::nullopt;
  const double rays = solver::pairwise::kFacingShare * texels * texels * settings.pair_samples;
  return TooExpensive{"matrix would keep the view factors of all pairs of " + count(texels) +
                          " texels, which take " +
                          gib(solver::pairwise::matrix_memory(texels, settings)) +
                          " of memory and about " + rounded(rays) + " rays, " + hours(rays) +
                          ". It takes up to " + count(kMostMatrixTexels) + " texels.",
                      "a smaller atlas.page_size"};
}

std::unique_ptr<solver::Solver> make_gather(const solver::World& world) {
  return solver::gather::make_gather_solver(world, std::uint64_t(world.settings.hit_memory_mib)
                                                       << 20);
}

constexpr std::array kMethods{
    Method{proto::Method::kGather, make_gather, solver::adaptive_plan, /*adaptive=*/true,
           /*filtered=*/true, gather_memory},
    Method{proto::Method::kPath, solver::path::make_path_solver, solver::fixed_plan,
           /*adaptive=*/false, /*filtered=*/false, path_memory},
    Method{proto::Method::kPairwise, solver::pairwise::make_pairwise_solver, solver::fixed_plan,
           /*adaptive=*/false, /*filtered=*/false, pairwise_memory, pairwise_cost},
    Method{proto::Method::kMatrix, solver::pairwise::make_matrix_solver, solver::fixed_plan,
           /*adaptive=*/false, /*filtered=*/false, matrix_memory, matrix_cost},
    Method{proto::Method::kRadiosityMap, solver::radiosity_map::make_radiosity_map_solver,
           solver::iterated_plan, /*adaptive=*/false, /*filtered=*/false, radiosity_map_memory},
    Method{proto::Method::kDirectional, solver::directional::make_directional_solver,
           solver::fixed_plan, /*adaptive=*/false, /*filtered=*/false, directional_memory},
    Method{proto::Method::kLinks, solver::links::make_links_solver, solver::fixed_plan,
           /*adaptive=*/false, /*filtered=*/false, links_memory},
};
static_assert(kMethods.size() == proto::kMethodNames.size(), "each name needs a method");
static_assert(std::ranges::all_of(kMethods, [i = 0u](const Method& m) mutable {
  return std::size_t(m.id) == i++;
}));

}  // namespace

std::span<const Method> methods() {
  return kMethods;
}

const Method& method_of(proto::Method id) {
  return kMethods[std::size_t(id)];
}

std::optional<TooExpensive> too_expensive(const proto::SolverSettings& settings,
                                          std::uint32_t texels) {
  const Method& method = method_of(settings.method);
  if (!method.cost || settings.allow_expensive) return std::nullopt;
  return method.cost(settings, double(texels));
}

proto::Expected<void> check_cost(const proto::SolverSettings& settings, std::uint32_t texels) {
  const auto found = too_expensive(settings, texels);
  if (!found) return {};
  return proto::fail("too_expensive",
                     found->cost + " Use solver.method \"gather\", or " + found->advice +
                         ", or set solver.allow_expensive.",
                     "settings", "/solver/method");
}

std::unique_ptr<solver::Solver> make_solver(const solver::World& world) {
  return method_of(world.settings.method).make(world);
}

solver::SamplePlan sample_plan(const proto::SolverSettings& settings,
                               const proto::QualitySettings& quality, bool many_lights) {
  return method_of(settings.method).plan(settings, quality, many_lights);
}

}  // namespace kiln::baker
