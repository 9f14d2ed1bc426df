// The kernels, per instruction set. Items are lanes.
#include <benchmark/benchmark.h>

#include <array>
#include <vector>

#include "baker/simd/kernels.h"
#include "tests/bench/kernel_input.h"

namespace kiln::bench {
namespace {

using simd::InstructionSet;
using simd::Kernels;

/// Runs `once(kernels, number of the packet)` with the instruction set that the benchmark's
/// argument names.
template <class Once>
void per_packet(benchmark::State& state, Once once) {
  const auto set = InstructionSet(state.range(0));
  if (set > simd::best_instruction_set()) {
    state.SkipWithError("this machine has no such instructions");
    return;
  }
  const Kernels& k = simd::kernels(set);
  state.SetLabel(k.name);
  std::uint32_t packet = 0;
  for (auto _ : state) once(k, packet++);
  state.SetItemsProcessed(state.iterations() * 16);
}

void directions(benchmark::State& state) {
  const KernelInput in;
  simd::Directions out;
  per_packet(state, [&](const Kernels& k, std::uint32_t n) {
    in.directions(k, n, out);
    benchmark::DoNotOptimize(out);
  });
}
void view_light(benchmark::State& state) {
  const KernelInput in;
  simd::LightView out;
  per_packet(state, [&](const Kernels& k, std::uint32_t) {
    k.view_light(in.lamp, in.frames, out);
    benchmark::DoNotOptimize(out);
  });
}
void sample_light(benchmark::State& state) {
  const KernelInput in;
  simd::LightRays out;
  per_packet(state, [&](const Kernels& k, std::uint32_t n) {
    in.sample_light(k, n, out);
    benchmark::DoNotOptimize(out);
  });
}
void look_up(benchmark::State& state) {
  const KernelInput in;
  std::array<std::uint32_t, 16> out;
  per_packet(state, [&](const Kernels& k, std::uint32_t n) {
    in.look_up(k, n, out);
    benchmark::DoNotOptimize(out);
  });
}

BENCHMARK(directions)->DenseRange(0, 2)->ArgName("set");
BENCHMARK(view_light)->DenseRange(0, 2)->ArgName("set");
BENCHMARK(sample_light)->DenseRange(0, 2)->ArgName("set");
BENCHMARK(look_up)->DenseRange(0, 2)->ArgName("set");

}  // namespace
}  // namespace kiln::bench
