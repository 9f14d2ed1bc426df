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

#include "baker/import/import.h"
#include "proto/expected.h"
#include "server/api/upload.h"
#include "server/auth/gate.h"
#include "server/auth/rate_limiter.h"
#include "server/base/config.h"
#include "server/data/data_folder.h"
#include "server/data/scene_store.h"
#include "server/data/upload_store.h"
#include "server/http/admin_server.h"
#include "server/http/message.h"
#include "server/http/router.h"
#include "server/jobs/event_feeds.h"
#include "server/jobs/job_service.h"
#include "server/webhooks/webhooks.h"

namespace kiln::api {

/// baker::check_scene, or a test's stand-in.
using CheckFunction =
    std::function<proto::Expected<void>(const files::SceneFiles&, const proto::BakeSettings&)>;

/// Calls `wake` once when a check that was refused as `overloaded` may do better; ends with what it
/// returns.
using WatchFunction = std::function<std::shared_ptr<const void>(std::function<void()> wake)>;

/// What the routes work on; everything lives longer than they do.
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
  CheckFunction check;
  WatchFunction watch_checks;  ///< may be null
  unsigned bake_threads = 1;
  std::uint64_t import_memory_bytes = 0;  ///< that reading one scene may take; 0: no limit
};

/// The routes under /v1 (docs/http-api.md). Thread-safe.
class Api {
 public:
  explicit Api(ApiParts);

  http::Response handle(http::Request&);

 private:
  http::Response handle_limited(http::Request&);
  http::Response post_job(http::Request&);
  http::Response post_scene(http::Request&);
  http::Response put_scene_named(http::Request&);
  http::Response get_scene(http::Request&);
  http::Response list_jobs(http::Request&);
  http::Response get_job(http::Request&);
  http::Response patch_job(http::Request&);
  http::Response cancel_job(http::Request&);
  http::Response retry_job(http::Request&);
  http::Response delete_job(http::Request&);
  http::Response get_events(http::Request&);
  http::Response get_all_events(http::Request&);
  http::Response get_results(http::Request&);
  http::Response get_result(http::Request&);
  http::Response get_results_zip(http::Request&);
  http::Response get_preview(http::Request&);
  http::Response test_webhook(http::Request&);
  http::Response send_test_webhook(http::Request&, const nlohmann::json& body);
  http::Response get_capabilities(http::Request&);
  http::Response post_upload(http::Request&);
  http::Response get_upload(http::Request&);
  http::Response patch_upload(http::Request&);
  http::Response delete_upload(http::Request&);
  http::Response get_root(http::Request&);
  http::Response get_openapi(http::Request&);

