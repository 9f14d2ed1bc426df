#pragma once

#include <optional>
#include <semaphore>

#include "server/data/data_folder.h"
#include "server/http/message.h"
#include "server/jobs/job_lookup.h"

namespace kiln::api {

/// The parts that the routes of results and previews work on.
struct Results {
  const jobs::JobLookup& lookup;
  const data::DataFolder& data;
  std::counting_semaphore<>& previews;  ///< previews that may be made at a time
};

/// Finds the job of a route about results. Errors: `not_found`, `result_not_ready`.
proto::Expected<proto::Job> find_finished(const jobs::JobLookup&, const http::Request&);
/// Reads the exposure from the query; nothing when it is not there. Errors: `bad_request`.
proto::Expected<std::optional<float>> query_exposure(const http::Request&);

http::Response get_results(const Results&, http::Request&);
http::Response get_result(const Results&, http::Request&);
http::Response get_results_zip(const Results&, http::Request&);
http::Response get_preview(const Results&, http::Request&);

}  // namespace kiln::api
