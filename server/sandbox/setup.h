#pragma once

#include <memory>

#include "server/base/config.h"
#include "server/sandbox/importer.h"

namespace kiln::sandbox {

/// The limits of imports that the configuration sets.
files::ImportLimits import_limits(const base::ServerConfig&);

/// Starts the zygote of a service. Logs why there is none for a while.
std::shared_ptr<Zygote> start_zygote();

/// Returns the importer of a service. It logs failures, and once how its processes are confined.
/// Errors: those of starting a process.
proto::Expected<std::shared_ptr<const Importer>> make_importer(const base::ServerConfig&,
                                                               std::shared_ptr<base::MemoryBudget>,
                                                               std::shared_ptr<Zygote>);

}  // namespace kiln::sandbox
