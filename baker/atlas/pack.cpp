#include "baker/atlas/pack.h"

#include <algorithm>
#include <vector>

#include "baker/exec/stop.h"

namespace {

/// Takes the place of qsort, since equal rectangles must keep their order on every C library.
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

namespace kiln::atlas {

constexpr std::size_t kPortion = 1024;  // rectangles between two looks at the stop token

bool pack_square(std::span<PackRect> rects, std::uint32_t size, const std::stop_token& stop) {
  std::vector<stbrp_rect> work(rects.size());
  for (std::size_t i = 0; i < rects.size(); ++i) {
    if (rects[i].width > size || rects[i].height > size) return false;
    work[i].id = int(i);
    work[i].w = int(rects[i].width);
    work[i].h = int(rects[i].height);
  }
  // Sorts in the library's own order, so that handing the rectangles over in portions changes
  // nothing.
  const auto before = [](const stbrp_rect& a, const stbrp_rect& b) {
    return rect_height_compare(&a, &b) < 0;
  };
  if (!exec::sort_unless_stopped(work, before, stop)) return false;
  stbrp_context context;
  std::vector<stbrp_node> nodes(size);
  stbrp_init_target(&context, int(size), int(size), nodes.data(), int(nodes.size()));
  for (std::size_t i = 0; i < work.size(); i += kPortion) {
    if (stop.stop_requested()) return false;
    const std::size_t count = std::min(kPortion, work.size() - i);
    if (stbrp_pack_rects(&context, &work[i], int(count)) == 0) return false;
  }
  for (const stbrp_rect& rect : work) {
    PackRect& out = rects[std::size_t(rect.id)];
    out.x = std::uint32_t(rect.x);
    out.y = std::uint32_t(rect.y);
  }
  return true;
}

}  // namespace kiln::atlas