  /// A job as it was asked for: of a scene that is stored, or of one that came along.
  struct JobRequest {
    jobs::Submission job;
    std::optional<data::SceneUpload> upload;
    files::SceneFiles files() const { return upload ? upload->files() : job.scene.files; }
  };
  using JobRequestAnswer =
      std::function<http::Response(http::Request&, proto::Expected<JobRequest>)>;
  http::Response receive_job_request(http::Request&, JobRequestAnswer);
  proto::Expected<JobRequest> read_json_job(const http::Request&, nlohmann::json document);
  http::Response check_and_submit(http::Request&, JobRequest, const std::string& idempotency_key);
  http::Response submit(http::Request&, JobRequest&);
  using JsonAnswer =
      std::function<http::Response(http::Request&, const std::optional<nlohmann::json>& document)>;
  /// Receives the body, a JSON object or nothing, and answers with it, or with what is wrong.
  http::Response receive_json_object(http::Request&, JsonAnswer);
  nlohmann::json job_document(proto::Job) const;  ///< with its place in the queue
  http::Response job_response(int status, const proto::Job&) const;  ///< with its ETag
  /// Errors: `not_found`, for a job of another tenant too.
  proto::Expected<proto::Job> find_job(const http::Request&) const;
  /// Errors: `not_found`, for an upload of another tenant too.
  proto::Expected<data::PartialUpload> find_upload(const http::Request&) const;
  proto::Expected<data::PartialUpload> wanted_upload(const http::Request&) const;
  using PieceAnswer = std::function<http::Response(http::Request&, http::Response)>;
  http::Response append_to_upload(http::Request&, const data::PartialUpload& before, PieceAnswer);
  http::Response answer_piece(http::Request&, data::UploadStore::Appender&,
                              const proto::Expected<void>& taken);
  http::Response finish_upload(http::Request&, const data::PartialUpload&);
  proto::Expected<Upload> read_upload(const data::PartialUpload&) const;
  http::Response finished_upload(http::Request&, const data::PartialUpload&);
  /// A scene that the client uploaded, or may see. Errors: `not_found`.
  proto::Expected<void> check_owner(const http::Request&, const std::string& scene) const;
  using SceneAnswer =
      std::function<http::Response(http::Request&, std::shared_ptr<data::SceneUpload>)>;
  /// Receives a scene and answers with it, or with what is wrong.
  http::Response receive_scene(http::Request&, SceneAnswer);
  using CheckAnswer =
      std::function<http::Response(http::Request&, const proto::Expected<void>& checked)>;
  /// Checks a scene. While too many others are being read the request waits without a thread, for
  /// half a minute; then it is `overloaded`.
  http::Response answer_when_checked(http::Request&, const files::SceneFiles&,
                                     const proto::BakeSettings&, CheckAnswer);
  http::Response answer_when_checked(http::Request&, const files::SceneFiles&,
                                     const proto::BakeSettings&, CheckAnswer,
                                     std::chrono::steady_clock::time_point until);
  using StoreAnswer =
      std::function<http::Response(http::Request&, const proto::Expected<data::SceneStore::Put>&)>;
  /// Puts a scene into the store when it has passed the check.
  http::Response store_when_checked(http::Request&, std::shared_ptr<data::SceneUpload>,
                                    StoreAnswer);
  proto::Expected<data::SceneStore::Put> put_scene(const http::Request&, data::SceneUpload&&);
  using JobAnswer = std::function<http::Response(http::Request&, const proto::Job&)>;
  /// The answer to a job when it is over, or of another version than `since`; else after the time.
  http::Response answer_when_moved(http::Request&, const proto::Job&, std::chrono::seconds,
                                   std::optional<std::uint64_t> since, JobAnswer);
  /// The job of the request when it has results, else why not.
  proto::Expected<proto::Job> find_finished(const http::Request&) const;
  proto::Expected<std::shared_ptr<const proto::Fd>> open_result(const std::string& id,
                                                                const proto::ResultFile&) const;
  proto::Expected<std::string> render_preview(const http::Request&, const proto::Job&,
                                              const baker::Snapshot&);

  struct Route {
    const char *method, *pattern;
    http::Response (Api::*handler)(http::Request&);
  };
  static const std::vector<Route>& routes();
  friend std::vector<std::pair<std::string, std::string>> api_routes();

  const ApiParts parts_;
  http::Router router_;
  auth::RateLimiter tenant_rate_, token_rate_;
  std::counting_semaphore<> webhook_tests_;  ///< at a time: half the threads
  std::counting_semaphore<> previews_{2};
};

/// How long a request may ask to wait.
inline constexpr std::uint32_t kMaxWaitSeconds = 60;

/// Method and pattern of every route of the API.
std::vector<std::pair<std::string, std::string>> api_routes();

/// A scene as the answer.
http::Response scene_response(int status, const data::StoredScene&);
std::string scene_path(const data::StoredScene&);

/// The request's Idempotency-Key; "" when it has none. Errors: `bad_request`.
proto::Expected<std::string> idempotency_key(const http::Request&);

/// What the admin port answers: /healthz, /readyz and /metrics.
http::AdminPages admin_pages(const data::DataFolder&, store::JobStore&,
                             const std::function<bool()>& draining,
                             const std::function<std::string()>& metrics);

/// Reads a number from the query. Errors: `bad_request`, with the parameter's name.
proto::Expected<std::optional<std::uint64_t>> query_number(const http::Request&, const char* name,
                                                           std::uint64_t max);

}  // namespace kiln::api
