#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "proto/bake_settings.h"

namespace kiln::proto {

/// One file of a bake's result.
struct ResultFile {
  std::string name;        ///< "page_00.exr"
  std::string media_type;  ///< "image/x-exr"
  std::uint64_t bytes = 0;
  std::string sha256;  ///< lower-case hex; the strong ETag
};

struct PageInfo {
  std::uint32_t width = 0, height = 0;
  std::uint32_t texels = 0;  ///< lit texels
  std::string exr, preview;  ///< names of the files; "" when they were not asked for
  float preview_exposure = 0;
  float max_lx = 0;
  /// The irradiance that the page inside lit.glb holds at most, lx; 0: it holds no lightmap page.
  float glb_scale = 0;
  /// Lit texels that are brighter and so are clipped there, and among them those of lamps, and
  /// behind lamps, where nobody sees what lights them.
  std::uint32_t glb_clipped = 0, glb_clipped_lamps = 0;
};

/// The place of one glTF node's mesh in the atlas: uv_page = uv_lightmap * scale + offset, where
/// uv_lightmap is the source's TEXCOORD_1 ("texcoord_1") or lit.glb's own ("unwrapped": scale 1,
/// offset 0).
struct NodePlacement {
  std::uint32_t node = 0, mesh = 0;
  std::string name;
  std::uint32_t page = 0;
  std::array<float, 2> scale{1, 1}, offset{0, 0};
  std::string uv_source;  ///< "texcoord_1" or "unwrapped"
  std::string reason;     ///< the reason why TEXCOORD_1 was not used; "" when it was
};

struct PassReport {
  std::string name;         ///< "direct", "bounce", "paths"
  std::uint32_t index = 0;  ///< from 0, over the whole bake
  double residual = 0;  ///< share by which the pass changed the total light; 1 for the first pass
  double mean_lx = 0;   ///< area-weighted mean E after the pass
  double seconds = 0;
  std::uint64_t rays = 0;
  /// The relative standard error, by the measure of the bake's quality settings. It is set once all
  /// bounces are done.
  std::optional<double> standard_error;
};

struct StageReport {
  std::string name;  ///< "import", "atlas", "solve", "reference", "output"
  double seconds = 0;
};

struct Statistics {
  std::uint64_t triangles = 0, instances = 0, emissive_triangles = 0, punctual_lights = 0;
  std::uint64_t texels = 0, charts = 0, rays = 0;
  std::uint64_t albedo_capped_texels = 0;  ///< texels whose albedo was over 0.98
  std::uint64_t invalid_texels = 0;        ///< texels most of whose rays met back faces
  double texels_per_metre = 0;
  std::optional<double> standard_error;  ///< see PassReport
  std::string ray_pattern;  ///< the ray pattern that was used; "" when no rays were gathered
  double tail_scale = 1;    ///< factor on the last update, in place of bounces not computed
  std::uint64_t memory_estimate_bytes = 0;  ///< the estimate from before the atlas was made
  std::uint64_t peak_memory_bytes = 0;      ///< the process's peak at the end of the bake
  std::vector<StageReport> stages;
  std::vector<PassReport> passes;
};

/// Something in the input that the bake ignored or changed.
struct Warning {
  std::string code;     ///< stable: "alpha_ignored", "extension_ignored", ...
  std::string pointer;  ///< points into the glTF or the settings; "" when there is no place
  std::string message;
};

/// The content of manifest.json: everything that a tool needs to use the result and to repeat it.
struct Manifest {
  std::string version;       ///< version of lightkiln
  std::string scene_sha256;  ///< digest of the main scene file
  std::string instruction_set;
  BakeSettings settings;  ///< with every default filled in
  std::vector<PageInfo> pages;
  std::vector<NodePlacement> nodes;
  std::vector<ResultFile> files;
  Statistics statistics;
  std::vector<Warning> warnings;
};

}  // namespace kiln::proto
