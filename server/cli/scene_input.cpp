#include "server/cli/scene_input.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "proto/json.h"

namespace kiln::cli {

void SceneInput::add_flags(CLI::App& command) {
  command.add_option("scene", path, "The scene: .glb, or .gltf with the files it names")
      ->required()
      ->type_name("FILE");
  command
      .add_option("--side", side,
                  "A file that the scene needs and that does not lie beside it; may be given many "
                  "times")
      ->type_name("FILE")
      ->take_all();
  command
      .add_option("--sky", sky,
                  "A sky map, equirectangular OpenEXR, Radiance HDR or TIFF; sets the setting "
                  "sky.map")
      ->type_name("FILE");
}

SettingsInput SceneInput::settings(SettingsInput given) const {
  // The name is quoted, since a bare name could be taken for null.
  const std::string name = std::filesystem::path(sky).filename().string();
  if (!sky.empty()) given.sets.push_back("sky.map=" + proto::to_text(nlohmann::json(name)));
  return given;
}

proto::Expected<SideFiles> SceneInput::side_files(const proto::BakeSettings& settings) const {
  std::vector<std::string> named = side;
  if (!sky.empty()) named.push_back(sky);
  return all_side_files(path, named, settings.sky.map, settings.report);
}

}  // namespace kiln::cli
