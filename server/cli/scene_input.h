#pragma once

#include <string>
#include <vector>

#include "server/cli/settings_input.h"
#include "server/cli/side_files.h"

namespace CLI {
class App;
}

namespace kiln::cli {

/// The scene that a command takes, --side and --sky.
struct SceneInput {
  std::string path;
  std::vector<std::string> side;  ///< files that do not lie beside the scene
  std::string sky;                ///< a sky map, "" for none

  void add_flags(CLI::App&);
  /// With those of --set and --settings, which know nothing of --sky.
  SettingsInput settings(SettingsInput) const;
  /// Errors: `missing_file`.
  proto::Expected<SideFiles> side_files(const proto::BakeSettings&) const;
};

}  // namespace kiln::cli
