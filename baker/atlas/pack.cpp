#include "baker/atlas/pack.h"

#include <algorithm>
#include <vector>

namespace {

/// std::stable_sort in qsort's place: equal rectangles must keep their order on every C library.
template <class T, class Compare>
void stable_sort_rects(T* first, int count, std::size_t /*size*/, Compare compare) {
  std::stable_sort(first, first + count,
                   [&](const T& a, const T& b) { return compare(&a, &b) < 0; });
}

}  // namespace

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wold-style-cast"
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#define STBRP_STATIC
#define STBRP_SORT stable_sort_rects
#define STB_RECT_PACK_IMPLEMENTATION
#include <stb/stb_rect_pack.h>
#pragma GCC diagnostic pop

namespace kiln::baker::atlas_detail {

bool pack_square(std::span<PackRect> rects, std::uint32_t size) {
  std::vector<stbrp_rect> work(rects.size());
  for (std::size_t i = 0; i < rects.size(); ++i) {
    if (rects[i].width > size || rects[i].height > size) return false;
    work[i].id = int(i);
    work[i].w = int(rects[i].width);
    work[i].h = int(rects[i].height);
  }
  stbrp_context context;
  std::vector<stbrp_node> nodes(size);
  stbrp_init_target(&context, int(size), int(size), nodes.data(), int(nodes.size()));
  if (stbrp_pack_rects(&context, work.data(), int(work.size())) == 0) return false;
  for (std::size_t i = 0; i < rects.size(); ++i) {
    rects[i].x = std::uint32_t(work[i].x);
    rects[i].y = std::uint32_t(work[i].y);
  }
  return true;
}

}  // namespace kiln::baker::atlas_detail
