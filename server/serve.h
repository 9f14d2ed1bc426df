#pragma once

#include "server/config.h"

namespace kiln::server {

/// Runs the service until SIGTERM or SIGINT, then drains: no new jobs, running requests and the
/// passes under way are finished or checkpointed. Returns the process's exit code: 0 drained,
/// 1 could not start (reason on stderr).
int serve(const ServerConfig&);

}  // namespace kiln::server
