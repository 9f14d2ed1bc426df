#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "proto/bake_settings.h"
#include "proto/expected.h"
#include "proto/job_options.h"

namespace kiln::proto {

enum class JobState {
  kQueued,
  kPreparing,
  kRunning,
  kFinalizing,
  kCanceling,
  kSucceeded,
  kFailed,
  kCanceled,  ///< "canceled" in JSON
};

constexpr bool is_terminal(JobState s) {
  return s == JobState::kSucceeded || s == JobState::kFailed || s == JobState::kCanceled;
}

/// The progress of a running job. `batches_done` and `batches_total` count the batches of the
/// current pass.
struct JobProgress {
  std::string stage;  ///< "import", "atlas", "solve", "reference", "output"
  std::uint32_t pass = 0;
  std::uint32_t max_passes = 0;  ///< upper limit; convergence may stop the bake earlier
  std::uint32_t batches_done = 0, batches_total = 0;
  double residual = 1;
  double fraction = 0;  ///< 0..1 over the whole job; it never falls
  /// Time until the job ends, estimated from the work done. It is set only while the job bakes.
  std::optional<double> eta_seconds = {};
};

struct Job {
  std::string id;  ///< job_ + 26 characters of [0-9a-z]
  JobState state = JobState::kQueued;
  std::uint32_t attempt = 1;
  std::uint64_t version = 1;  ///< grows with every change; it is the ETag
  std::string scene_sha256;
  std::uint64_t scene_bytes = 0;
  BakeSettings settings;
  /// Names the bake's result: jobs with the same key have the same pixels. It has 64 hexadecimal
  /// digits, or is "" for jobs from before keys existed.
  std::string result_key;
  std::uint64_t queue_position = 0;  ///< 1: next; 0: it does not wait. It is set in answers only
  std::string tenant;                ///< the owner; "" on a service without tokens
  std::int32_t priority = 0;
  Labels labels;
  std::optional<Webhook> webhook;
  std::uint64_t ttl_seconds = 0;  ///< time between its end and its deletion; 0: it is kept forever
  bool cached = false;            ///< the results come from an identical bake
  std::string created_at, started_at, finished_at;  ///< RFC 3339 UTC, "" when not yet
  std::string expires_at;                   ///< "" while it is not over, or when it is kept forever
  std::uint64_t memory_estimate_bytes = 0;  ///< the bake's peak; 0: not known yet
  JobProgress progress;
  std::optional<Error> error;  ///< error of a failed job
};

/// The part of a job that a client reads: everything but the settings, which may be of another
/// version.
struct JobSummary {
  std::string id;
  JobState state = JobState::kQueued;
  std::uint32_t attempt = 1;
  std::uint64_t version = 1;
  std::string scene_sha256;
  std::uint64_t scene_bytes = 0;
  std::string created_at, started_at, finished_at;
  JobProgress progress;
  std::optional<Error> error;
};

}  // namespace kiln::proto
