#pragma once

#include <string>
#include <vector>

#include "server/cli/settings_input.h"
#include "server/cli/side_files.h"

namespace CLI {
class App;
}

namespace kiln::cli {

/// The scene that a command takes, with --side and --sky.
struct SceneInput {
  std::string path;
  std::vector<std::string> side;  ///< files that do not lie beside the scene
  std::string sky;                ///< a sky map, "" for none

  void add_flags(CLI::App&);
  /// Returns the settings of --set and --settings, with that of --sky added.
  SettingsInput settings(SettingsInput) const;
  /// Returns the side files of the scene, with the sky map. Errors: `missing_file`.
  proto::Expected<SideFiles> side_files(const proto::BakeSettings&) const;
};

}  // namespace kiln::cli
