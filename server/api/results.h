#pragma once

#include <semaphore>

#include "server/data/data_folder.h"
#include "server/http/message.h"
#include "server/jobs/job_lookup.h"

namespace kiln::api {

/// The parts that the routes of results and previews work on.
struct Results {
  const jobs::JobLookup& lookup;
  const data::DataFolder& data;
  std::counting_semaphore<>& previews;  ///< that may be made at a time
};

http::Response get_results(const Results&, http::Request&);
http::Response get_result(const Results&, http::Request&);
http::Response get_results_zip(const Results&, http::Request&);
http::Response get_preview(const Results&, http::Request&);

}  // namespace kiln::api
