#include "baker/preflight.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "baker/solver/sample_plan.h"

namespace kiln::baker {
namespace {

// Bytes per texel.
constexpr double kSurface = 190;         ///< TextureGroup
constexpr double kLight = 73;            ///< Lightmap
constexpr double kRadiosity = 16;        ///< Feedback
constexpr double kBounced = 28;          ///< planes that a bounce makes anew
constexpr double kRound = 56;            ///< planes that a round, or a pass of paths, makes anew
constexpr double kSignal = 29 + 24 + 8;  ///< FilterBank, and what judges it
constexpr double kSmoothing = 64;        ///< FilterBank when it smooths
constexpr double kSkyColours = 32;       ///< more of that, with a sky map
constexpr double kVariance = 8;          ///< FilteredLight
constexpr double kSmoothed = 36;         ///< its light, unless it is the Lightmap's
constexpr double kHit = 4;
/// Hits of a texel that leave memory pages to rows of texels of their own: those of texels that are
/// interpolated are then never taken. The share that is, at most.
constexpr double kOwnPages = 512, kGathered = 0.7;
// Bytes per triangle: ray tracing, look-ups, charts.
constexpr double kTriangle = 300;
// Bytes per pixel of a sky map, which is in memory twice while it is read.
constexpr double kSkyPixel = 24;
// Bytes per texel square of a page: its map, twice.
constexpr double kSquare = 8;
// While one page is written: an image for each layer, padding, encoders.
constexpr double kImage = 16, kEncoders = 40;
/// What the allocator holds on to.
constexpr double kSlack = 1.15;

/// Share of its squares that a page of packed charts fills, at most.
constexpr double kPacked = 0.9;
/// Texels that edges of charts add.
constexpr double kEdges = 1.1;

template <class T>
double bytes(const std::vector<T>& v) {
  return double(v.size()) * sizeof(T);
}

double scene_bytes(const scene::Scene& s) {
  return bytes(s.positions) + bytes(s.normals) + bytes(s.base_uv) + bytes(s.emission_uv) +
         bytes(s.lightmap_uv) + bytes(s.colors) + bytes(s.source_vertex) + bytes(s.triangles) +
         bytes(s.triangle_part) + bytes(s.image_texels) +
         double(s.sky_map.texels.size()) * kSkyPixel;
}

struct Surface {
  double area_m2 = 0, double_sided_m2 = 0;
  double uv = 0;  ///< what TEXCOORD_1 covers of the unit square, overlaps included
  bool has_uv = true;
};

Surface measure(const scene::Scene& s) {
  Surface all;
  for (std::uint32_t t = 0; t < s.triangles.size(); ++t) {
    const double area = double(triangle_area(s, t));
    all.area_m2 += area;
    if (s.material_of(t).double_sided) all.double_sided_m2 += area;
    all.has_uv = all.has_uv && s.parts[s.triangle_part[t]].has_lightmap_uv;
    const auto& v = s.triangles[t];
    const math::Vec2 a = s.lightmap_uv[v[0]], b = s.lightmap_uv[v[1]], c = s.lightmap_uv[v[2]];
    all.uv +=
        std::abs(double(b.x - a.x) * double(c.y - a.y) - double(c.x - a.x) * double(b.y - a.y)) / 2;
  }
  return all;
}

struct Size {
  double texels = 0, squares = 0;
};

Size size_of(const Surface& surface, const proto::AtlasSettings& atlas) {
  const double page = double(atlas.page_size) * atlas.page_size;
  const bool own_uv = surface.has_uv && atlas.unwrap != proto::Unwrap::kAlways;
  Size size{page * kPacked, page};
  if (own_uv && surface.uv > 0) size.texels = page * std::min(1.0, kEdges * surface.uv);
  if (atlas.texels_per_metre) {
    const double density = double(*atlas.texels_per_metre);
    const double wanted = kEdges * surface.area_m2 * density * density;
    // Charts that are too large for what is left of a page leave it empty.
    const double pages = std::ceil(wanted / (page * kPacked / 1.5));
    size.squares = page * std::clamp(pages, 1.0, double(atlas.max_pages));
    // A lightmap UV set that is one page as it stands stays as it is.
    const double charted = std::min(wanted, size.squares);
    size.texels = own_uv ? std::max(size.texels, charted) : charted;
  }
  if (surface.area_m2 > 0) size.texels *= 1 + surface.double_sided_m2 / surface.area_m2;
  return size;
}

}  // namespace

std::uint64_t estimate_memory(const scene::Scene& scene, const proto::BakeSettings& settings) {
  const auto [texels, squares] = size_of(measure(scene), settings.atlas);
  const solver::SamplePlan plan = solver::sample_plan(settings.solver, settings.quality);
  const bool gathers = settings.solver.method == proto::Method::kGather;
  const bool smooths = gathers && settings.post.filter;
  const double base = texels * (kSurface + kLight);
  double hits = std::min(double(std::uint64_t(settings.solver.hit_memory_mib) << 20),
                         texels * kHit * plan.directions);
  if (plan.coarse && hits >= texels * kOwnPages) hits *= kGathered;
  const double bouncing =
      base + (gathers ? hits + texels * (kBounced + kRadiosity) : texels * kRound);
  const bool rounds = !gathers || plan.target_error > 0;
  const double filtered = texels * (kVariance + (smooths ? kSmoothed : 0));
  const double smoothing = kSmoothing + (scene.sky_map.empty() ? 0 : kSkyColours);
  const double filtering =
      base + filtered +
      texels * ((rounds ? kRound : kBounced) + kSignal + (smooths ? smoothing : 0));
  const double page = double(settings.atlas.page_size) * settings.atlas.page_size;
  const double writing =
      base + filtered + page * (kImage * double(1 + settings.output.layers.size()) + kEncoders);
  const double most = std::max({bouncing, filtering, writing}) + squares * kSquare +
                      double(scene.triangles.size()) * kTriangle + scene_bytes(scene);
  return kProcessBytes + std::uint64_t(kSlack * most);
}

}  // namespace kiln::baker
