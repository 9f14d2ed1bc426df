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

/// What POST /v1/jobs takes.
struct Submission {
  std::filesystem::path scene;
  std::map<std::string, std::filesystem::path> side;  ///< by the name that the glTF uses
  std::string settings_json;                          ///< "" for the service's defaults
  proto::JobOptions options;
};

/// How a lost event stream is taken up again.
struct RetryPolicy {
  std::chrono::milliseconds first{250}, longest{5000};
  std::chrono::milliseconds give_up{60'000};  ///< after so long without an answer
  std::chrono::seconds silence{60};           ///< a stream this quiet is dead: heartbeats are 15 s
};

/// Talks to one service. Errors are the service's own (its codes, pointers and words), or
///  `server_unreachable`  nothing answers there, or the connection broke
///  `bad_document`        something answers that is not this service
/// Calls block. One object per thread.
class Client {
 public:
  /// `token`: sent with every request unless empty.
  explicit Client(ServerUrl, std::string token = {});
  ~Client();
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  /// Scenes from this size on are sent so that a broken upload can be resumed.
  static constexpr std::uint64_t kResumableBytes = 8u << 20;

  /// Hashes the files first: a scene that the service has is not sent. A large one goes on where
  /// its upload broke, in this call or an earlier one. Reads files in pieces; memory does not grow
  /// with them. `policy`: for broken uploads.
  proto::Expected<proto::JobSummary> submit(const Submission&, const RetryPolicy& policy = {});
  proto::Expected<proto::JobSummary> job(const std::string& id);
  proto::Expected<std::vector<proto::JobSummary>> jobs();  ///< newest first, at most 50
  /// `keep_light`: the passes that are done become the result.
  proto::Expected<proto::JobSummary> cancel(const std::string& id, bool keep_light = false);
  /// Runs a job that failed or was canceled again, from its last checkpoint or from the start.
  proto::Expected<proto::JobSummary> retry(const std::string& id, bool from_start = false);

  /// Follows a job's events from the one after `after` until `job.end`, over as many connections as
  /// it takes, or until the handler returns false.
  proto::Expected<void> follow(const std::string& id, std::uint64_t after,
                               const std::function<bool(const proto::Event&)>& handler,
                               const RetryPolicy& = {});

  proto::Expected<std::vector<proto::ResultFile>> results(const std::string& id);
  /// Writes one result file into `dir`; a file that is there already with the right digest is kept.
  proto::Expected<void> download(const std::string& id, const proto::ResultFile&,
                                 const std::filesystem::path& dir);

  struct Impl;  ///< client_impl.h, for the client's own .cpp files

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace kiln::clients
