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
#include "baker/exec/thread_pool.h"
#include "baker/post/post.h"
#include "baker/scene/import.h"
#include "baker/scene/scene.h"
#include "baker/solver/filter/filter_bank.h"
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

/// Writes a tiled, ZIP-compressed OpenEXR file with `metadata` as string attributes. Alpha is 1 on
/// lit texels and 0 in padding. Every value must be finite and, in half precision, <= 65504
/// (checked: `internal`, names the texel). The bytes depend on the arguments only: no dates, no
/// host names. Errors: `io_error`, `canceled`.
proto::Expected<void> write_exr(const std::filesystem::path&, std::span<const ExrLayer>,
                                proto::Precision,
                                std::span<const std::pair<std::string, std::string>> metadata,
                                const std::stop_token& = {});
/// Reads R,G,B of the first part of any flat OpenEXR file up to 2^27 pixels. Coverage is the alpha
/// where that is over one half, else 0 (other bakers write partial coverage as alpha); 1 without
/// alpha. The header is checked before memory is taken. Errors: `invalid_image`.
proto::Expected<PageImage> read_exr(const std::filesystem::path&);

/// PNG bytes of an 8-bit RGB image.
proto::Expected<std::string> encode_png(std::span<const std::array<std::uint8_t, 3>>,
                                        std::uint32_t width, std::uint32_t height);

/// A page as lit.glb embeds it.
struct LitPage {
  std::string png;  ///< opaque LDR image of linear values: value (0..1) * scale = E in lx
  float scale = 1;
  std::string exr;     ///< name of the page's EXR beside lit.glb, "" when none is written
  float exposure = 1;  ///< of the preview
};
/// lit.glb: the source document, everything kept, with a TEXCOORD_1 per instance and the pages'
/// lightmaps referenced by MX_lightmap (nodes) and MOZ_lightmap (materials); one LitPage per page
/// of the atlas. Self-contained: buffers and images of the upload are embedded. Errors: `io_error`,
/// and `invalid_scene` where the source changed since it was imported.
proto::Expected<void> write_lit_glb(const std::filesystem::path&, const SceneFiles&, const Scene&,
                                    const Atlas&, std::span<const LitPage>);
/// The same to an open file.
proto::Expected<void> write_lit_glb(int fd, const SceneFiles&, const Scene&, const Atlas&,
                                    std::span<const LitPage>);

class SceneSource;

/// Everything of a finished bake that the files hold.
struct OutputInput {
  SceneSource& source;
  const Scene& scene;
  const Atlas& atlas;
  const TextureGroup& texels;
  const Lightmap& light;
  const FilteredLight& filtered;
};
/// Writes all the files that settings ask for into `dir`, each as a temporary that is flushed and
/// renamed when whole, those of a page at the same time. Fills pages, nodes, files and warnings of
/// `manifest`, whose other members must be set before; manifest.json comes last and lists all files
/// but itself, `manifest` lists it too. A page over 60,000 lx is written as float, with the warning
/// `half_overflow`. Errors: `internal` (a value that is not finite, with its texel), `io_error`,
/// `canceled`.
proto::Expected<void> write_outputs(const std::filesystem::path& dir, const OutputInput&,
                                    const proto::BakeSettings&, proto::Manifest& manifest,
                                    ThreadPool&, std::stop_token);

}  // namespace kiln::baker
