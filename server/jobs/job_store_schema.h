#pragma once

#include "server/storage/sqlite.h"

namespace kiln::server {

inline constexpr int kJobSchemaVersion = 7;

/// Brings the job store's tables to kJobSchemaVersion, one transaction per version. Throws
/// DatabaseError, also when a later version of the program wrote them.
void migrate_job_store(Database&);

}  // namespace kiln::server
