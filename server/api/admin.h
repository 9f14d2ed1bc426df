#pragma once

#include <functional>
#include <string>

#include "server/data/data_folder.h"
#include "server/http/admin_server.h"
#include "server/store/job_store.h"

namespace kiln::api {

/// Returns the pages of the admin port: /healthz, /readyz and /metrics.
http::AdminPages admin_pages(const data::DataFolder&, store::JobStore&,
                             const std::function<bool()>& draining,
                             const std::function<std::string()>& metrics);

}  // namespace kiln::api
