#pragma once

#include <string>

#include "proto/expected.h"
#include "proto/job.h"

/// What the parts of JobService say alike.
namespace kiln::jobs {

proto::Unexpected no_such_job(const std::string& id);
void log_state(const proto::Job&);
/// An idempotency key as the store knows it: every tenant has keys of its own. Neither part has a
/// blank.
std::string request_key(const std::string& tenant, const std::string& key);

}  // namespace kiln::jobs
