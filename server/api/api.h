#pragma once

#include <cstdint>
#include <semaphore>

#include "server/api/routes.h"
#include "server/auth/gate.h"
#include "server/auth/rate_limiter.h"
#include "server/base/config.h"
#include "server/http/message.h"
#include "server/http/router.h"
#include "server/jobs/job_service.h"

namespace kiln::api {

/// The parts that the API is put together from; they live longer than it does.
struct ApiParts {
  const base::ServerConfig& config;
  const data::DataFolder& data;
  store::JobStore& store;
  const data::SceneStore& scenes;
  jobs::JobService& jobs;
  jobs::EventFeeds& feeds;
  const webhooks::Webhooks& webhooks;
  data::UploadStore& uploads;
  const auth::Gate& gate;
  SceneCheck check;
  exec::ThreadPool& pool;  ///< what bakes, views and visibility run on
  ViewFunction view;
  VisibilityFunction see;
  base::Metrics& metrics;
  std::uint64_t import_memory_bytes = 0;  ///< memory that reading one scene may take; 0: no limit
};

/// The API on its port (docs/http-api.md): admits a client, within its rates, to the routes.
/// Thread-safe.
class Api {
 public:
  explicit Api(ApiParts);
  Api(const Api&) = delete;
  Api& operator=(const Api&) = delete;

  http::Response handle(http::Request&);

 private:
  http::Response handle_limited(http::Request&);

  const auth::Gate& gate_;
  auth::RateLimiter tenant_rate_, token_rate_;
  std::counting_semaphore<> webhook_tests_;  ///< at a time: half the threads
  std::counting_semaphore<> previews_{2};
  const ViewFunction view_;
  const VisibilityFunction see_;
  // The work of the desks refers to the functions; it ends with them.
  Desk views_{Views::kAtOnce, Views::kInLine};
  Desk visibility_{Visibility::kAtOnce, Visibility::kInLine};
  const Resources resources_;
  const http::Router router_;
};

}  // namespace kiln::api
