#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "clients/server_url.h"
#include "proto/event.h"
#include "proto/expected.h"
#include "proto/job.h"
#include "proto/manifest.h"

namespace kiln::clients {

/// The input of POST /v1/jobs.
struct Submission {
  std::filesystem::path scene;
  std::map<std::string, std::filesystem::path> side;  ///< by the name that the glTF uses
  std::string settings_json;                          ///< "" for the service's defaults
  proto::JobOptions options;
};

/// Says how to resume a lost event stream or a broken upload.
struct RetryPolicy {
  std::chrono::milliseconds first{250}, longest{5000};
  std::chrono::milliseconds give_up{60'000};  ///< the time without an answer after which to give up
  /// A stream that is silent for this long is dead: heartbeats come every 15 s.
  std::chrono::seconds silence{60};
};

/// Talks to one service. Calls block, and each thread needs an object of its own. Errors are the
/// service's own (with its codes, pointers and messages), or these:
/// - `server_unreachable`: nothing answers there, or the connection broke.
/// - `bad_document`: something answers that is not this service.
class Client {
 public:
  /// `token` is sent with every request unless it is empty.
  explicit Client(ServerUrl, std::string token = {});
  ~Client();
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  /// Scenes of this size or more are sent so that a broken upload can be resumed.
  static constexpr std::uint64_t kResumableBytes = 8u << 20;

  /// Submits a job. It hashes the files first and does not send a scene that the service has. The
  /// upload of a large scene resumes where it broke, in this call or an earlier one. Files are read
  /// in pieces; memory does not grow with them. `policy` governs broken uploads.
  proto::Expected<proto::JobSummary> submit(const Submission&, const RetryPolicy& policy = {});
  proto::Expected<proto::JobSummary> job(const std::string& id);
  proto::Expected<std::vector<proto::JobSummary>> jobs();  ///< newest first, at most 50
  /// Cancels a job. With `keep_light` the passes that are done become the result.
  proto::Expected<proto::JobSummary> cancel(const std::string& id, bool keep_light = false);
  /// Runs a job that failed or was canceled again, from its last checkpoint or from the start.
  proto::Expected<proto::JobSummary> retry(const std::string& id, bool from_start = false);

  /// Follows a job's events from the one after `after` until `job.end`, over as many connections as
  /// needed, or until the handler returns false.
  proto::Expected<void> follow(const std::string& id, std::uint64_t after,
                               const std::function<bool(const proto::Event&)>& handler,
                               const RetryPolicy& = {});

  proto::Expected<std::vector<proto::ResultFile>> results(const std::string& id);
  /// Writes one result file into `dir`; a file that already exists with the right digest is kept.
  proto::Expected<void> download(const std::string& id, const proto::ResultFile&,
                                 const std::filesystem::path& dir);

  struct Impl;  ///< defined in client_impl.h, for the client's own .cpp files

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace kiln::clients
