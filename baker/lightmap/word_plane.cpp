#include "baker/lightmap/word_plane.h"

#include <cstdlib>
#include <new>

namespace kiln::lightmap {

// calloc gives pages when they are first written, which is in the batches, where a cancel is seen.
// Clearing a gigabyte at once takes a second.
WordPlane::WordPlane(std::uint32_t texels, std::uint32_t words)
    : texels_(texels), per_texel_(words) {
  auto* const memory =
      static_cast<std::uint32_t*>(std::calloc(std::size_t(texels) * words, sizeof(std::uint32_t)));
  if (texels > 0 && words > 0 && !memory) throw std::bad_alloc();
  words_ = std::shared_ptr<std::uint32_t[]>(memory, [](std::uint32_t* p) { std::free(p); });
}

}  // namespace kiln::lightmap
