#pragma once

#include <string>

#include "proto/expected.h"
#include "proto/job.h"

/// What the parts of JobService say alike.
namespace kiln::server {

proto::Unexpected no_such_job(const std::string& id);
void log_state(const proto::Job&);

}  // namespace kiln::server
