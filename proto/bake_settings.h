#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace kiln::proto {

/// Settings of a bake, with their defaults. The JSON names equal the member names
/// (`solver.samples`); ranges and descriptions live in settings_table.cpp, which the parser, the
/// published JSON Schema and the documentation share.

enum class Unwrap {
  kAuto,      ///< use TEXCOORD_1 where it is valid for a lightmap, otherwise unwrap
  kExisting,  ///< use TEXCOORD_1, or fail with `invalid_lightmap_uv`
  kAlways,    ///< ignore TEXCOORD_1 and unwrap
};

struct AtlasSettings {
  static constexpr std::uint32_t kMostPageSize = 16384, kMostPages = 64;

  std::uint32_t page_size = 1024;         ///< texels along one side of a page
  std::uint32_t max_pages = 8;            ///< a scene that needs more is the error `atlas_full`
  std::optional<float> texels_per_metre;  ///< null: the density that fills one page
  Unwrap unwrap = Unwrap::kAuto;
  std::uint32_t gutter = 4;  ///< empty texels around each chart that the baker places
};

/// Names of qualities. Each stands for a target error; see target_error().
enum class Preset { kDraft, kPreview, kProduction, kReference };

/// The figure that must not exceed the target error.
enum class ErrorMeasure {
  kPercentile95,  ///< the relative standard error that 95 of 100 texels don't exceed
  kRms,           ///< root mean square of the texels' standard errors, over their mean light
};

struct QualitySettings {
  Preset preset = Preset::kProduction;
  ErrorMeasure measure = ErrorMeasure::kPercentile95;
  std::optional<float> target_error;  ///< relative; null: the preset's
  std::uint32_t max_samples = 4096;   ///< most samples of a kind per texel for a target
};

/// Returns the relative standard error that a bake samples down to.
constexpr float target_error(Preset preset) {
  switch (preset) {
    case Preset::kDraft:
      return 0.1f;
    case Preset::kPreview:
      return 0.05f;
    case Preset::kProduction:
      break;
    case Preset::kReference:
      return 0.005f;
  }
  return 0.018f;
}
inline float target_error(const QualitySettings& q) {
  return q.target_error.value_or(target_error(q.preset));
}

enum class Method { kGather, kPath, kPairwise, kMatrix, kRadiosityMap, kDirectional, kLinks };

/// A word of the settings and what it means, for the schema and the documentation.
struct Word {
  const char* name;
  const char* description;
};

/// The methods by their ids. baker/methods.h makes a solver of each.
inline constexpr std::array kMethodNames{
    Word{"gather",
         "direct light by explicit sampling, bounces by gathering from the lightmap of the pass "
         "before."},
    Word{"path", "unbiased path tracing, the slow reference."},
    Word{"pairwise", "progressive radiosity over all pairs of texels, for small pages."},
    Word{"matrix", "the system of pairwise solved exactly, for a few thousand texels."},
    Word{"radiosity_map",
         "a sample of every texel at a time, each reading the mean of those before."},
    Word{"directional", "a fixed set of directions for every texel, traced in every bounce."},
    Word{"links", "hierarchical radiosity: groups of texels exchange light over links."},
};
constexpr const char* to_string(Method m) {
  return kMethodNames[static_cast<std::size_t>(m)].name;
}
/// Returns the method of that name, or nothing.
inline std::optional<Method> method_named(std::string_view name) {
  for (std::size_t i = 0; i < kMethodNames.size(); ++i)
    if (name == kMethodNames[i].name) return static_cast<Method>(i);
  return std::nullopt;
}

/// The layers that a page may have. baker/output/layers.h says what each shows of a texel.
inline constexpr std::array kLayerNames{
    Word{"irradiance", ""},
    Word{"direct", ""},
    Word{"indirect", ""},
    Word{"raw", "the irradiance before the filter."},
    Word{"standard_error",
         "the standard error of the luminance, lx: R of all light, G of direct light, B of sky and "
         "indirect light."},
    Word{"samples", "R is the number of directions, G that of shadow rays at most, B is 0."},
    Word{"position", "the place in the world, m."},
    Word{"normal", "the shading normal."},
    Word{"albedo", ""},
    Word{"area", "the area of surface that the texel covers, m2."},
    Word{"emission", "the radiance that the surface emits, cd/m2."},
    Word{"coverage", "the covered share of the texel."},
    Word{"validity", "the share of the texel that is not inside other geometry."},
    Word{"chart", "a color for each chart."},
    Word{"texel_checker", "a checkerboard of the texels."},
    Word{"mip",
         "the mean radiosity of the texel's chart in a window of solver.window, as the mipmap of "
         "undersampling sends it, lx."},
    Word{"tree",
         "the side of the leaf of the quadtree that the texel is in, texels; with a threshold of "
         "0.05 where subdivision_threshold is null."},
    Word{"senders",
         "the area that the texel sends light for in the first bounce of pairwise, m2; 0 where it "
         "sends none."},
    Word{"voxels",
         "a color for each voxel of solver.voxel_grid that is filled; black where it is empty, "
         "which is a hole for the march through voxels."},
    Word{"error", "the distance of each channel to the reference that report.against names, lx."},
};

