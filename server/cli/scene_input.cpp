#include "server/cli/scene_input.h"

#include <CLI/CLI.hpp>

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
}

}  // namespace kiln::cli
