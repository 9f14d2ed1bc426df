#include "baker/simd/kernels.h"

namespace kiln::simd {

extern const Kernels kSse2Kernels, kAvx2Kernels, kAvx512Kernels;

InstructionSet best_instruction_set() {
  static const InstructionSet best =
      __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
              __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl")
          ? InstructionSet::kAvx512
      : __builtin_cpu_supports("avx2") ? InstructionSet::kAvx2
                                       : InstructionSet::kSse2;
  return best;
}

const Kernels& kernels(InstructionSet set) {
  switch (set) {
    case InstructionSet::kAvx512:
      return kAvx512Kernels;
    case InstructionSet::kAvx2:
      return kAvx2Kernels;
    case InstructionSet::kSse2:
      break;
  }
  return kSse2Kernels;
}

const Kernels& kernels() {
  static const Kernels& best = kernels(best_instruction_set());
  return best;
}

}  // namespace kiln::simd
