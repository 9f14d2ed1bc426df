#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>

#include "proto/expected.h"
#include "proto/job.h"
#include "server/api/upload.h"
#include "server/http/message.h"
#include "server/jobs/job_control.h"
#include "server/jobs/job_lookup.h"

namespace kiln::api {

/// The parts that the routes of jobs work on.
struct Jobs {
  const jobs::JobLookup& lookup;
  jobs::JobControl& control;
  Intake intake;
};

http::Response list_jobs(const Jobs&, http::Request&);
http::Response get_job(const Jobs&, http::Request&);
http::Response patch_job(const Jobs&, http::Request&);
http::Response cancel_job(const Jobs&, http::Request&);
http::Response retry_job(const Jobs&, http::Request&);
http::Response delete_job(const Jobs&, http::Request&);

/// Returns the job that the path names. Errors: `not_found`, for a job of another tenant too.
proto::Expected<proto::Job> find_job(const jobs::JobLookup&, const http::Request&);

/// Answers with a job, its place in the queue and its ETag.
http::Response job_response(const jobs::JobLookup&, int status, const proto::Job&);

using JobAnswer = std::function<http::Response(http::Request&, const proto::Job&)>;
/// Answers when the job is over, or of another version than `since`; else after the time.
http::Response answer_when_moved(const jobs::JobLookup&, http::Request&, const proto::Job&,
                                 std::chrono::seconds, std::optional<std::uint64_t> since,
                                 JobAnswer);

}  // namespace kiln::api
