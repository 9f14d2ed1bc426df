#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "baker/atlas/atlas.h"
#include "baker/atlas/texture_group.h"
#include "baker/post/post.h"
#include "baker/scene/import.h"
#include "baker/scene/scene.h"
#include "baker/solver/lightmap.h"
#include "proto/bake_settings.h"
#include "proto/expected.h"
#include "proto/manifest.h"

namespace kiln::baker {

/// Named image layers of one page; the first is written as R,G,B,A, others as name.R, name.G, ...
struct ExrLayer {
  std::string name;
  const PageImage* image = nullptr;
};

/// Writes a tiled, ZIP-compressed OpenEXR file with `metadata` as string attributes. Alpha is the
/// coverage of lit texels. Half precision needs every value <= 65504 (checked: `internal`).
/// The bytes depend on the arguments only: no dates, no host names.
proto::Expected<void> write_exr(const std::filesystem::path&, std::span<const ExrLayer>,
                                proto::Precision,
                                std::span<const std::pair<std::string, std::string>> metadata);
/// Reads R,G,B (and A as coverage, 1 when absent) of any OpenEXR file. Errors: `invalid_image`.
proto::Expected<PageImage> read_exr(const std::filesystem::path&);

/// PNG bytes of an 8-bit RGB image.
proto::Expected<std::string> encode_png(
    std::span<const std::array<std::uint8_t, 3>>, std::uint32_t width, std::uint32_t height);

/// lit.glb: the source document, everything kept, with a TEXCOORD_1 per instance and the pages'
/// lightmaps referenced by MX_lightmap (nodes) and MOZ_lightmap (materials).
/// `page_png`: per page, an LDR image to embed, encoded so that value * `page_scale` = E in lx.
struct LitPage {
  std::string png;
  float scale = 1;
};
proto::Expected<void> write_lit_glb(const std::filesystem::path&, const SceneFiles&, const Scene&,
                                    const Atlas&, std::span<const LitPage>);

/// Everything of a finished bake that the files hold.
struct OutputInput {
  const SceneFiles& files;
  const Scene& scene;
  const Atlas& atlas;
  const TextureGroup& texels;
  const Lightmap& light;
};
/// Writes all the files that settings ask for into `dir`, each as a temporary that is renamed when
/// whole, and fills pages, nodes, files and warnings of `manifest`; manifest.json comes last.
proto::Expected<void> write_outputs(const std::filesystem::path& dir, const OutputInput&,
                                    const proto::BakeSettings&, proto::Manifest& manifest,
                                    std::stop_token);

}  // namespace kiln::baker
