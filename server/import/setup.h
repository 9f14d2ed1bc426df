#pragma once

#include <memory>

#include "server/config.h"
#include "server/import/importer.h"

namespace kiln::server {

/// The limits of imports that the configuration sets.
baker::ImportLimits import_limits(const ServerConfig&);

/// The importer of a service: logs what fails, and once how its processes are confined.
/// Errors: those of starting a process.
proto::Expected<std::shared_ptr<const Importer>> make_importer(const ServerConfig&,
                                                               std::shared_ptr<MemoryBudget>);

}  // namespace kiln::server
