#include "baker/solver/gather/hit_cache.h"

#include <cstdlib>
#include <new>

#include "baker/simd/kernels.h"

namespace kiln::solver::gather {

void HitMemory::Free::operator()(std::uint32_t* words) const {
  std::free(words);
}

// calloc: the system gives pages when they are first written, which is in the batches, where a
// cancel is seen. Clearing a gigabyte at once takes a second.
HitMemory::HitMemory(std::uint32_t texels, std::uint32_t directions)
    : words_(static_cast<std::uint32_t*>(
          std::calloc(std::size_t(texels) * directions, sizeof(std::uint32_t)))),
      texels_(texels),
      directions_(directions) {
  if (texels > 0 && directions > 0 && !words_) throw std::bad_alloc();
}

std::span<std::byte> HitMemory::bytes() {
  if (!words_) return {};
  return std::as_writable_bytes(std::span(words_.get(), std::size_t(texels_) * directions_));
}

}  // namespace kiln::solver::gather
