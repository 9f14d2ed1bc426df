#include "baker/methods.h"

#include <algorithm>
#include <array>

#include "baker/solver/gather/gather.h"
#include "baker/solver/path/path.h"

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

double hit_budget(const proto::SolverSettings& settings) {
  return double(std::uint64_t(settings.hit_memory_mib) << 20);
}

MethodMemory gather_memory(const proto::SolverSettings& settings, const solver::SamplePlan& plan,
                           double texels) {
  MethodMemory memory;
  double hits = std::min(hit_budget(settings), texels * kHitBytes * plan.directions);
  if (plan.coarse && hits >= texels * kOwnPages) hits *= kGatheredShare;
  memory.all_passes = hits;
  memory.texel_state = sizeof(math::Rgb) + sizeof(std::uint8_t);
  memory.texel_pass = kBouncedPlanes + kRadiosity;
  memory.texel_complete = plan.target_error > 0 ? kSampledPlanes : kBouncedPlanes;
  return memory;
}

MethodMemory path_memory(const proto::SolverSettings&, const solver::SamplePlan&, double) {
  return {0, 0, kSampledPlanes, kSampledPlanes};
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

std::unique_ptr<solver::Solver> make_solver(const solver::World& world) {
  return method_of(world.settings.method).make(world);
}

solver::SamplePlan sample_plan(const proto::SolverSettings& settings,
                               const proto::QualitySettings& quality, bool many_lights) {
  return method_of(settings.method).plan(settings, quality, many_lights);
}

}  // namespace kiln::baker
