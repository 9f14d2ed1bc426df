// Fixed work for counting instructions: see the script `guard`. Each piece of work leaves a dump of
// callgrind's, and prints its name, how many items it did, and what they are.
#include <dlfcn.h>
#include <embree3/rtcore.h>
#include <valgrind/callgrind.h>

#include <cstdio>
#include <stdexcept>
#include <string>
#include <vector>

#include "baker/exec/thread_pool.h"
#include "baker/methods.h"
#include "baker/solve.h"
#include "tests/bench/ball.h"
#include "tests/bench/kernel_input.h"

namespace {

using Intersect = void (*)(const int*, RTCScene, RTCIntersectContext*, RTCRayHit16*);
using Occluded = void (*)(const int*, RTCScene, RTCIntersectContext*, RTCRay16*);
const auto intersect = reinterpret_cast<Intersect>(dlsym(RTLD_NEXT, "rtcIntersect16"));
const auto occluded = reinterpret_cast<Occluded>(dlsym(RTLD_NEXT, "rtcOccluded16"));

}  // namespace

// The names that the product's calls are linked to, before Embree's own: what goes on in there is
// not counted.
void rtcIntersect16(const int* valid, RTCScene scene, RTCIntersectContext* context,
                    RTCRayHit16* query) {
  CALLGRIND_TOGGLE_COLLECT;
  intersect(valid, scene, context, query);
  CALLGRIND_TOGGLE_COLLECT;
}
void rtcOccluded16(const int* valid, RTCScene scene, RTCIntersectContext* context,
                   RTCRay16* query) {
  CALLGRIND_TOGGLE_COLLECT;
  occluded(valid, scene, context, query);
  CALLGRIND_TOGGLE_COLLECT;
}

namespace kiln::bench {
namespace {

template <class Work>
void count(const std::string& name, const char* item, Work work) {
  CALLGRIND_START_INSTRUMENTATION;
  CALLGRIND_ZERO_STATS;
  const std::uint64_t items = work();
  CALLGRIND_DUMP_STATS_AT(name.c_str());
  CALLGRIND_STOP_INSTRUMENTATION;
  std::printf("%s %llu %s\n", name.c_str(), static_cast<unsigned long long>(items), item);
}

void count_kernels(simd::InstructionSet set) {
  constexpr std::uint32_t kPackets = 256;
  const KernelInput in;
  const simd::Kernels& k = simd::kernels(set);
  const auto each = [&](const char* name, auto once) {
    count(name + std::string("_") + k.name, "lane", [&] {
      for (std::uint32_t p = 0; p < kPackets; ++p) once(p);
      return std::uint64_t(16 * kPackets);
    });
  };
  simd::Directions directions;
  each("directions", [&](std::uint32_t p) { in.directions(k, p, directions); });
  simd::LightView view;
  each("view_light", [&](std::uint32_t) { k.view_light(in.lamp, in.frames, view); });
  simd::LightRays rays;
  each("sample_light", [&](std::uint32_t p) { in.sample_light(k, p, rays); });
  const std::vector<simd::LightGroup> lights(kPackets);  // the work is the same for any
  std::vector<float> weights(16 * kPackets);
  std::vector<std::uint32_t> near(kPackets);
  count(std::string("weigh_lights_") + k.name, "lane", [&] {
    const simd::Viewpoint from{{0, 1, 0}, {0, 1, 0}, 0.1f, 1};
    k.weigh_lights(lights.data(), kPackets, from, weights.data(), near.data());
    return std::uint64_t(16 * kPackets);
  });
  std::array<std::uint32_t, 16> texels;
  each("look_up", [&](std::uint32_t p) { in.look_up(k, p, texels); });
}

/// @return rays
std::uint64_t solve_once(const ReadyScene& ready, const proto::SolverSettings& settings) {
  exec::ThreadPool pool(1);
  const solver::World world = ready.world(settings);
  const auto solver = baker::make_solver(world);
  std::uint64_t rays = 0;
  for (const auto& pass : test::must(baker::solve(world, *solver, pool, {})).passes)
    rays += pass.rays;
  return rays;
}

void count_solves() {
  const ReadyScene ready("cornell", 0, 128);
  proto::SolverSettings settings;
  settings.bounces = 4;
  settings.tolerance = 0;  // never converged: all the bounces
  settings.samples = 16;
  settings.direct_samples = 16;
  count("gather", "ray", [&] { return solve_once(ready, settings); });
  settings.method = proto::Method::kPath;
  settings.samples = 1;
  settings.bounces = 1;
  count("path", "ray", [&] { return solve_once(ready, settings); });
}

}  // namespace
}  // namespace kiln::bench

int main() {
  using namespace kiln;
  if (!intersect || !occluded) {
    std::fprintf(stderr, "guard: Embree's functions are missing\n");
    return 1;
  }
  try {
    std::printf("# %s\n", simd::kernels().name);
    if (simd::best_instruction_set() < simd::InstructionSet::kAvx2) return 0;
    bench::count_kernels(simd::InstructionSet::kSse2);
    bench::count_kernels(simd::InstructionSet::kAvx2);
    bench::count_solves();
  } catch (const std::exception& e) {
    std::fprintf(stderr, "guard: %s\n", e.what());
    return 1;
  }
}
