#pragma once

#include <chrono>
#include <cstdint>
#include <memory>

#include "proto/expected.h"
#include "server/api/api.h"
#include "server/auth/token_store.h"
#include "server/base/config.h"
#include "server/http/connection.h"
#include "server/jobs/job_service.h"
#include "server/webhooks/webhooks.h"

namespace kiln::server {

/// The parts that a service runs on: the baker, or stand-ins for tests, and limits that only tests
/// change.
struct ServiceParts {
  jobs::BakeFunction bake;
  api::CheckFunction check;
  http::EdgeLimits limits;
  std::shared_ptr<base::MemoryBudget> memory =
      nullptr;                                       ///< null: one of the configuration, for bakes
  std::chrono::milliseconds sweep_interval{60'000};  ///< time between two rounds of the janitor
  webhooks::WebhookDelays webhook_delays = webhooks::kWebhookDelays;
  webhooks::WebhookLimits webhook_limits{};
  api::WatchFunction watch_checks =
      nullptr;                            ///< null: those that were refused ask again now and then
  api::ViewFunction view = nullptr;       ///< null: the route of views is of no use
  api::VisibilityFunction see = nullptr;  ///< null: so is that of visibility
};

/// Runs the whole service in this process: store, queue, both ports. serve() is this plus signals.
class Service {
 public:
  /// Errors: `data_folder_in_use`, `storage_full`, `io_error`, `cannot_listen`, `internal`.
  static proto::Expected<std::unique_ptr<Service>> start(const base::ServerConfig&, ServiceParts);
  ~Service();

  std::uint16_t port() const;
  std::uint16_t admin_port() const;
  jobs::JobService& jobs();
  auth::TokenStore& tokens();
  bool needs_tokens();  ///< returns whether its clients need tokens

  /// Takes no more jobs and tells every event stream; answers other requests as before.
  void begin_drain();
  /// Returns whether the running jobs ended in time.
  bool wait_idle(std::chrono::milliseconds);
  /// Puts jobs that still run back into the queue, lets requests finish for up to `grace`, ends the
  /// streams and closes both ports.
  void stop(std::chrono::milliseconds grace);

 private:
  struct Impl;
  explicit Service(std::unique_ptr<Impl>);
  std::unique_ptr<Impl> impl_;
};

}  // namespace kiln::server
