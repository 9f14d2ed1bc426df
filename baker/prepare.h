#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <stop_token>

#include "baker/atlas/atlas.h"
#include "baker/atlas/texture_group.h"
#include "baker/exec/thread_pool.h"
#include "baker/light/light_set.h"
#include "baker/scene/scene.h"
#include "baker/solver/world.h"
#include "baker/trace/ray_scene.h"
#include "baker/trace/texel_surface.h"
#include "baker/upload_reader.h"
#include "proto/bake_settings.h"
#include "proto/expected.h"

namespace kiln::baker {

/// A scene made ready for its first pass. Its members refer to each other, so it stays where it is.
/// The same files and settings give the same bits in every process with the same instruction set.
struct PreparedBake {
  scene::Scene scene;
  std::optional<atlas::Atlas> atlas;
  std::shared_ptr<const atlas::TextureGroup> texels;
  std::optional<light::LightSet> lights;
  std::optional<trace::RayScene> rays;
  std::optional<trace::TexelLookup> lookup;
  std::optional<solver::World> world;  ///< all of it, as methods read it
};

/// Called while a bake is prepared, from the calling thread. Each may be empty.
struct PrepareHooks {
  std::function<void(const char* stage)> on_stage;  ///< "import", "atlas", "solve"
  /// Called once the scene is known, before anything is made of it. An error ends the preparation.
  std::function<proto::Expected<void>(const scene::Scene&)> on_scene;
};

/// Makes everything before the first pass: import, settings, atlas, texels, lights, rays. The
/// process that bakes and any that computes batches for it share it. Errors: those of the stages,
/// those of hooks.on_scene, `too_expensive`, and `canceled` within a second.
proto::Expected<std::unique_ptr<PreparedBake>> prepare(UploadReader&, const proto::BakeSettings&,
                                                       exec::ThreadPool&, std::stop_token,
                                                       const PrepareHooks& = {});

}  // namespace kiln::baker
