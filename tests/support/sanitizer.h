#pragma once

#include <cstddef>

namespace kiln::test {

// Sanitizers make every memory access dearer; limits of time that hold without them are widened by
// this much, and sizes that only serve to take long are divided by it.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr int kSlowdown = 10;
#else
inline constexpr int kSlowdown = 1;
#endif

}  // namespace kiln::test
