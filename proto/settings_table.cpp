#include <algorithm>
#include <nlohmann/json.hpp>
#include <type_traits>

#include "proto/json_values.h"
#include "proto/settings_schema.h"

namespace kiln::proto {
namespace {

using nlohmann::json;
using enum ValueKind;

// Conversion of a member's value to JSON and back
// ---------------------------------------------------------------

template <class Enum>
json word_of(Enum v, const SettingSpec& spec) {
  return std::string(spec.choices.at(static_cast<std::size_t>(v)));
}

template <class Enum>
Enum meaning_of(const json& word, const SettingSpec& spec) {
  const auto found =
      std::find(spec.choices.begin(), spec.choices.end(), word.get_ref<const std::string&>());
  return static_cast<Enum>(found - spec.choices.begin());
}

template <class T>
json to_value(const T& v, const SettingSpec& spec) {
  if constexpr (std::is_enum_v<T>) {
    return word_of(v, spec);
  } else if constexpr (std::is_same_v<T, std::vector<Technique>>) {
    json words = json::array();
    for (const Technique t : v) words.push_back(word_of(t, spec));
    return words;
  } else if constexpr (std::is_same_v<T, float>) {
    return shortest_number(v);
  } else if constexpr (std::is_same_v<T, std::optional<float>>) {
    return v ? json(shortest_number(*v)) : json(nullptr);
  } else if constexpr (std::is_same_v<T, std::optional<std::uint32_t>>) {
    return v ? json(*v) : json(nullptr);
  } else if constexpr (std::is_same_v<T, std::optional<std::string>>) {
    return v ? json(*v) : json(nullptr);
  } else if constexpr (std::is_same_v<T, std::array<float, 3>>) {
    return json{shortest_number(v[0]), shortest_number(v[1]), shortest_number(v[2])};
  } else {
    return v;
  }
}

template <class T>
void from_value(T& out, const json& v, const SettingSpec& spec) {
  if constexpr (std::is_enum_v<T>) {
    out = meaning_of<T>(v, spec);
  } else if constexpr (std::is_same_v<T, std::vector<Technique>>) {
    out.clear();
    for (const json& word : v) out.push_back(meaning_of<Technique>(word, spec));
  } else if constexpr (std::is_same_v<T, std::optional<float>>) {
    out = v.is_null() ? std::nullopt : std::optional<float>(v.get<float>());
  } else if constexpr (std::is_same_v<T, std::optional<std::uint32_t>>) {
    out = v.is_null() ? std::nullopt : std::optional<std::uint32_t>(v.get<std::uint32_t>());
  } else if constexpr (std::is_same_v<T, std::optional<std::string>>) {
    out = v.is_null() ? std::nullopt : std::optional<std::string>(v.get<std::string>());
  } else {
    v.get_to(out);
  }
}

/// Makes a row from its specification and a function that names the member.
template <class Owner, auto Member>
SettingRow<Owner> bind(SettingSpec spec) {
  return {std::move(spec),
          [](const Owner& o, const SettingSpec& s) { return to_value(Member(o), s); },
          [](Owner& o, const json& v, const SettingSpec& s) { from_value(Member(o), v, s); }};
}

template <auto Member>
SettingRow<BakeSettings> row(SettingSpec spec) {
  return bind<BakeSettings, Member>(std::move(spec));
}

template <auto Member>
SettingRow<LightSettings> light_row(SettingSpec spec) {
  return bind<LightSettings, Member>(std::move(spec));
}

/// The words of a table, and what those mean that have a description, in one text.
template <std::size_t kCount>
std::vector<std::string_view> names_of(const std::array<Word, kCount>& words) {
  std::vector<std::string_view> names;
  for (const Word& w : words) names.emplace_back(w.name);
  return names;
}
template <std::size_t kCount>
std::string meanings_of(const std::array<Word, kCount>& words) {
  std::string text;
  for (const Word& w : words)
    if (*w.description)
      text.append(text.empty() ? "" : " ").append(w.name).append(": ").append(w.description);
  return text;
}

constexpr std::uint32_t bit(LightType t) {
  return 1u << static_cast<std::uint32_t>(t);
}
using enum Method;
constexpr std::uint32_t bit(Method m) {
  return 1u << static_cast<std::uint32_t>(m);
}
constexpr std::uint32_t bits(std::initializer_list<Method> methods) {
  std::uint32_t all = 0;
  for (const Method m : methods) all |= bit(m);
  return all;
}
constexpr std::uint32_t kPairs = bits({kPairwise, kMatrix, kLinks}), kAllButPath = ~bit(kPath);
constexpr std::uint32_t kPunctual = bit(LightType::kPoint) | bit(LightType::kSpot);
constexpr std::uint32_t kPlaced = kPunctual | bit(LightType::kRect);
constexpr std::uint32_t kAimed =
    bit(LightType::kDirectional) | bit(LightType::kSpot) | bit(LightType::kRect);

}  // namespace

const std::vector<SettingGroup>& setting_groups() {
  static const std::vector<SettingGroup> groups{
      {"atlas", "Layout of the surfaces on the lightmap's pages"},
      {"quality", "Accuracy of the light"},
      {"solver", "Computation of the light"},
      {"sky", "Light from outside the scene"},
      {"post", "Changes to a finished page"},
      {"output", "Files to write"},
      {"report", "Comparison of the result with a reference"},
  };
  return groups;
}

// clang-format off
const std::vector<SettingRow<BakeSettings>>& setting_rows() {
  static const std::string methods = meanings_of(kMethodNames);
  static const std::string layers =
      "Layers of the EXR pages; the first is the unnamed R, G, B, A. " + meanings_of(kLayerNames);
  static const std::vector<SettingRow<BakeSettings>> rows{
      row<[](auto& s) -> auto& { return s.atlas.page_size; }>(
          {.path = "atlas.page_size", .kind = kInteger, .min = 16,
           .max = AtlasSettings::kMostPageSize, .unit = "texels",
           .description = "Length of a page's side."}),
      row<[](auto& s) -> auto& { return s.atlas.max_pages; }>(
          {.path = "atlas.max_pages", .kind = kInteger, .min = 1,
           .max = AtlasSettings::kMostPages, .unit = "pages",
           .description = "A scene that needs more pages is the error atlas_full."}),
      row<[](auto& s) -> auto& { return s.atlas.texels_per_metre; }>(
          {.path = "atlas.texels_per_metre", .kind = kNumber, .min = 1e-6, .max = 1e5,
           .nullable = true, .unit = "texels/m",
           .description = "Texel density on surfaces. null: the density that fills one page."}),
      row<[](auto& s) -> auto& { return s.atlas.unwrap; }>(
          {.path = "atlas.unwrap", .kind = kChoice, .choices = {"auto", "existing", "always"},
           .description = "auto: TEXCOORD_1 where it is valid for a lightmap, otherwise an unwrap. "
                          "existing: TEXCOORD_1, or the error invalid_lightmap_uv. "
                          "always: unwrap, whatever TEXCOORD_1 holds."}),
      row<[](auto& s) -> auto& { return s.atlas.gutter; }>(
          {.path = "atlas.gutter", .kind = kInteger, .min = 0, .max = 64, .unit = "texels",
           .description = "Empty texels around each chart that is placed by the baker. "
                          "Twice the gutter must be less than page_size."}),
      row<[](auto& s) -> auto& { return s.quality.preset; }>(
          {.path = "quality.preset", .kind = kChoice,
           .choices = {"draft", "preview", "production", "reference"},
           .description = "A target_error by name: draft 0.1, preview 0.05, production 0.018, "
                          "reference 0.005."}),
      row<[](auto& s) -> auto& { return s.quality.target_error; }>(
          {.path = "quality.target_error", .kind = kNumber, .min = 0.0005, .max = 1,
           .nullable = true,
           .description = "Relative standard error that the light must not exceed, by "
                          "quality.measure. Samples are doubled where it is too high. null: the "
                          "preset's."}),
      row<[](auto& s) -> auto& { return s.quality.measure; }>(
          {.path = "quality.measure", .kind = kChoice, .choices = {"percentile_95", "rms"},
           .description = "The figure that target_error limits. percentile_95: the standard error of "
                          "a texel's luminance, relative to the luminance plus 2 % of the scene's "
                          "mean; 95 of 100 texels must not exceed the target. rms: the root mean "
                          "square over all texels, over their mean luminance (normalized RMSE); "
                          "samples go where they lower it most for their time, so dark texels may "
                          "stay noisier."}),
      row<[](auto& s) -> auto& { return s.quality.max_samples; }>(
          {.path = "quality.max_samples", .kind = kInteger, .min = 1, .max = 65536,
           .unit = "samples/texel",
           .description = "The most directions, and the most shadow rays, that target_error may ask for."}),
      row<[](auto& s) -> auto& { return s.solver.method; }>(
          {.path = "solver.method", .kind = kChoice, .choices = names_of(kMethodNames),
           .description = methods}),
      row<[](auto& s) -> auto& { return s.solver.bounces; }>(
          {.path = "solver.bounces", .kind = kInteger, .min = 0, .max = 64, .unit = "bounces",
           .description = "Limit on diffuse bounces after direct light. matrix has all of them at once, "
                          "unless it is 0."}),
      row<[](auto& s) -> auto& { return s.solver.samples; }>(
          {.path = "solver.samples", .kind = kInteger, .min = 1, .max = 65536,
           .nullable = true, .unit = "samples/texel",
           .description = "Indirect directions (gather, directional), paths (path), directions to "
                          "the sky (pairwise, matrix) or iterations (radiosity_map; of each bounce "
                          "in its unbiased series) of every texel. null: as many as "
                          "target_error asks for (gather), 800 (radiosity_map), 256 (the "
                          "others). directional takes at most 4096; a hemicube has about as many "
                          "cells."}),
      row<[](auto& s) -> auto& { return s.solver.direct_samples; }>(
          {.path = "solver.direct_samples", .kind = kInteger, .min = 1, .max = 4096,
           .nullable = true, .unit = "samples/texel",
           .description = "Shadow rays of every texel towards area lights, at most (all but "
                          "path): where the first quarter agrees over 16 texels, no more "
                          "follow. radiosity_map sends them all. null: as many as "
                          "target_error asks for (gather), 200 (radiosity_map), as many as "
                          "target_error begins with (pairwise, matrix).",
           .methods = kAllButPath}),
      row<[](auto& s) -> auto& { return s.solver.hit_memory_mib; }>(
          {.path = "solver.hit_memory_mib", .kind = kInteger, .min = 1, .max = 65536, .unit = "MiB",
           .description = "Memory for the hits that directions remember, 4 bytes each, so that bounces "
                          "need no rays (gather). Where it can't hold the hits of all samples, fewer "
                          "samples feed the bounces, and the rest are traced once at the end. "
                          "radiosity_map remembers the first 64 at most.",
           .methods = bits({kGather, kRadiosityMap}),
           .reaches_reference = true}),
      row<[](auto& s) -> auto& { return s.solver.coarse_indirect; }>(
          {.path = "solver.coarse_indirect", .kind = kBoolean,
           .description = "Gather indirect light at every second texel of a row and of a column, and "
                          "interpolate where those around a texel agree within 6 %; the other texels "
                          "are gathered too (gather). It has no effect where target_error is below "
                          "0.008 and samples is null, since interpolation would be visible, and "
                          "with emitters \"transport\".",
           .methods = bit(kGather)}),
      row<[](auto& s) -> auto& { return s.solver.ray_pattern; }>(
          {.path = "solver.ray_pattern", .kind = kChoice,
           .choices = {"auto", "tile", "block", "strata", "incoherent"},
           .description = "Rays that are traced together, sixteen at a time (gather). tile: one "
                          "direction from up to 16 texels near to each other. block: four directions "
                          "near to each other from four texels. strata: 16 directions near to each "
                          "other from one texel. incoherent: 16 directions all over the hemisphere of "
                          "one texel. auto: the fastest for the scene; the manifest names it.",
           .methods = bits({kGather, kRadiosityMap})}),
      row<[](auto& s) -> auto& { return s.solver.tolerance; }>(
          {.path = "solver.tolerance", .kind = kNumber, .min = 0, .max = 1,
           .description = "Bouncing stops when a bounce changes the irradiance by less than this "
                          "share. 0: only at the limit on bounces.",
           .methods = ~bits({kPath, kMatrix}),
           .reaches_reference = true}),
      row<[](auto& s) -> auto& { return s.solver.seed; }>(
          {.path = "solver.seed", .kind = kInteger, .min = 0, .max = 9007199254740991.0,
           .description = "Start of the random numbers. Same scene, settings and seed give the same "
                          "pixels."}),
      row<[](auto& s) -> auto& { return s.solver.without; }>(
          {.path = "solver.without", .kind = kChoices,
           .choices = {"low_discrepancy", "closed_form", "light_importance", "shadow_probes"},
           .description = "Techniques to leave out, to see what each is worth (gather, and the direct "
                          "light of pairwise and matrix; path has none of them). The light stays the same except for noise, and for the little that "
                          "shadow_probes miss. low_discrepancy: random points instead of a "
                          "scrambled Sobol sequence. closed_form: few plain lamps are sampled as "
                          "textured ones are. light_importance: one of many lights is drawn by its "
                          "power alone. shadow_probes: all shadow rays are sent, even where the "
                          "first agree.",
           .methods = kAllButPath}),
      row<[](auto& s) -> auto& { return s.solver.pair_samples; }>(
          {.path = "solver.pair_samples", .kind = kInteger, .min = 1, .max = 256,
           .unit = "samples/pair",
           .description = "Pairs of points between which the view factor of two texels is taken. "
                          "1: the middles of the texels. More: random pairs of "
                          "their sixteen points each.",
           .methods = kPairs,
           .layers = {"tree", "senders"}}),
      row<[](auto& s) -> auto& { return s.solver.near_field; }>(
          {.path = "solver.near_field", .kind = kBoolean,
           .description = "Take the view factor of two texels that are nearer to each other than four "
                          "of their widths as the mean over all 256 pairs of their points. "
                          "false: by the formula for pairs of points alone, as in "
                          "RTRad, which brightens corners.",
           .methods = kPairs}),
      row<[](auto& s) -> auto& { return s.solver.reflectivity_factor; }>(
          {.path = "solver.reflectivity_factor", .kind = kNumber, .min = 0, .max = 1,
           .description = "Factor on every albedo. 1: the scene's own.",
           .methods = kPairs,
           .layers = {"mip", "tree", "senders"},
           .reaches_reference = true}),
      row<[](auto& s) -> auto& { return s.solver.distance_factor; }>(
          {.path = "solver.distance_factor", .kind = kNumber, .min = 0.01, .max = 100,
           .description = "Factor on the distance of two texels in their view factor. "
                          "1: physics.",
           .methods = kPairs,
           .reaches_reference = true}),
      row<[](auto& s) -> auto& { return s.solver.window; }>(
          {.path = "solver.window", .kind = kInteger, .min = 1, .max = 256, .nullable = true,
           .unit = "texels",
           .description = "Texels of one chart that lie less than this apart, in x and in y, exchange no "
                          "light. 1: all exchange light. null: page_size / 128, at "
                          "least 1, or 2 where undersampling takes a sender for each window.",
           .methods = kPairs,
           .layers = {"mip", "senders"}}),
      row<[](auto& s) -> auto& { return s.solver.undersampling; }>(
          {.path = "solver.undersampling", .kind = kChoice,
           .choices = {"none", "stride", "monte_carlo", "mipmap"},
           .description = "Which texels send light to all others (pairwise). none: every texel. The "
                          "others take one sender for each window of window x window texels of a page, "
                          "with the area of all of them. stride: the first texel of the window. "
                          "monte_carlo: a random one, drawn by area, anew in every pass. mipmap: the "
                          "mean of the window's texels, one for each chart in it.",
           .methods = bit(kPairwise),
           .layers = {"senders"}}),
      row<[](auto& s) -> auto& { return s.solver.sender_seed; }>(
          {.path = "solver.sender_seed", .kind = kChoice, .choices = {"window", "receiver"},
           .description = "What the random sender hangs on (monte_carlo). window: on the window and the "
                          "pass, the same for all receivers, so that the error is a pattern. receiver: "
                          "on the receiver, too, so that the error is noise.",
           .methods = bit(kPairwise),
           .layers = {"senders"}}),
      row<[](auto& s) -> auto& { return s.solver.iteration; }>(
          {.path = "solver.iteration", .kind = kChoice,
           .choices = {"jacobi", "gauss_seidel", "shooting"},
           .description = "Order of the bounces (pairwise). jacobi: a pass is a bounce of the light "
                          "before it. gauss_seidel: the tiles of a pass follow each other and read "
                          "what those before them have just got. shooting: the texels with the most "
                          "unshot light send it first, a block of them a pass.",
           .methods = bit(kPairwise)}),
      row<[](auto& s) -> auto& { return s.solver.batch_texels; }>(
          {.path = "solver.batch_texels", .kind = kInteger, .min = 1, .max = 65536,
           .nullable = true, .unit = "texels",
           .description = "Texels of a batch, for measurements. null: as many as take some "
                          "tens of milliseconds.",
           .methods = bits({kPairwise, kLinks})}),
      row<[](auto& s) -> auto& { return s.solver.max_contribution; }>(
          {.path = "solver.max_contribution", .kind = kNumber, .min = 1e-6, .max = 1,
           .nullable = true,
           .description = "Clamp of the light that one sender gives a texel in a pass, as a share of the "
                          "brightest sender's radiosity (pairwise). RTRad takes 0.05. The energy that it takes "
                          "is told. null: no clamp.",
           .methods = bit(kPairwise)}),
      row<[](auto& s) -> auto& { return s.solver.max_view_factor; }>(
          {.path = "solver.max_view_factor", .kind = kNumber, .min = 1e-6, .max = 1,
           .nullable = true,
           .description = "Clamp of a view factor (pairwise). The energy that it takes is told. null: "
                          "no clamp.",
           .methods = bit(kPairwise)}),
      row<[](auto& s) -> auto& { return s.solver.subdivision_threshold; }>(
          {.path = "solver.subdivision_threshold", .kind = kNumber, .min = 0, .max = 10,
           .nullable = true,
           .description = "Senders are the leaves of a quadtree over each chart: four siblings become "
                          "one where the gradient of radiosity and normals over the node stays below "
                          "this (pairwise). RTRad takes 0.05. null: no quadtree.",
           .methods = bit(kPairwise),
           .layers = {"tree", "senders"}}),
      row<[](auto& s) -> auto& { return s.solver.subdivision_ramp; }>(
          {.path = "solver.subdivision_ramp", .kind = kNumber, .min = 0, .max = 1,
           .description = "Grows subdivision_threshold by this after every pass.",
           .methods = bit(kPairwise)}),
      row<[](auto& s) -> auto& { return s.solver.subdivision_max_node; }>(
          {.path = "solver.subdivision_max_node", .kind = kInteger, .min = 4, .max = 64,
           .unit = "texels",
           .description = "Longest side of a leaf of the quadtree; a power of two.",
           .methods = bit(kPairwise),
           .layers = {"tree", "senders"}}),
      row<[](auto& s) -> auto& { return s.solver.visibility; }>(
          {.path = "solver.visibility", .kind = kChoice, .choices = {"auto", "ray", "cached", "voxel"},
           .description = "How it is found what stands between two texels. "
                          "auto: cached where solver.visibility_cache_mib holds all pairs of texels, "
                          "otherwise ray (pairwise); ray (matrix, links). ray: a ray from either end, "
                          "in every pass. cached: a ray for each pair, once, remembered as one bit "
                          "(pairwise). voxel: a march through a grid of voxels, coarse and "
                          "approximate.",
           .methods = kPairs}),
      row<[](auto& s) -> auto& { return s.solver.visibility_cache_mib; }>(
          {.path = "solver.visibility_cache_mib", .kind = kInteger, .min = 1, .max = 65536,
           .unit = "MiB",
           .description = "Memory for remembered visibility. Where it can't hold all pairs, auto "
                          "remembers none; with cached, the others are traced in every pass, and a "
                          "warning says how many it covers.",
           .methods = bit(kPairwise)}),
      row<[](auto& s) -> auto& { return s.solver.voxel_grid; }>(
          {.path = "solver.voxel_grid", .kind = kInteger, .min = 8, .max = 512, .unit = "voxels",
           .description = "Voxels along the longest side of the scene (voxel).",
           .methods = kPairs,
           .layers = {"voxels"}}),
      row<[](auto& s) -> auto& { return s.solver.voxel_march; }>(
          {.path = "solver.voxel_march", .kind = kChoice, .choices = {"fixed_steps", "exact"},
           .description = "fixed_steps: samples at even steps of a grid that is filled from each "
                          "triangle's main axis, as in RTRad; thin walls leak. exact: every voxel on "
                          "the way of a grid with every voxel that a triangle touches (voxel).",
           .methods = kPairs,
           .layers = {"voxels"}}),
      row<[](auto& s) -> auto& { return s.solver.voxel_ratio; }>(
          {.path = "solver.voxel_ratio", .kind = kNumber, .min = 0, .max = 1,
           .description = "Share of the segments that march through voxels; the others are traced by "
                          "rays (voxel).",
           .methods = kPairs}),
      row<[](auto& s) -> auto& { return s.solver.direction_set; }>(
          {.path = "solver.direction_set", .kind = kChoice,
           .choices = {"largest_empty_circle", "hemicube"},
           .description = "Directions of every texel (directional). largest_empty_circle: a "
                          "progressive set on the disc, lifted to the hemisphere. hemicube: the cells "
                          "of a hemicube, weighted by their form factors.",
           .methods = bit(kDirectional)}),
      row<[](auto& s) -> auto& { return s.solver.rotate_directions; }>(
          {.path = "solver.rotate_directions", .kind = kBoolean,
           .description = "Turn the directions about the normal by an angle of each texel's own, so "
                          "that the error is noise and no pattern (directional).",
           .methods = bit(kDirectional)}),
      row<[](auto& s) -> auto& { return s.solver.mip_radiosity; }>(
          {.path = "solver.mip_radiosity", .kind = kBoolean,
           .description = "A direction reads the mean light of as much of a chart as its share of the "
                          "hemisphere covers where it arrives, and not that of one texel "
                          "(directional).",
           .methods = bit(kDirectional)}),
      row<[](auto& s) -> auto& { return s.solver.rtrad_compat; }>(
          {.path = "solver.rtrad_compat", .kind = kBoolean,
           .description = "Weight directions as RTRad's text does, by a second cosine and by 1/r2, and "
                          "drop hits nearer than 0.1 of half the scene's side: wrong light, to show "
                          "the difference (directional).",
           .methods = bit(kDirectional)}),
      row<[](auto& s) -> auto& { return s.solver.series; }>(
          {.path = "solver.series", .kind = kChoice, .choices = {"averaged", "unbiased"},
           .description = "How samples become bounces (radiosity_map). averaged: each reads "
                          "the mean of all before it, so that all bounces grow at once, but "
                          "high ones are short of light; a warning tells by how much. "
                          "solver.bounces sets no limit but 0. unbiased: a bounce takes all "
                          "its samples before the next one begins, until tolerance or "
                          "bounces.",
           .methods = bit(kRadiosityMap)}),
      row<[](auto& s) -> auto& { return s.solver.initial_samples; }>(
          {.path = "solver.initial_samples", .kind = kInteger, .min = 1, .max = 4096,
           .unit = "samples/texel",
           .description = "Samples of direct light before the first bounce, and so before "
                          "the first picture (radiosity_map).",
           .methods = bit(kRadiosityMap)}),
      row<[](auto& s) -> auto& { return s.solver.same_directions; }>(
          {.path = "solver.same_directions", .kind = kBoolean,
           .description = "All texels take the same random numbers, so that the error is a "
                          "pattern and no noise."}),
      row<[](auto& s) -> auto& { return s.solver.light_sampling; }>(
          {.path = "solver.light_sampling", .kind = kChoice,
           .choices = {"uniform", "stratified", "solid_angle"},
           .description = "Points on area lights (radiosity_map). uniform: random ones of "
                          "their area, with fireflies close to a lamp. stratified: the same "
                          "from a low-discrepancy sequence. solid_angle: random directions "
                          "to lights that are near against their size.",
           .methods = bit(kRadiosityMap)}),
      row<[](auto& s) -> auto& { return s.solver.ambient_term; }>(
          {.path = "solver.ambient_term", .kind = kBoolean,
           .description = "Previews of a bake that runs add the mean light that is still "
                          "missing, as in a closed room (radiosity_map). The result has none "
                          "of it.",
           .methods = bit(kRadiosityMap)}),
      row<[](auto& s) -> auto& { return s.solver.emitters; }>(
          {.path = "solver.emitters", .kind = kChoice, .choices = {"explicit", "transport"},
           .description = "explicit: shadow rays find the light of emitting surfaces. transport: "
                          "emitting texels send light as any texel does, as in RTRad, and it "
                          "counts as indirect light; path counts what its rays meet. Small lamps "
                          "are noise then, since directions find them by chance."}),
      row<[](auto& s) -> auto& { return s.solver.link_error; }>(
          {.path = "solver.link_error", .kind = kNumber, .min = 1e-6, .max = 1,
           .description = "Light that one link between groups of texels may be off by, as a share of "
                          "the mean radiosity of direct light (links). More is coarser and faster.",
           .methods = bit(kLinks)}),
      row<[](auto& s) -> auto& { return s.solver.allow_expensive; }>(
          {.path = "solver.allow_expensive", .kind = kBoolean,
           .description = "Bake what is refused as too_expensive otherwise: more than 1e12 rays "
                          "(pairwise), or more than 8192 texels (matrix).",
           .methods = bits({kPairwise, kMatrix}),
           .reaches_reference = true}),
      row<[](auto& s) -> auto& { return s.sky.radiance; }>(
          {.path = "sky.radiance", .kind = kVector, .min = 0, .max = 1e9, .unit = "cd/m2",
           .description = "Radiance of the sky in linear Rec. 709, the same in every direction."}),
      row<[](auto& s) -> auto& { return s.sky.map; }>(
          {.path = "sky.map", .kind = kText, .max = 1024, .nullable = true,
           .description = "Name of a side file of the scene, OpenEXR, Radiance HDR or TIFF: the sky by "
                          "direction, which adds to radiance. Equirectangular, twice as wide as high: "
                          "the top row is +Y; the center is seen along +X, the middle of the right "
                          "half along +Z. The radiance is constant over a pixel. null: no map."}),
      row<[](auto& s) -> auto& { return s.sky.scale; }>(
          {.path = "sky.scale", .kind = kNumber, .min = 0, .max = 1e9, .unit = "cd/m2",
           .description = "Radiance where the map's value is 1."}),
      row<[](auto& s) -> auto& { return s.sky.rotation; }>(
          {.path = "sky.rotation", .kind = kNumber, .min = -360, .max = 360, .unit = "degrees",
           .description = "Turns the map about +Y, counter-clockwise seen from above: at 90 its center "
                          "is seen along -Z."}),
      row<[](auto& s) -> auto& { return s.allow_dark; }>(
          {.path = "allow_dark", .kind = kBoolean,
           .description = "Bake a scene without any light instead of the error no_light."}),
      row<[](auto& s) -> auto& { return s.post.filter; }>(
          {.path = "post.filter", .kind = kBoolean,
           .description = "Smooth sky and indirect light where two halves of the samples show that it "
                          "lowers the error (gather)."}),
      row<[](auto& s) -> auto& { return s.post.dilate; }>(
          {.path = "post.dilate", .kind = kInteger, .min = 0, .max = 16384, .unit = "texels",
           .description = "Padding around charts that is filled from them. 0: the whole page."}),
      row<[](auto& s) -> auto& { return s.output.precision; }>(
          {.path = "output.precision", .kind = kChoice, .choices = {"half", "float"},
           .description = "Numbers of the EXR pages. half: 16 bit; a page with a value over 60000 is "
                          "written as float all the same, with a warning. float: 32 bit."}),
      row<[](auto& s) -> auto& { return s.output.layers; }>(
          {.path = "output.layers", .kind = kChoices, .min = 1,
           .choices = names_of(kLayerNames),
           .description = layers}),
      row<[](auto& s) -> auto& { return s.output.formats; }>(
          {.path = "output.formats", .kind = kChoices, .min = 1,
           .choices = {"exr", "png", "glb"},
           .description = "exr: the lightmap pages. png: tone-mapped previews, and a picture of every "
                          "further layer. glb: the scene with lightmaps attached."}),
      row<[](auto& s) -> auto& { return s.output.exposure; }>(
          {.path = "output.exposure", .kind = kNumber, .min = 1e-9, .max = 1e9, .nullable = true,
           .unit = "1/lx",
           .description = "Factor on irradiance before the preview's tone curve. null: the 95th "
                          "percentile of lit texels becomes bright."}),
      row<[](auto& s) -> auto& { return s.output.tone_curve; }>(
          {.path = "output.tone_curve", .kind = kNumber, .min = 1e-3, .max = 10, .nullable = true,
           .description = "k of the curve c / (k + c) that previews, pictures of layers and views then "
                          "have, where c is a value over the brightest one of the page, which becomes "
                          "1 / (1 + k); 0.02 to 0.1 shows dark rooms. Not with output.exposure. null: "
                          "the usual curve."}),
      row<[](auto& s) -> auto& { return s.output.preview_fade; }>(
          {.path = "output.preview_fade", .kind = kNumber, .min = 0.01, .max = 1,
           .description = "Share of the way from the light shown before to the light computed that "
                          "the previews of a bake which runs go after each pass: below 1 they fade "
                          "into each other. The result does not hang on it."}),
      row<[](auto& s) -> auto& { return s.output.glb_lightmap; }>(
          {.path = "output.glb_lightmap", .kind = kChoice, .choices = {"srgb8", "rgbm", "none"},
           .description = "The lightmap pages inside lit.glb. srgb8: sRGB codes of 8 bits times a "
                          "scale; at most 0.1 % of the texels are brighter and clipped, and those of "
                          "lamps, which shine by themselves. rgbm: 8 bits of color and a factor in "
                          "alpha, which hold the whole range. none: no pages, only TEXCOORD_1 and the "
                          "names of the EXR pages."}),
      row<[](auto& s) -> auto& { return s.output.glb_mode; }>(
          {.path = "output.glb_mode", .kind = kChoice, .choices = {"lightmap", "unlit"},
           .description = "How lit.glb shows the light. lightmap: beside the scene's materials, which "
                          "a loader multiplies. unlit: materials of KHR_materials_unlit whose color is "
                          "albedo times light plus emission, at the preview's exposure and usual curve, "
                          "for viewers that know no lightmap; textures have the resolution of the "
                          "lightmap then. Only with glb_lightmap srgb8."}),
      row<[](auto& s) -> auto& { return s.output.keep_lights; }>(
          {.path = "output.keep_lights", .kind = kBoolean,
           .description = "lit.glb keeps the lights of KHR_lights_punctual, whose light the pages hold: "
                          "a viewer has to switch them off, or what they light is lit twice. false: "
                          "they are left out."}),
      row<[](auto& s) -> auto& { return s.report.against; }>(
          {.path = "report.against", .kind = kText, .max = 1024, .nullable = true,
           .description = "What the result is compared with, in report.json, error maps, contours and "
                          "histograms: the name of a method, which bakes the same texels after the "
                          "bake; or the name of a side file of the scene, an OpenEXR page of "
                          "the same size. Of several pages it names page_00.exr, or what ends in "
                          "another number, and the others follow by theirs. null: no report."}),
      row<[](auto& s) -> auto& { return s.report.samples; }>(
          {.path = "report.samples", .kind = kInteger, .min = 1, .max = 65536,
           .unit = "samples/texel",
           .description = "Paths or directions, and shadow rays, of the method that report.against "
                          "names. Their seed is another one than the bake's."}),
      row<[](auto& s) -> auto& { return s.report.error_scale; }>(
          {.path = "report.error_scale", .kind = kNumber, .min = 1e-3, .max = 1e6,
           .description = "Factor on the error in the error maps: at 1, white is the reference's "
                          "largest value."}),
  };
  return rows;
}

const std::vector<SettingRow<LightSettings>>& light_rows() {
  static const std::vector<SettingRow<LightSettings>> rows{
      light_row<[](auto& l) -> auto& { return l.type; }>(
          {.path = "type", .kind = kChoice, .choices = {"directional", "point", "spot", "rect"},
           .description = "Kind of light; it decides which of the other keys are allowed."}),
      light_row<[](auto& l) -> auto& { return l.color; }>(
          {.path = "color", .kind = kVector, .min = 0, .max = 1e9,
           .description = "Linear Rec. 709 factor on intensity."}),
      light_row<[](auto& l) -> auto& { return l.intensity; }>(
          {.path = "intensity", .kind = kNumber, .min = 0, .max = 1e9,
           .unit = "directional: lx; point and spot: cd; rect: cd/m2",
           .description = "Strength of the light."}),
      light_row<[](auto& l) -> auto& { return l.position; }>(
          {.path = "position", .kind = kVector, .min = -1e6, .max = 1e6, .unit = "m",
           .description = "World position; for a rect, of its center.", .used_by = kPlaced}),
      light_row<[](auto& l) -> auto& { return l.direction; }>(
          {.path = "direction", .kind = kDirection, .min = -1e6, .max = 1e6,
           .description = "World direction in which the light goes, of any length.",
           .used_by = kAimed}),
      light_row<[](auto& l) -> auto& { return l.range; }>(
          {.path = "range", .kind = kNumber, .min = 1e-6, .max = 1e9, .nullable = true, .unit = "m",
           .description = "Distance at which the light has faded to nothing. null: no limit.",
           .used_by = kPunctual}),
      light_row<[](auto& l) -> auto& { return l.inner_cone_angle; }>(
          {.path = "inner_cone_angle", .kind = kNumber, .min = 0, .max = 1.5707964, .unit = "rad",
           .description = "Angle from the axis up to which the light is at full strength; at most "
                          "outer_cone_angle.",
           .used_by = bit(LightType::kSpot)}),
      light_row<[](auto& l) -> auto& { return l.outer_cone_angle; }>(
          {.path = "outer_cone_angle", .kind = kNumber, .min = 0, .max = 1.5707964, .unit = "rad",
           .description = "Angle from the axis at which the light has faded to nothing.",
           .used_by = bit(LightType::kSpot)}),
      light_row<[](auto& l) -> auto& { return l.width; }>(
          {.path = "width", .kind = kNumber, .min = 1e-6, .max = 1e4, .unit = "m",
           .description = "Length of the rect's horizontal side.",
           .used_by = bit(LightType::kRect)}),
      light_row<[](auto& l) -> auto& { return l.height; }>(
          {.path = "height", .kind = kNumber, .min = 1e-6, .max = 1e4, .unit = "m",
           .description = "Length of the rect's other side.", .used_by = bit(LightType::kRect)}),
  };
  return rows;
}
// clang-format on

}  // namespace kiln::proto
