#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <span>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "baker/atlas/atlas.h"
#include "baker/atlas/texture_group.h"
#include "baker/denoise/filter_bank.h"
#include "baker/exec/thread_pool.h"
#include "baker/files/upload.h"
#include "baker/image/page_image.h"
#include "baker/lightmap/lightmap.h"
#include "baker/output/post.h"
#include "baker/output/report.h"
#include "baker/scene/scene.h"
#include "proto/bake_settings.h"
#include "proto/expected.h"
#include "proto/manifest.h"

namespace kiln::output {

/// A page as lit.glb embeds it.
struct LitPage {
  std::string png;     ///< 8-bit image, see lit_page.h; "" for GlbLightmap::kNone
  float scale = 1;     ///< lx: what the brightest code means
  std::string exr;     ///< the name of the page's EXR beside lit.glb; "" when none is written
  float exposure = 1;  ///< 1/lx: of the preview; of unlit colors that of all pages
  std::uint32_t clipped = 0, clipped_lamps = 0;  ///< see proto::PageInfo
};
/// The light of a bake as lit.glb shows it.
struct LitPages {
  std::vector<LitPage> pages;
  proto::GlbLightmap lightmap = proto::GlbLightmap::kSrgb8;
  proto::GlbMode mode = proto::GlbMode::kLightmap;
  bool keep_lights = false;  ///< see proto::OutputSettings
};
/// Writes lit.glb to a path. Errors: those of write_lit_glb(), and `canceled`.
using LitWriter = std::function<proto::Expected<void>(const std::filesystem::path&, const LitPages&,
                                                      std::stop_token)>;

/// The parts of a finished bake that go into its files.
struct OutputInput {
  LitWriter write_lit;
  const scene::Scene& scene;
  const atlas::Atlas& atlas;
  const atlas::TextureGroup& texels;
  const lightmap::Lightmap& light;
  const denoise::FilteredLight& filtered;
  Reference reference = {};  ///< of the report; without a page there is no report
  /// By name, the values of those layers of the settings that have none of their own, see
  /// Layer::value. They are called from many threads.
  std::map<std::string, TexelValue> made = {};
};
/// Writes all files that the settings ask for into `dir`. Each is written as a temporary that is
/// flushed, then renamed when it is whole; the files of a page are written at the same time. Fills
/// pages, nodes, files and warnings of `manifest`, whose other members must be set before.
/// manifest.json comes last and lists all files but itself; `manifest` lists it too. With PNG each
/// layer but the irradiance has a picture page_NN.LAYER.png (picture.h). A page with a value over
/// 60,000 is written as float, with the warning `half_overflow`. Errors: `internal` (a value
/// that is not finite, with its texel), `io_error`, `canceled`.
proto::Expected<void> write_outputs(const std::filesystem::path& dir, const OutputInput&,
                                    const proto::BakeSettings&, proto::Manifest& manifest,
                                    exec::ThreadPool&, std::stop_token);

}  // namespace kiln::output
