#pragma once

#include <map>
#include <memory>
#include <string>

#include "server/cli/config.h"

namespace CLI {
class App;
}

namespace kiln::cli {

/// The part of the service's configuration that the command line sets.
struct ServiceFlags {
  std::map<std::string, std::string> values;  ///< the flags that were given, by row name
  std::string config_file;

  /// Loads the configuration from these flags, variables, file and defaults. Errors:
  /// `invalid_config`.
  proto::Expected<LoadedConfig> load() const;
};

/// Adds a flag per row of the configuration, and --config, to a command.
std::shared_ptr<ServiceFlags> add_service_flags(CLI::App&);

}  // namespace kiln::cli
