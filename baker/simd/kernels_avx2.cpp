#define KILN_KERNELS kAvx2Kernels
#define KILN_KERNELS_NAME "avx2"
#include "baker/simd/kernels.inl"
