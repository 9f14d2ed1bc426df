#pragma once

#include <stdexcept>
#include <string_view>
#include <utility>

#include "baker/atlas/atlas.h"
#include "baker/atlas/texture_group.h"
#include "baker/import/import.h"
#include "baker/light/light_set.h"
#include "baker/methods.h"
#include "baker/scene/scene.h"
#include "baker/solver/world.h"
#include "baker/trace/ray_scene.h"
#include "baker/trace/texel_surface.h"
#include "proto/bake_settings.h"
#include "proto/expected.h"
#include "tests/support/temp_files.h"

namespace kiln::test {

/// The value, or an exception with the error's message: what the project generates has no excuse.
template <class T>
T must(proto::Expected<T> result) {
  if (!result) throw std::runtime_error(result.error().message);
  return std::move(*result);
}

/// A generated scene as a file, as a user would post it.
class SceneFile {
 public:
  explicit SceneFile(std::string_view generator, std::uint32_t detail = 0);
  files::SceneFiles files() const { return {path_, {}}; }

 private:
  TempFolder folder_;
  std::filesystem::path path_;
};

/// A generated scene after everything that comes before the solver. Its members refer to each
/// other, so it stays where it is.
struct ReadyScene {
  scene::Scene scene;
  atlas::Atlas atlas;
  atlas::TextureGroup texels;
  trace::RayScene rays;
  light::LightSet lights;
  trace::TexelLookup lookup;

  /// @param settings those that import reads: sky and lights
  ReadyScene(std::string_view generator, std::uint32_t detail, std::uint32_t page_size,
             const proto::BakeSettings& settings = {});
  ReadyScene(const ReadyScene&) = delete;
  ReadyScene& operator=(const ReadyScene&) = delete;

  solver::World world(const proto::SolverSettings& settings,
                      const proto::QualitySettings& quality = {}) const {
    return {scene,  atlas,  texels,   rays,
            lights, lookup, settings, baker::sample_plan(settings, quality)};
  }
};

}  // namespace kiln::test
