#pragma once

#include <string>

#include "proto/expected.h"
#include "proto/job.h"

/// Messages that several parts of this room give alike.
namespace kiln::jobs {

/// Returns the error `not_found` for a job.
proto::Unexpected no_such_job(const std::string& id);
/// Logs a job's state.
void log_state(const proto::Job&);
/// Logs that the store failed on behalf of a job.
void log_store_failure(const std::string& job, const char* what);

}  // namespace kiln::jobs
