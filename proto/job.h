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

/// How far a running job is. `done`/`total` count the batches of the current pass.
struct JobProgress {
  std::string stage;  ///< "import", "atlas", "solve", "output"
  std::uint32_t pass = 0;
  std::uint32_t max_passes = 0;  ///< upper limit: convergence may stop earlier
  std::uint32_t batches_done = 0, batches_total = 0;
  double residual = 1;
  double fraction = 0;  ///< 0..1 over the whole job, never falls
  std::optional<double> eta_seconds =
      {};  ///< until its end, by what has been done; while it is baked
};

struct Job {
  std::string id;  ///< job_ + 26 characters of [0-9a-z]
  JobState state = JobState::kQueued;
  std::uint32_t attempt = 1;
  std::uint64_t version = 1;  ///< grows with every change; the ETag
  std::string scene_sha256;
  std::uint64_t scene_bytes = 0;
  BakeSettings settings;
  /// Names what the bake gives: jobs with the same key have the same pixels. 64 hexadecimal digits;
  /// "" of jobs from before there were any.
  std::string result_key;
  std::uint64_t queue_position = 0;  ///< 1: next; 0: it does not wait. Known to answers only
  std::string tenant;                ///< who owns it; "" on a service without tokens
  std::int32_t priority = 0;
  Labels labels;
  std::optional<Webhook> webhook;
  std::uint64_t ttl_seconds = 0;  ///< between its end and its deletion; 0: it is kept for ever
  bool cached = false;            ///< answered by the results of an identical bake
  std::string created_at, started_at, finished_at;  ///< RFC 3339 UTC, "" when not yet
  std::string expires_at;                           ///< "" when not over or kept for ever
  std::uint64_t memory_estimate_bytes = 0;          ///< of the bake at its peak; 0: not known yet
  JobProgress progress;
  std::optional<Error> error;  ///< of a failed job
};

/// What a client reads of a job: everything but the settings, which may be of another version.
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
