#include "server/jobs/job_submit.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "proto/json.h"
#include "proto/sha256.h"
#include "server/base/clock.h"
#include "server/base/ids.h"
#include "server/jobs/job_messages.h"

namespace kiln::jobs {
namespace {

// An idempotency key as the store knows it: every tenant has keys of its own. Neither part has a
// blank.
std::string request_key(const std::string& tenant, const std::string& key) {
  return tenant + " " + key;
}

// A digest of what a request asks for: a client that sends it again may choose another multipart
// boundary.
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

JobSubmitter::JobSubmitter(const data::DataFolder& data, store::JobStore& store,
                           const JobLimits& limits, JobRegistry& registry, const JobLookup& lookup,
                           Admission& admission, const JobTransitions& transitions)
    : data_(data),
      store_(store),
      limits_(limits),
      registry_(registry),
      lookup_(lookup),
      admission_(admission),
      transitions_(transitions) {}

/// An idempotency key while its request is answered: a second one at the same time is refused.
class JobSubmitter::KeyInUse {
 public:
  KeyInUse(JobSubmitter& submitter, const std::string& key) : submitter_(submitter), key_(key) {
    const std::lock_guard lock(submitter_.mutex_);
    alone_ = submitter_.keys_in_use_.insert(key_).second;
  }
  ~KeyInUse() {
    if (!alone_) return;
    const std::lock_guard lock(submitter_.mutex_);
    submitter_.keys_in_use_.erase(key_);
  }
  KeyInUse(const KeyInUse&) = delete;
  KeyInUse& operator=(const KeyInUse&) = delete;
  bool alone() const { return alone_; }

 private:
  JobSubmitter& submitter_;
  const std::string key_;
  bool alone_ = false;
};

proto::Expected<void> JobSubmitter::accepting(const std::string& tenant,
                                              const std::string& idempotency_key) const {
  if (!idempotency_key.empty() && store_.find_request(request_key(tenant, idempotency_key)))
    return {};
  return admission_.check(registry_.lock(), tenant);
}

proto::Expected<JobSubmitter::Submitted> JobSubmitter::submit(const Submission& submission) {
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

std::optional<proto::Expected<JobSubmitter::Submitted>> JobSubmitter::replay(
    const store::IdempotencyKey& request) const {
  const auto known = store_.find_request(request.key);
  if (!known) return std::nullopt;
  if (known->first != request.fingerprint)
    return proto::fail("idempotency_mismatch",
                       "This Idempotency-Key belongs to job " + known->second +
                           ", whose scene, settings or options were others.");
  auto job = lookup_.get(known->second);
  if (!job) return std::nullopt;  // deleted a moment ago, and the key with it
  return Submitted{std::move(*job), true};
}

// Gives the files of an identical bake to this job too: each job can be deleted by itself.
std::optional<proto::Job> JobSubmitter::submit_cached(
    const store::StoredJob& stored, const std::optional<store::IdempotencyKey>& request) const {
  const auto original = store_.find_succeeded(stored.bake_key, stored.job.tenant);
  if (!original) return std::nullopt;
  const auto files = store_.results(original->job.id);
  ActiveJob job(stored);
  if (auto linked = data_.link_results(original->job.id, job.id, files); !linked) {
    data_.remove_job(job.id);  // the original is being deleted: bake
    return std::nullopt;
  }
  try {
    const std::lock_guard lock(job.mutex);
    transitions_.submit_cached(job, original->job, files, request);
  } catch (...) {
    data_.remove_job(job.id);
    throw;
  }
  log_state(job.job());
  return job.job();
}

proto::Expected<proto::Job> JobSubmitter::enqueue(
    const store::StoredJob& stored, const std::optional<store::IdempotencyKey>& request) {
  auto place = admission_.hold_place(stored.job.tenant);
  if (!place) return proto::Unexpected(place.error());
  const auto job = std::make_shared<ActiveJob>(stored);
  {
    const std::lock_guard lock(job->mutex);
    transitions_.submit(*job, request);
  }
  {
    const JobRegistry::Lock lock = registry_.lock();
    place->give_up(lock);
    registry_.add(lock, job);
  }
  log_state(stored.job);
  return stored.job;
}

}  // namespace kiln::jobs
