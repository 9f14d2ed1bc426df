#pragma once

#include "server/store/database.h"

namespace kiln::store {

inline constexpr int kJobSchemaVersion = 7;

/// Brings the job store's tables to kJobSchemaVersion, one transaction per version. Throws
/// DatabaseError, also when a later version of the program wrote them.
void migrate_job_store(Database&);

}  // namespace kiln::store
