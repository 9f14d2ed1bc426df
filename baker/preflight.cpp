#include "baker/preflight.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "baker/lightmap/lightmap.h"
#include "baker/made_layers.h"
#include "baker/methods.h"
#include "baker/reference.h"

namespace kiln::baker {
namespace {

// Bytes per texel.
constexpr double kSurface = 190;         ///< TextureGroup
constexpr double kSignal = 29 + 24 + 8;  ///< FilterBank, and what judges it
constexpr double kSmoothing = 64;        ///< FilterBank when it smooths
constexpr double kSkyColors = 32;        ///< more of that, with a sky map
constexpr double kVariance = 8;          ///< FilteredLight
constexpr double kSmoothed = 36;         ///< its light, unless it is the Lightmap's
// Bytes per triangle: ray tracing, look-ups, charts.
constexpr double kTriangle = 300;
// Bytes per pixel of a sky map, which is in memory twice while it is read.
constexpr double kSkyPixel = 24;
// Bytes per texel square of a page: its map, twice.
constexpr double kSquare = 8;
// While one page is written: an image for each layer, and two for unlit colors; padding, encoders,
// and the samples of two PNG files and a row of tiles, which the processes that encode them copy.
constexpr double kImage = 16, kEncoders = 48;
/// The samples of one further picture of a page, twice, and its file.
constexpr double kPicture = 9;
/// Light that fades: what a preview shows, and what the next one will.
constexpr double kFading = 2 * 3 * sizeof(math::Rgb);
/// What the allocator holds on to.
constexpr double kSlack = 1.15;

/// Share of its squares that a page of packed charts fills, at most.
constexpr double kPacked = 0.9;
/// Texels that edges of charts add.
constexpr double kEdges = 1.1;

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

/// Returns the memory that the method of a report takes; no filter smooths its light.
double reference_bytes(const proto::BakeSettings& settings, proto::Method id, double texels) {
  const proto::SolverSettings solver = reference_settings(settings, id);
  const Method& method = method_of(id);
  const MethodMemory own =
      method.memory(solver, method.plan(solver, settings.quality, false), texels);
  const lightmap::Lightmap none(1);
  const double light = double(none.texel_bytes(none.planes())) + own.texel_state;
  const double solving = std::max(own.all_passes + texels * own.texel_pass,
                                  texels * (own.texel_complete + kSignal + kVariance));
  return texels * light + solving;
}

}  // namespace

std::uint64_t estimate_memory(const scene::Scene& scene, const proto::BakeSettings& settings) {
  const auto [texels, squares] = size_of(measure(scene), settings.atlas);
  const Method& method = method_of(settings.solver.method);
  const solver::SamplePlan plan = method.plan(settings.solver, settings.quality, false);
  const MethodMemory own = method.memory(settings.solver, plan, texels);
  const bool smooths = method.filtered && settings.post.filter;
  const lightmap::Lightmap none(1);
  const double light = double(none.texel_bytes(none.planes())) + own.texel_state;
  const double fading = settings.output.preview_fade < 1 ? kFading : 0;
  const double base = texels * (kSurface + light + fading);
  const double bouncing = base + own.all_passes + texels * own.texel_pass;
  const double filtered = texels * (kVariance + (smooths ? kSmoothed : 0));
  const double smoothing = kSmoothing + (scene.sky_map.empty() ? 0 : kSkyColors);
  const double filtering =
      base + filtered + texels * (own.texel_complete + kSignal + (smooths ? smoothing : 0));
  const double page = double(settings.atlas.page_size) * settings.atlas.page_size;
  const auto& formats = settings.output.formats;
  const bool has_glb = std::find(formats.begin(), formats.end(), "glb") != formats.end();
  const bool unlit = has_glb && settings.output.glb_mode == proto::GlbMode::kUnlit;
  const auto& layers = settings.output.layers;
  const bool draws = std::find(formats.begin(), formats.end(), "png") != formats.end();
  const auto pictures =
      draws ? std::count_if(layers.begin(), layers.end(),
                            [](const std::string& name) { return name != "irradiance"; })
            : 0;
  const LayerMemory made = layer_memory(settings, texels);
  const double finished = base + filtered + made.kept;
  const double writing = finished + page * (kImage * double((unlit ? 3 : 1) + layers.size()) +
                                            kEncoders + kPicture * double(pictures));
  double making = finished + made.making;
  double reporting = 0;
  if (settings.report.against) {
    const auto id = settings.report.method();
    if (id) reporting = base + filtered + reference_bytes(settings, *id, texels);
    const double reference = id ? texels * sizeof(math::Rgb) : 0;
    reporting =
        std::max(reporting, finished + reference + page * (2 * kImage + kPicture + kEncoders));
    making += reference + page * kImage;
  }
  const double most = std::max({bouncing, filtering, making, writing, reporting}) +
                      squares * kSquare + double(scene.triangles.size()) * kTriangle +
                      double(scene::memory_bytes(scene)) +
                      double(scene.sky_map.texels.size()) * kSkyPixel;
  return kProcessBytes + std::uint64_t(kSlack * most);
}

}  // namespace kiln::baker
