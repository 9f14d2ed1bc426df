#pragma once

#include <filesystem>
#include <span>

#include "baker/atlas/atlas.h"
#include "baker/files/upload.h"
#include "baker/output/output.h"
#include "baker/scene/scene.h"
#include "proto/expected.h"

namespace kiln::output::lit {

/// Writes lit.glb: the source document, everything kept, with a TEXCOORD_1 per instance and the
/// pages' lightmaps referenced by MX_lightmap (nodes) and MOZ_lightmap (materials); one LitPage per
/// page of the atlas. Self-contained: buffers and images of the upload are embedded. Errors:
/// `io_error`, and `invalid_scene` where the source changed since it was imported.
proto::Expected<void> write_lit_glb(const std::filesystem::path&, const files::SceneFiles&,
                                    const scene::Scene&, const atlas::Atlas&,
                                    std::span<const LitPage>, const files::ImportLimits& = {});
/// Writes the same to an open file.
proto::Expected<void> write_lit_glb(int fd, const files::SceneFiles&, const scene::Scene&,
                                    const atlas::Atlas&, std::span<const LitPage>,
                                    const files::ImportLimits& = {});

}  // namespace kiln::output::lit
