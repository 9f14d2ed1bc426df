#define KILN_KERNELS kSse2Kernels
#define KILN_KERNELS_NAME "sse2"
#include "baker/simd/kernels.inl"
