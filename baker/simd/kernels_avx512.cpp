#define KILN_KERNELS kAvx512Kernels
#define KILN_KERNELS_NAME "avx512"
#include "baker/simd/kernels.inl"
