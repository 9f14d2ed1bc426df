#pragma once

#include "server/base/config.h"

namespace kiln::server {

/// Runs the service until SIGTERM or SIGINT, then drains: no new jobs; running jobs get
/// `drain_seconds` to finish, then go back to the queue for the next start; running requests are
/// answered, event streams end. A second signal stops at once. Returns the process's exit code:
/// 0 drained, 1 could not start (reason on stderr), 2 forced.
int serve(const base::ServerConfig&);

}  // namespace kiln::server
