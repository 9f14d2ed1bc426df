#pragma once

#include <filesystem>

#include "baker/atlas/atlas.h"
#include "baker/files/upload.h"
#include "baker/output/output.h"
#include "baker/scene/scene.h"
#include "proto/expected.h"

namespace kiln::output::lit {

/// Writes lit.glb: the source document, everything kept but the lights that the pages hold (see
/// LitPages::keep_lights), with a TEXCOORD_1 per instance; one LitPage per page of the atlas. The
/// pages are referenced by MOZ_lightmap on materials (sRGB) or MX_lightmap on nodes (RGBM), or
/// nowhere (none); or they are the base colors of unlit materials, which stand for the scene's own.
/// Self-contained: buffers and images of the upload are embedded. Errors:
/// `io_error`, and `invalid_scene` where the source changed since it was imported.
proto::Expected<void> write_lit_glb(const std::filesystem::path&, const files::SceneFiles&,
                                    const scene::Scene&, const atlas::Atlas&, const LitPages&,
                                    const files::ImportLimits& = {});
/// Writes the same to an open file.
proto::Expected<void> write_lit_glb(int fd, const files::SceneFiles&, const scene::Scene&,
                                    const atlas::Atlas&, const LitPages&,
                                    const files::ImportLimits& = {});

}  // namespace kiln::output::lit