/// Selects the rays that are traced together, sixteen at a time (gather).
enum class RayPattern { kAuto, kTile, kBlock, kStrata, kIncoherent };

/// Techniques that lower the error at equal time. Each can be left out to see by how much (gather).
enum class Technique { kLowDiscrepancy, kClosedForm, kLightImportance, kShadowProbes };

/// The texels that send light to all others (pairwise).
enum class Undersampling {
  kNone,        ///< every texel
  kStride,      ///< the upper left texel of every window
  kMonteCarlo,  ///< a random texel of every window
  kMipmap,      ///< the mean of every window
};

/// What the random texel of a window hangs on (pairwise, monte_carlo).
enum class SenderSeed { kWindow, kReceiver };

/// The order in which the bounces of light are solved (pairwise).
enum class Iteration { kJacobi, kGaussSeidel, kShooting };

/// The way in which it is found what stands between two texels (pairwise, matrix).
enum class VisibilityKind {
  kAuto,    ///< cached where the memory for it holds all pairs, otherwise ray (pairwise)
  kRay,     ///< a ray in every bounce, from either end
  kCached,  ///< a ray for each unordered pair, once; its answer is remembered
  kVoxel,   ///< a march through voxels
};
enum class VoxelMarch { kFixedSteps, kExact };

/// The directions of a texel (directional).
enum class DirectionSetKind { kLargestEmptyCircle, kHemicube };

/// The mean that the samples of bounces form (radiosity_map).
enum class Series { kAveraged, kUnbiased };

/// Points on an area light (radiosity_map).
enum class LightSampling { kUniform, kStratified, kSolidAngle };

/// Whether emitters are sampled by rays of their own, or send light as any texel does.
enum class Emitters { kExplicit, kTransport };

struct SolverSettings {
  static constexpr std::uint32_t kMostDirections = 4096;  ///< of one texel (directional)

  Method method = Method::kGather;
  std::uint32_t bounces = 16;  ///< diffuse bounces after direct light
  /// Indirect directions (gather, directional), paths (path), directions to the sky (pairwise,
  /// matrix) or iterations (radiosity_map) per texel; null: as many as the quality asks for
  /// (gather), 800 (radiosity_map), 256.
  std::optional<std::uint32_t> samples;
  /// Shadow rays per texel towards area lights (all but path); null: 200 (radiosity_map), as many
  /// as the quality asks for.
  std::optional<std::uint32_t> direct_samples;
  std::uint32_t hit_memory_mib = 1024;  ///< memory for remembered hits (gather, radiosity_map)
  bool coarse_indirect = true;  ///< gather every second texel and interpolate between them (gather)
  RayPattern ray_pattern = RayPattern::kAuto;
  float tolerance = 0.001f;  ///< stop when a bounce changes E by less than this share
  std::uint64_t seed = 1;    ///< below 2^53, so that JSON keeps it
  std::vector<Technique> without{};
  std::uint32_t pair_samples = 1;  ///< pairs of points for a view factor (pairwise, matrix)
  bool near_field = true;          ///< mean view factors of texels that are near to each other
  float reflectivity_factor = 1;   ///< factor on every albedo (pairwise, matrix)
  float distance_factor = 1;       ///< factor on distances in view factors (pairwise, matrix)
  /// Texels of a chart that lie less than so many texels apart in x and in y exchange no light
  /// (pairwise, matrix); null: page_size / 128, at least 1, which is a texel itself.
  std::optional<std::uint32_t> window;
  Undersampling undersampling = Undersampling::kNone;
  SenderSeed sender_seed = SenderSeed::kWindow;
  Iteration iteration = Iteration::kJacobi;
  std::optional<std::uint32_t> batch_texels;  ///< texels of a batch; null: by the cost of a texel
  /// Clamps of pairwise: of the radiosity that one sender adds, as a share of the brightest
  /// emitter's, and of a view factor. null: nothing is clamped.
  std::optional<float> max_contribution, max_view_factor;
  /// Senders are the leaves of a quadtree whose gradient stays below this; null: no quadtree.
  std::optional<float> subdivision_threshold;
  float subdivision_ramp = 0;              ///< added to the threshold after every pass
  std::uint32_t subdivision_max_node = 8;  ///< longest side of a leaf, texels
  VisibilityKind visibility = VisibilityKind::kAuto;
  std::uint32_t visibility_cache_mib = 256;  ///< memory for remembered visibility (cached)
  std::uint32_t voxel_grid = 64;             ///< voxels along the longest side of the scene (voxel)
  VoxelMarch voxel_march = VoxelMarch::kExact;
  float voxel_ratio = 1;  ///< share of segments that march through voxels, not rays (voxel)
  DirectionSetKind direction_set = DirectionSetKind::kLargestEmptyCircle;
  bool rotate_directions = true;  ///< each texel turns the set about its normal (directional)
  bool mip_radiosity = true;      ///< directions read the mean of what they spread to (directional)
  bool rtrad_compat = false;      ///< the formula of RTRad's alg. 8, to show the difference
  Series series = Series::kAveraged;
  std::uint32_t initial_samples = 16;  ///< samples of direct light before the first bounce
  bool same_directions = false;        ///< all texels take the same random numbers
  LightSampling light_sampling = LightSampling::kUniform;
  bool ambient_term = false;  ///< previews add an estimate of the light that is still missing
  Emitters emitters = Emitters::kExplicit;
  float link_error = 0.003f;     ///< most light that a link may be off by; see the settings' table
  bool allow_expensive = false;  ///< bake what is refused as `too_expensive`

