#pragma once

#include <string>
#include <vector>

#include "server/cli/side_files.h"

namespace CLI {
class App;
}

namespace kiln::cli {

/// The scene that a command takes, and --side.
struct SceneInput {
  std::string path;
  std::vector<std::string> side;  ///< files that do not lie beside the scene

  void add_flags(CLI::App&);
  /// Errors: `missing_file`.
  proto::Expected<SideFiles> side_files() const { return all_side_files(path, side); }
};

}  // namespace kiln::cli
