#pragma once

#include <cstdint>
#include <span>
#include <stop_token>
#include <vector>

#include "baker/atlas/atlas.h"
#include "baker/math/vec.h"
#include "baker/scene/scene.h"
#include "proto/expected.h"

namespace kiln::exec {
class ThreadPool;
}

namespace kiln::atlas {

inline constexpr std::int32_t kNoTexel = -1;

/// A half-open run of texel indices.
struct TexelRange {
  std::uint32_t begin = 0, end = 0;
  std::uint32_t size() const { return end - begin; }
};

/// A point inside a texel's footprint, always within its triangle.
struct SamplePoint {
  std::uint32_t triangle = 0;
  std::uint16_t u = 0, v = 0;  ///< barycentric, in units of 1/65535, u + v <= 65535

  scene::Bary bary() const { return {float(u) * (1 / 65535.f), float(v) * (1 / 65535.f)}; }
};

/// The surface as the solvers know it: planes with one entry per texel that any triangle touches
/// [RTRad 4.5.2, 4.6]. Texels are sorted by page, then by 8x8 block, then by row, so that a run of
/// indices is a compact patch of surface. Immutable once built.
///
/// The first `front_count` texels lie on pages. A texel of a double-sided surface has a twin for
/// the back in [front_count, size), with the same place and opposite normals. The twin takes part
/// in transport but not in the page.
struct TextureGroup {
  static constexpr std::uint32_t kPointsPerTexel = 16;

  struct Page {
    std::uint32_t width = 0, height = 0;
    std::vector<std::int32_t> texel_at;  ///< row-major, row 0 = top; kNoTexel: empty
  };
  std::vector<Page> pages;
  std::uint32_t front_count = 0;

  std::vector<math::Vec3> position;  ///< m: a point of the surface near the footprint's centroid
  std::vector<math::Vec3> shading_normal;  ///< unit
  std::vector<math::Rgb> albedo;           ///< mean over the footprint, capped at kMaxAlbedo
  std::vector<float> area_m2;           ///< world area of the covered part; sums to the surface's
  std::vector<float> coverage;          ///< covered share of the texel's square, (0, 1]
  std::vector<std::uint32_t> triangle;  ///< the triangle that covers most
  std::vector<std::uint32_t> chart;
  std::vector<std::uint16_t> page;
  std::vector<std::uint16_t> x, y;  ///< on the page
  std::vector<std::int32_t> back;   ///< the back's texel, -1 for one-sided surfaces and for backs
  /// Sample points, stratified by area over the covered footprint, all of the texel's own chart.
  /// They have equal weights.
  std::vector<SamplePoint> points;  ///< kPointsPerTexel per texel

  std::uint64_t albedo_capped = 0;  ///< number of texels that the cap changed

  std::uint32_t size() const { return static_cast<std::uint32_t>(position.size()); }
  bool is_back(std::uint32_t texel) const { return texel >= front_count; }
  std::span<const SamplePoint> points_of(std::uint32_t texel) const {
    return {points.data() + std::size_t(texel) * kPointsPerTexel, kPointsPerTexel};
  }
  /// Returns the texel that lies dx to the right and dy down on the page if it has the same chart
  /// and side, and kNoTexel otherwise.
  std::int32_t neighbor(std::uint32_t texel, int dx, int dy) const {
    const Page& on = pages[page[texel]];
    const int nx = x[texel] + dx, ny = y[texel] + dy;
    if (nx < 0 || ny < 0 || nx >= int(on.width) || ny >= int(on.height)) return kNoTexel;
    const std::int32_t n = on.texel_at[std::size_t(ny) * on.width + std::size_t(nx)];
    if (n == kNoTexel || chart[n] != chart[texel]) return kNoTexel;
    return is_back(texel) ? back[n] : n;
  }
};

/// The most fragments of triangles that eight rows of a page may hold.
inline constexpr std::size_t kMaxBandPieces = std::size_t(1) << 25;

/// Rasterizes the atlas. It clips triangles exactly against texel squares, so that a texel which a
/// triangle only touches is included. A texel that several charts touch belongs to the chart that
/// covers most of it. The area of the other charts there goes to their own nearest texel within two
/// steps, or else to the texel's owner, so that areas sum to the surface's.
///
/// A triangle without area on the page has no texel: its area goes to its chart's nearest texel
/// within two steps, if there is one, and a look-up on it reads its neighbors. `position`,
/// `shading_normal` and `triangle` belong together: they describe the triangle that covers most, at
/// its nearest point to the footprint's centroid.
///
/// Errors: `limit_exceeded` (more than `max_fragments` fragments of triangles in eight rows of a
/// page), `canceled`. The work runs on `pool`, or on the calling thread; the bits are the same.
proto::Expected<TextureGroup> rasterize(const scene::Scene&, const Atlas&, std::stop_token = {},
                                        std::size_t max_fragments = kMaxBandPieces,
                                        exec::ThreadPool* pool = nullptr);

}  // namespace kiln::atlas
