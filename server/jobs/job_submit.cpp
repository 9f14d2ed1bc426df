#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "proto/sha256.h"
#include "server/base/ids.h"
#include "server/jobs/job_changes.h"
#include "server/jobs/job_service.h"
#include "server/jobs/job_words.h"
#include "server/jobs/live_job.h"

/// How a job comes into being.
namespace kiln::jobs {
namespace {

using proto::JobState;

// What a request asks for: a client that sends it again may choose another multipart boundary.
std::string fingerprint(const Submission& s) {
  proto::Sha256 hash;
  hash.update(s.scene.key + "\n");
  hash.update(proto::to_text(proto::to_json(s.settings)) + "\n");
  hash.update(proto::to_text(proto::to_json(s.options)));
  return hash.hex();
}

store::StoredJob new_job(const Submission& s, const JobLimits& limits) {
  store::StoredJob stored;
  proto::Job& job = stored.job;
  job.id = base::new_id("job_");
  job.scene_sha256 = s.scene.key;
  job.scene_bytes = s.scene.bytes;
  job.settings = s.settings;
  job.tenant = s.tenant;
  job.priority = s.options.priority;
  job.labels = s.options.labels;
  job.webhook = s.options.webhook;
  job.ttl_seconds = s.options.ttl_seconds.value_or(limits.ttl_seconds);
  job.created_at = base::now_rfc3339();
  stored.bake_key = job.result_key = baker::bake_key(s.scene.key, s.settings);
  return stored;
}

}  // namespace

/// An idempotency key while its request is answered: a second one at the same time is refused.
class JobService::KeyInUse {
 public:
  KeyInUse(JobService& service, const std::string& key) : service_(service), key_(key) {
    const std::lock_guard lock(service_.mutex_);
    alone_ = service_.keys_in_use_.insert(key_).second;
  }
  ~KeyInUse() {
    if (!alone_) return;
    const std::lock_guard lock(service_.mutex_);
    service_.keys_in_use_.erase(key_);
  }
  KeyInUse(const KeyInUse&) = delete;
  KeyInUse& operator=(const KeyInUse&) = delete;
  bool alone() const { return alone_; }

 private:
  JobService& service_;
  const std::string key_;
  bool alone_ = false;
};

proto::Expected<JobService::Submitted> JobService::submit(const Submission& submission) {
  std::optional<store::IdempotencyKey> request;
  std::optional<KeyInUse> use;
  if (!submission.idempotency_key.empty()) {
    const std::string key = request_key(submission.tenant, submission.idempotency_key);
    request = store::IdempotencyKey{key, fingerprint(submission)};
    if (!use.emplace(*this, key).alone())
      return proto::fail("idempotency_in_progress",
                         "A request with this Idempotency-Key is being answered; ask again.");
    if (auto earlier = replay(*request)) return std::move(*earlier);
  }
  const store::StoredJob stored = new_job(submission, limits_);
  if (submission.options.dedupe)
    if (auto job = submit_cached(stored, request)) return Submitted{std::move(*job)};
  auto job = enqueue(stored, request);
  if (!job) return proto::Unexpected(job.error());
  return Submitted{std::move(*job)};
}

std::optional<proto::Expected<JobService::Submitted>> JobService::replay(
    const store::IdempotencyKey& request) const {
  const auto known = store_.find_request(request.key);
  if (!known) return std::nullopt;
  if (known->first != request.fingerprint)
    return proto::fail("idempotency_mismatch",
                       "This Idempotency-Key belongs to job " + known->second +
                           ", whose scene, settings or options were others.");
  auto job = get(known->second);
  if (!job) return std::nullopt;  // deleted a moment ago, and the key with it
  return Submitted{std::move(*job), true};
}

// The files of an identical bake, under this job's name too: each job can be deleted by itself.
std::optional<proto::Job> JobService::submit_cached(
    const store::StoredJob& stored, const std::optional<store::IdempotencyKey>& request) {
  const auto original = store_.find_succeeded(stored.bake_key, stored.job.tenant);
  if (!original) return std::nullopt;
  const auto files = store_.results(original->job.id);
  LiveJob job(stored);
  proto::Job& j = job.stored.job;
  if (auto linked = data_.link_results(original->job.id, j.id, files); !linked) {
    data_.remove_job(j.id);  // the original is being deleted: bake
    return std::nullopt;
  }
  j.state = JobState::kSucceeded;
  j.cached = true;
  j.progress = original->job.progress;
  j.finished_at = base::now_rfc3339();
  j.expires_at = expiry(j);
  try {
    store_.insert(job.stored, end_events(job, files), files, request);
  } catch (...) {
    data_.remove_job(j.id);
    throw;
  }
  log_state(j);
  return j;
}

proto::Expected<proto::Job> JobService::enqueue(
    const store::StoredJob& stored, const std::optional<store::IdempotencyKey>& request) {
  {
    const std::lock_guard lock(mutex_);
    if (auto room = check_room(stored.job.tenant); !room) return proto::Unexpected(room.error());
    ++submitting_;
  }
  auto job = std::make_shared<LiveJob>(stored);
  const proto::Event first = job->state_event();
  try {
    job->stored.sequence = store_.insert(stored, {first}, {}, request);
  } catch (...) {
    const std::lock_guard lock(mutex_);
    --submitting_;
    throw;
  }
  job->ring->push(first);
  {
    const std::lock_guard lock(mutex_);
    --submitting_;
    add_live(job);
  }
  changed_.notify_all();
  log_state(stored.job);
  return stored.job;
}

}  // namespace kiln::jobs
