#include "tests/support/ready_scene.h"

#include "baker/generate/generate.h"

namespace kiln::test {
namespace {

scene::Scene import_generated(std::string_view generator, std::uint32_t detail,
                              const proto::BakeSettings& settings) {
  return must(import::import_scene(SceneFile(generator, detail).files(), settings));
}

atlas::Atlas lay_out(const scene::Scene& scene, std::uint32_t page_size) {
  proto::AtlasSettings settings;
  settings.page_size = page_size;
  return must(atlas::build_atlas(scene, settings));
}

}  // namespace

SceneFile::SceneFile(std::string_view generator, std::uint32_t detail)
    : path_(folder_.write("scene.glb", must(generate::generate_glb(generator, detail)))) {}

ReadyScene::ReadyScene(std::string_view generator, std::uint32_t detail, std::uint32_t page_size,
                       const proto::BakeSettings& settings)
    : scene(import_generated(generator, detail, settings)),
      atlas(lay_out(scene, page_size)),
      texels(must(atlas::rasterize(scene, atlas))),
      rays(must(trace::RayScene::build(scene))),
      lights(scene),
      lookup(scene, atlas, texels) {}

}  // namespace kiln::test