  bool uses(Technique t) const {
    return std::find(without.begin(), without.end(), t) == without.end();
  }
};

struct SkySettings {
  std::array<float, 3> radiance{0, 0, 0};  ///< cd/m2, the same in every direction
  /// The name of an equirectangular side file, whose light adds to radiance.
  std::optional<std::string> map;
  float scale = 1;     ///< cd/m2 for a map's value of 1
  float rotation = 0;  ///< degrees by which the map is turned about +Y
};

enum class LightType { kDirectional, kPoint, kSpot, kRect };

/// A light beside those of the glTF. Coordinates are world space in meters, with glTF axes (+Y up).
struct LightSettings {
  LightType type = LightType::kPoint;
  std::array<float, 3> color{1, 1, 1};     ///< linear Rec. 709
  float intensity = 1;                     ///< lx, cd, cd, cd/m2 by type
  std::array<float, 3> position{0, 0, 0};  ///< not used by directional
  /// The direction in which the light travels; not used by point.
  std::array<float, 3> direction{0, -1, 0};
  std::optional<float> range;           ///< m, point and spot; null: unlimited
  float inner_cone_angle = 0;           ///< rad, spot
  float outer_cone_angle = 0.7853982f;  ///< rad, spot
  float width = 1;                      ///< m, rect
  float height = 1;                     ///< m, rect
};

struct PostSettings {
  bool filter = true;        ///< smooth indirect light where that lowers its error (gather)
  std::uint32_t dilate = 4;  ///< texels of padding filled around charts; 0: the whole page
};

enum class Precision { kHalf, kFloat };

/// The form of the pages inside lit.glb.
enum class GlbLightmap {
  kSrgb8,  ///< eight bits with the curve of sRGB, over a scale that nearly all texels stay below
  kRgbm,   ///< eight bits of color and a factor in alpha, which hold the whole range
  kNone,   ///< no pages: texture coordinates and names only
};

/// The way in which lit.glb shows the light.
enum class GlbMode {
  kLightmap,  ///< as a lightmap beside the materials
  kUnlit,     ///< as the color of unlit materials, for viewers that know no lightmap
};

struct OutputSettings {
  Precision precision = Precision::kHalf;
  std::vector<std::string> layers{"irradiance"};  ///< see the settings' table
  std::vector<std::string> formats{"exr", "png", "glb"};
  std::optional<float> exposure;  ///< scale of the preview; null: automatic by percentile
  /// k of the previews' curve c / (k + c), with c over the brightest value; null: the usual curve.
  std::optional<float> tone_curve;
  float preview_fade = 1;  ///< share of the way to the computed light that a preview goes
  GlbLightmap glb_lightmap = GlbLightmap::kSrgb8;
  GlbMode glb_mode = GlbMode::kLightmap;
  bool keep_lights = false;  ///< lit.glb keeps the lights whose light the pages hold
};

struct ReportSettings {
  std::optional<std::string> against;  ///< a method, or the name of a side file; null: no report
  std::uint32_t samples = 256;         ///< of the method, per texel
  float error_scale = 10;              ///< factor on the error in the error maps

  /// Returns the method that `against` names, if it names one.
  std::optional<Method> method() const { return against ? method_named(*against) : std::nullopt; }
};

struct BakeSettings {
  AtlasSettings atlas;
  QualitySettings quality;
  SolverSettings solver;
  SkySettings sky;
  std::vector<LightSettings> lights;
  bool allow_dark = false;  ///< bake a scene without any light instead of the error `no_light`
  PostSettings post;
  OutputSettings output;
  ReportSettings report;
};

}  // namespace kiln::proto
