#pragma once

#include <cstdint>
#include <memory>

#include "server/api/visibility.h"
#include "server/base/memory_budget.h"
#include "server/sandbox/importer.h"

namespace kiln::server {

/// Returns the function that answers requests of visibility in a service. A process of the
/// importer's reads the scene, unless it is ready: see ReadyScenes, which keep up to `most_kept`
/// bytes.
api::VisibilityFunction make_visibility(std::shared_ptr<const sandbox::Importer>,
                                        std::shared_ptr<base::MemoryBudget>,
                                        std::uint64_t most_kept);

}  // namespace kiln::server
