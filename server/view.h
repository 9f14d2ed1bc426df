#pragma once

#include <memory>

#include "server/api/views.h"
#include "server/base/memory_budget.h"
#include "server/sandbox/importer.h"

namespace kiln::server {

/// Returns the function that draws views in a service. The scene is read from the results' lit.glb,
/// by a process of the importer's: the file is the service's own, but holds bytes of an upload. A
/// view borrows the memory that it takes, once the scene is known; its error is `overloaded` where
/// bakes have left less.
api::ViewFunction make_view(std::shared_ptr<const sandbox::Importer>,
                            std::shared_ptr<base::MemoryBudget>);

}  // namespace kiln::server
