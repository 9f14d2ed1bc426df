#pragma once

#include <map>
#include <memory>
#include <string>

#include "server/cli/config.h"

namespace CLI {
class App;
}

namespace kiln::cli {

/// What the command line says of the service's configuration.
struct ServiceFlags {
  std::map<std::string, std::string> values;  ///< by row name; those that were given
  std::string config_file;

  /// With variables, file and defaults. Errors: `invalid_config`.
  proto::Expected<LoadedConfig> load() const;
};

/// Gives a command a flag per row of the configuration, and --config.
std::shared_ptr<ServiceFlags> add_service_flags(CLI::App&);

}  // namespace kiln::cli
