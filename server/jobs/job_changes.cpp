#include "server/jobs/job_changes.h"

#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/base/ids.h"

namespace kiln::jobs {
namespace {

using proto::JobState;
using Durability = store::Database::Durability;

// Applies `change` to the job; undoes it when `store` throws.
template <class Change, class Store>
void apply(LiveJob& job, const Change& change, const Store& store) {
  const store::StoredJob before = job.stored;
  ++job.stored.job.version;
  std::vector<proto::Event> events;
  try {
    change(job.stored, events);
    store(events);
  } catch (...) {
    job.stored = before;
    throw;
  }
  for (auto& event : events) job.ring->push(std::move(event));
}

void start_again(store::StoredJob& s) {
  s.job.state = JobState::kQueued;
  ++s.job.attempt;
  s.job.started_at.clear();
  s.job.progress = {};
}

nlohmann::json file_names(const std::vector<proto::ResultFile>& files) {
  auto names = nlohmann::json::array();
  for (const auto& file : files) names.push_back(file.name);
  return names;
}

}  // namespace

std::string expiry(const proto::Job& job) {
  if (job.ttl_seconds == 0 || job.finished_at.empty()) return {};
  return base::seconds_after(job.finished_at,
                             std::chrono::seconds(static_cast<std::int64_t>(job.ttl_seconds)));
}

std::vector<proto::Event> end_events(const LiveJob& job,
                                     const std::vector<proto::ResultFile>& files) {
  std::vector<proto::Event> events;
  if (!files.empty()) events.push_back(job.event("result.ready", {{"files", file_names(files)}}));
  events.push_back(job.state_event(events.size()));
  events.push_back(job.event(base::kJobEnd, proto::to_json(job.stored.job), events.size()));
  return events;
}

void change_state(store::JobStore& store, LiveJob& job, JobState state, Durability durability) {
  apply(
      job,
      [&](store::StoredJob& s, std::vector<proto::Event>& events) {
        s.job.state = state;
        if (state == JobState::kPreparing) s.job.started_at = base::now_rfc3339();
        events.push_back(job.state_event());
      },
      [&](const auto& events) { store.save(job.stored, events, durability); });
}

void finish_job(store::JobStore& store, LiveJob& job, JobState state,
                std::optional<proto::Error> error, const std::vector<proto::ResultFile>& files) {
  apply(
      job,
      [&](store::StoredJob& s, std::vector<proto::Event>& events) {
        s.job.state = state;
        s.job.error = std::move(error);
        s.job.finished_at = base::now_rfc3339();
        s.job.expires_at = expiry(s.job);
        if (state == JobState::kSucceeded) s.job.progress.fraction = 1;
        events = end_events(job, files);
      },
      [&](const auto& events) { store.finish(job.stored, events, files); });
}

void requeue_job(store::JobStore& store, LiveJob& job) {
  apply(
      job,
      [&](store::StoredJob& s, std::vector<proto::Event>& events) {
        start_again(s);
        events.push_back(job.state_event());
      },
      [&](const auto& events) { store.save(job.stored, events, Durability::kPromise); });
}

void restart_job(store::JobStore& store, LiveJob& job) {
  apply(
      job,
      [&](store::StoredJob& s, std::vector<proto::Event>& events) {
        start_again(s);
        s.crashes = 0;
        s.job.error.reset();
        s.job.finished_at.clear();
        s.job.expires_at.clear();
        events.push_back(job.state_event());
      },
      [&](const auto& events) { store.restart(job.stored, events); });
}

void defer_job(store::JobStore& store, LiveJob& job) {
  const nlohmann::json news{
      {"level", "info"},
      {"code", "waits_for_memory"},
      {"pointer", ""},
      {"message", "Waits until running jobs have freed the " +
                      std::to_string(job.stored.job.memory_estimate_bytes >> 20) +
                      " MiB that it needs."}};
  apply(
      job,
      [&](store::StoredJob& s, std::vector<proto::Event>& events) {
        s.job.state = JobState::kQueued;
        s.job.started_at.clear();
        s.job.progress = {};
        events.push_back(job.state_event());
        events.push_back(job.event("log", news, 1));
      },
      [&](const auto& events) { store.save(job.stored, events, Durability::kProgress); });
}

void patch_job(store::JobStore& store, LiveJob& job, const proto::JobPatch& patch) {
  apply(
      job,
      [&](store::StoredJob& s, std::vector<proto::Event>&) {
        s.job.priority = patch.priority.value_or(s.job.priority);
        for (const auto& [name, value] : patch.labels) {
          if (value)
            s.job.labels[name] = *value;
          else
            s.job.labels.erase(name);
        }
        s.job.ttl_seconds = patch.ttl_seconds.value_or(s.job.ttl_seconds);
        s.job.expires_at = expiry(s.job);
      },
      [&](const auto& events) { store.save(job.stored, events, Durability::kPromise); });
}

void add_event(store::JobStore& store, LiveJob& job, const char* type, const nlohmann::json& data) {
  apply(
      job,
      [&](store::StoredJob&, std::vector<proto::Event>& events) {
        events.push_back(job.event(type, data));
      },
      [&](const auto& events) { store.save(job.stored, events, Durability::kProgress); });
}

}  // namespace kiln::jobs
