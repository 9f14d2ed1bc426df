#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <semaphore>
#include <string>
#include <utility>
#include <vector>

#include "baker/scene/import.h"
#include "proto/expected.h"
#include "server/auth/gate.h"
#include "server/auth/rate_limiter.h"
#include "server/config.h"
#include "server/http/message.h"
#include "server/http/router.h"
#include "server/http/upload.h"
#include "server/jobs/event_feeds.h"
#include "server/jobs/job_service.h"
#include "server/storage/data_folder.h"
#include "server/storage/scene_store.h"
#include "server/storage/upload_store.h"
#include "server/webhooks/webhooks.h"

namespace kiln::server {

/// baker::check_scene, or a test's stand-in.
using CheckFunction =
    std::function<proto::Expected<void>(const baker::SceneFiles&, const proto::BakeSettings&)>;

/// Calls `wake` once when a check that was refused as `overloaded` may do better; ends with what it
/// returns.
using WatchFunction = std::function<std::shared_ptr<const void>(std::function<void()> wake)>;

/// What the routes work on; everything lives longer than they do.
struct ApiParts {
  const ServerConfig& config;
  const DataFolder& data;
  JobStore& store;
  const SceneStore& scenes;
  JobService& jobs;
  EventFeeds& feeds;
  const Webhooks& webhooks;
  UploadStore& uploads;
  const Gate& gate;
  CheckFunction check;
  WatchFunction watch_checks;  ///< may be null
  unsigned bake_threads = 1;
  std::uint64_t import_memory_bytes = 0;  ///< that reading one scene may take; 0: no limit
};

/// The routes under /v1 (docs/http-api.md). Thread-safe.
class Api {
 public:
  explicit Api(ApiParts);

  Response handle(Request&);

 private:
  Response handle_limited(Request&);
  Response post_job(Request&);
  Response post_scene(Request&);
  Response put_scene_named(Request&);
  Response get_scene(Request&);
  Response list_jobs(Request&);
  Response get_job(Request&);
  Response patch_job(Request&);
  Response cancel_job(Request&);
  Response retry_job(Request&);
  Response delete_job(Request&);
  Response get_events(Request&);
  Response get_all_events(Request&);
  Response get_results(Request&);
  Response get_result(Request&);
  Response get_results_zip(Request&);
  Response get_preview(Request&);
  Response test_webhook(Request&);
  Response get_capabilities(Request&);
  Response post_upload(Request&);
  Response get_upload(Request&);
  Response patch_upload(Request&);
  Response delete_upload(Request&);
  Response get_root(Request&);
  Response get_openapi(Request&);

  /// A job as it was asked for: of a scene that is stored, or of one that came along.
  struct JobRequest {
    Submission job;
    std::optional<SceneUpload> upload;
    baker::SceneFiles files() const { return upload ? upload->files() : job.scene.files; }
  };
  proto::Expected<JobRequest> read_job_request(Request&);
  proto::Expected<JobRequest> read_json_job(Request&);
  Response submit(Request&, JobRequest&);
  proto::Expected<std::optional<nlohmann::json>> read_json_object(Request&);
  nlohmann::json job_document(proto::Job) const;               ///< with its place in the queue
  Response job_response(int status, const proto::Job&) const;  ///< with its ETag
  /// Errors: `not_found`, for a job of another tenant too.
  proto::Expected<proto::Job> find_job(const Request&) const;
  /// Errors: `not_found`, for an upload of another tenant too.
  proto::Expected<PartialUpload> find_upload(const Request&) const;
  proto::Expected<PartialUpload> wanted_upload(const Request&) const;
  Response append_to_upload(Request&, const PartialUpload& before);
  Response finish_upload(Request&, const PartialUpload&);
  Response finished_upload(Request&, const PartialUpload&);
  /// A scene that the client uploaded, or may see. Errors: `not_found`.
  proto::Expected<void> check_owner(const Request&, const std::string& scene) const;
  proto::Expected<std::shared_ptr<SceneUpload>> receive_scene(Request&);
  using CheckAnswer = std::function<Response(Request&, const proto::Expected<void>& checked)>;
  /// Checks a scene. While too many others are being read the request waits without a thread, for
  /// half a minute; then it is `overloaded`.
  Response answer_when_checked(Request&, const baker::SceneFiles&, const proto::BakeSettings&,
                               CheckAnswer);
  Response answer_when_checked(Request&, const baker::SceneFiles&, const proto::BakeSettings&,
                               CheckAnswer, std::chrono::steady_clock::time_point until);
  using StoreAnswer = std::function<Response(Request&, const proto::Expected<SceneStore::Put>&)>;
  /// Puts a scene into the store when it has passed the check.
  Response store_when_checked(Request&, std::shared_ptr<SceneUpload>, StoreAnswer);
  proto::Expected<SceneStore::Put> put_scene(const Request&, SceneUpload&&);
  using JobAnswer = std::function<Response(Request&, const proto::Job&)>;
  /// The answer to a job when it is over, or of another version than `since`; else after the time.
  Response answer_when_moved(Request&, const proto::Job&, std::chrono::seconds,
                             std::optional<std::uint64_t> since, JobAnswer);
  /// The job of the request when it has results, else why not.
  proto::Expected<proto::Job> find_finished(const Request&) const;
  proto::Expected<std::shared_ptr<const proto::Fd>> open_result(const std::string& id,
                                                                const proto::ResultFile&) const;
  proto::Expected<std::string> render_preview(const Request&, const proto::Job&,
                                              const baker::Snapshot&);

  struct Route {
    const char *method, *pattern;
    Response (Api::*handler)(Request&);
  };
  static const std::vector<Route>& routes();
  friend std::vector<std::pair<std::string, std::string>> api_routes();

  const ApiParts parts_;
  Router router_;
  RateLimiter tenant_rate_, token_rate_;
  std::counting_semaphore<> webhook_tests_;  ///< at a time: half the threads
  std::counting_semaphore<> previews_{2};
};

/// How long a request may ask to wait.
inline constexpr std::uint32_t kMaxWaitSeconds = 60;

/// Method and pattern of every route of the API.
std::vector<std::pair<std::string, std::string>> api_routes();

/// A scene as the answer.
Response scene_response(int status, const StoredScene&);
std::string scene_path(const StoredScene&);

/// The request's Idempotency-Key; "" when it has none. Errors: `bad_request`.
proto::Expected<std::string> idempotency_key(const Request&);

/// The routes of the admin port: /healthz, /readyz and /metrics.
Router admin_routes(const DataFolder&, JobStore&, const std::function<bool()>& draining,
                    const std::function<std::string()>& metrics);

/// Reads a number from the query. Errors: `bad_request`, with the parameter's name.
proto::Expected<std::optional<std::uint64_t>> query_number(const Request&, const char* name,
                                                           std::uint64_t max);

}  // namespace kiln::server
