#pragma once

#include <httplib.h>

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>

#include "clients/client.h"
#include "clients/multipart_body.h"

/// The client's inside, for its own .cpp files.
namespace kiln::clients {

/// The most bytes that are read of an error's document.
inline constexpr std::size_t kMaxProblemBytes = 1u << 20;

struct Client::Impl {
  ServerUrl url;
  httplib::Client http;

  std::string token;

  Impl(ServerUrl where, std::string token);

  std::string path(const std::string& below) const { return url.base + "/v1" + below; }
  proto::Unexpected unreachable(httplib::Error) const;

  /// Returns the body of a 2xx answer as JSON, or the service's problem as the error.
  proto::Expected<nlohmann::json> document(const httplib::Result&) const;
  proto::Expected<nlohmann::json> get(const std::string& below);
  /// Sends a body by POST and PATCH /v1/uploads, and resumes where it breaks. `name` identifies the
  /// upload, also to another process. Returns the scene's id ("sha256:...").
  proto::Expected<std::string> upload(MultipartBody&, const std::string& name, const RetryPolicy&);
  /// Returns whether the service has a scene, which then need not be sent.
  proto::Expected<bool> has_scene(const std::string& key);
  /// Sends POST /v1/jobs with all files.
  proto::Expected<proto::JobSummary> submit_whole(const Submission&);
  /// Sends POST /v1/jobs with a scene that the service has.
  proto::Expected<proto::JobSummary> submit_known(const Submission&, const std::string& scene);
  /// Sends POST /v1/jobs/{id}/{action}.
  proto::Expected<proto::JobSummary> act(const std::string& id, const std::string& action,
                                         const nlohmann::json& body);
};

/// Returns the error that a non-2xx answer describes.
proto::Error error_of_answer(int status, const std::string& body, const std::string& origin);

/// Checks the form of a job's id. Errors: `bad_request`.
proto::Expected<void> check_job_id(const std::string& id);

}  // namespace kiln::clients
