#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
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

enum class Method { kGather, kPath, kPairwise, kMatrix };

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
};
constexpr const char* to_string(Method m) {
  return kMethodNames[static_cast<std::size_t>(m)].name;
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
};

/// Selects the rays that are traced together, sixteen at a time (gather).
enum class RayPattern { kAuto, kTile, kBlock, kStrata, kIncoherent };

/// Techniques that lower the error at equal time. Each can be left out to see by how much (gather).
enum class Technique { kLowDiscrepancy, kClosedForm, kLightImportance, kShadowProbes };

struct SolverSettings {
  Method method = Method::kGather;
  std::uint32_t bounces = 16;  ///< diffuse bounces after direct light
  /// Indirect directions (gather), paths (path) or directions to the sky (pairwise, matrix) per
  /// texel; null: as many as the quality asks for (gather), 256.
  std::optional<std::uint32_t> samples;
  /// Shadow rays per texel towards area lights (all but path); null: as many as the quality asks
  /// for.
  std::optional<std::uint32_t> direct_samples;
  std::uint32_t hit_memory_mib = 1024;  ///< memory for remembered hits (gather)
  bool coarse_indirect = true;  ///< gather every second texel and interpolate between them (gather)
  RayPattern ray_pattern = RayPattern::kAuto;
  float tolerance = 0.001f;  ///< stop when a bounce changes E by less than this share
  std::uint64_t seed = 1;    ///< below 2^53, so that JSON keeps it
  std::vector<Technique> without{};
  std::uint32_t pair_samples = 1;  ///< pairs of points for a view factor (pairwise, matrix)
  float reflectivity_factor = 1;   ///< factor on every albedo (pairwise, matrix)
  float distance_factor = 1;       ///< factor on distances in view factors (pairwise, matrix)
  /// Texels of a chart that lie less than so many texels apart in x and in y exchange no light
  /// (pairwise, matrix); null: page_size / 128, at least 1, which is a texel itself.
  std::optional<std::uint32_t> window;
  bool allow_expensive = false;  ///< bake what is refused as `too_expensive` (pairwise, matrix)

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

struct OutputSettings {
  Precision precision = Precision::kHalf;
  std::vector<std::string> layers{"irradiance"};  ///< see the settings' table
  std::vector<std::string> formats{"exr", "png", "glb"};
  std::optional<float> exposure;  ///< scale of the preview; null: automatic by percentile
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
};

}  // namespace kiln::proto
