#include "server/jobs/job_messages.h"

#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/base/log.h"

namespace kiln::jobs {

proto::Unexpected no_such_job(const std::string& id) {
  return proto::fail("not_found", "There is no job " + id + ".");
}

void log_state(const proto::Job& job) {
  nlohmann::json fields{
      {"job", job.id}, {"state", proto::to_string(job.state)}, {"attempt", job.attempt}};
  if (job.error) fields["code"] = job.error->code;
  if (!job.tenant.empty()) fields["tenant"] = job.tenant;
  if (job.cached) fields["cached"] = true;
  log_line(job.state == proto::JobState::kFailed ? base::LogLevel::kWarn : base::LogLevel::kInfo,
           "job", fields);
}

void log_store_failure(const std::string& job, const char* what) {
  log_line(base::LogLevel::kError, "store", {{"job", job}, {"what", what}});
}

}  // namespace kiln::jobs
