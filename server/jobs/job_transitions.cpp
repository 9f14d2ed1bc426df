#include "server/jobs/job_transitions.h"

#include <new>
#include <nlohmann/json.hpp>
#include <thread>
#include <utility>

#include "proto/json.h"
#include "server/base/clock.h"
#include "server/jobs/job_messages.h"

namespace kiln::jobs {
namespace {

using proto::JobState;
using Durability = store::Database::Durability;

void start_again(store::StoredJob& s) {
  s.job.state = JobState::kQueued;
  ++s.job.attempt;
  s.job.started_at.clear();
  s.job.progress = {};
}

// Returns when a job that is over expires; "" when it is kept for ever.
std::string expiry(const proto::Job& job) {
  if (job.ttl_seconds == 0 || job.finished_at.empty()) return {};
  return base::seconds_after(job.finished_at,
                             std::chrono::seconds(static_cast<std::int64_t>(job.ttl_seconds)));
}

nlohmann::json file_names(const std::vector<proto::ResultFile>& files) {
  auto names = nlohmann::json::array();
  for (const auto& file : files) names.push_back(file.name);
  return names;
}

std::vector<proto::Event> end_events(const ActiveJob& job,
                                     const std::vector<proto::ResultFile>& files) {
  std::vector<proto::Event> events;
  if (!files.empty()) events.push_back(job.event("result.ready", {{"files", file_names(files)}}));
  events.push_back(job.state_event(events.size()));
  events.push_back(job.event(base::kJobEnd, proto::to_json(job.job()), events.size()));
  return events;
}

JobState state_of_stage(const std::string& stage) {
  if (stage == "solve" || stage == "reference") return JobState::kRunning;
  return stage == "output" ? JobState::kFinalizing : JobState::kPreparing;
}

}  // namespace

template <class Change, class Keep>
void JobTransitions::apply(ActiveJob& job, const Change& change, const Keep& keep) const {
  const store::StoredJob before = job.stored_;
  ++job.stored_.job.version;
  Events events;
  try {
    change(job.stored_, events);
    keep(events);
  } catch (...) {
    job.stored_ = before;
    throw;
  }
  for (auto& event : events) job.ring->push(std::move(event));
}

void JobTransitions::submit(ActiveJob& job,
                            const std::optional<store::IdempotencyKey>& request) const {
  const proto::Event first = job.state_event();
  job.stored_.sequence = store_.insert(job.stored_, {first}, {}, request);
  job.ring->push(first);
}

void JobTransitions::submit_cached(ActiveJob& job, const proto::Job& original,
                                   const std::vector<proto::ResultFile>& files,
                                   const std::optional<store::IdempotencyKey>& request) const {
  proto::Job& j = job.stored_.job;
  j.state = JobState::kSucceeded;
  j.cached = true;
  j.progress = original.progress;
  j.finished_at = base::now_rfc3339();
  j.expires_at = expiry(j);
  store_.insert(job.stored_, end_events(job, files), files, request);
}

void JobTransitions::enter(ActiveJob& job, JobState state, Durability durability) const {
  apply(
      job,
      [&](store::StoredJob& s, Events& events) {
        s.job.state = state;
        if (state == JobState::kPreparing) s.job.started_at = base::now_rfc3339();
        events.push_back(job.state_event());
      },
      [&](const Events& events) { store_.save(job.stored_, events, durability); });
}

void JobTransitions::start(ActiveJob& job) const {
  enter(job, JobState::kPreparing, Durability::kProgress);
}

void JobTransitions::begin_stage(ActiveJob& job, const std::string& stage) const {
  job.stored_.job.progress.stage = stage;
  const JobState state = state_of_stage(stage);
  if (job.cancel_requested_ || job.stored_.job.state == state) return;
  enter(job, state, Durability::kProgress);
}

void JobTransitions::complete_pass(ActiveJob& job, const proto::PassReport& report) const {
  apply(
      job,
      [&](store::StoredJob& s, Events& events) {
        s.crashes = 0;
        events.push_back(job.event("pass.completed", proto::to_json(report)));
      },
      [&](const Events& events) { store_.save(job.stored_, events, Durability::kProgress); });
}

void JobTransitions::add_event(ActiveJob& job, const char* type, const nlohmann::json& data) const {
  apply(
      job, [&](store::StoredJob&, Events& events) { events.push_back(job.event(type, data)); },
      [&](const Events& events) { store_.save(job.stored_, events, Durability::kProgress); });
}

void JobTransitions::note_progress(ActiveJob& job, const proto::JobProgress& progress) const {
  job.stored_.job.progress = progress;
  ++job.stored_.job.version;
}

void JobTransitions::note_memory_estimate(ActiveJob& job, std::uint64_t bytes) const {
  job.stored_.job.memory_estimate_bytes = bytes;
  ++job.stored_.job.version;
}

void JobTransitions::note_cancel(ActiveJob& job) const {
  job.cancel_requested_ = true;
}

void JobTransitions::cancel(ActiveJob& job) const {
  enter(job, JobState::kCanceling, Durability::kPromise);
}

void JobTransitions::finish(ActiveJob& job, JobState state, std::optional<proto::Error> error,
                            const std::vector<proto::ResultFile>& files) const {
  apply(
      job,
      [&](store::StoredJob& s, Events& events) {
        s.job.state = state;
        s.job.error = std::move(error);
        s.job.finished_at = base::now_rfc3339();
        s.job.expires_at = expiry(s.job);
        if (state == JobState::kSucceeded) s.job.progress.fraction = 1;
        events = end_events(job, files);
      },
      [&](const Events& events) { store_.finish(job.stored_, events, files); });
  job.snapshot_ = {};
}

void JobTransitions::requeue(ActiveJob& job) const {
  apply(
      job,
      [&](store::StoredJob& s, Events& events) {
        start_again(s);
        events.push_back(job.state_event());
      },
      [&](const Events& events) { store_.save(job.stored_, events, Durability::kPromise); });
  job.snapshot_ = {};
}

void JobTransitions::recover(ActiveJob& job, std::uint32_t limit) const {
  const std::uint32_t crashes = ++job.stored_.crashes;
  if (crashes < limit) return requeue(job);
  finish(job, JobState::kFailed,
         proto::Error{"worker_lost",
                      "The service ended " + std::to_string(crashes) +
                          " times while it ran this job, at the same pass.",
                      {}},
         {});
}

void JobTransitions::restart(ActiveJob& job) const {
  apply(
      job,
      [&](store::StoredJob& s, Events& events) {
        start_again(s);
        s.crashes = 0;
        s.job.error.reset();
        s.job.finished_at.clear();
        s.job.expires_at.clear();
        events.push_back(job.state_event());
      },
      [&](const Events& events) { store_.restart(job.stored_, events); });
}

void JobTransitions::defer(ActiveJob& job) const {
  const nlohmann::json news{
      {"level", "info"},
      {"code", "waits_for_memory"},
      {"pointer", ""},
      {"message", "Waits until running jobs have freed the " +
                      std::to_string(job.stored_.job.memory_estimate_bytes >> 20) +
                      " MiB that it needs."}};
  apply(
      job,
      [&](store::StoredJob& s, Events& events) {
        s.job.state = JobState::kQueued;
        s.job.started_at.clear();
        s.job.progress = {};
        events.push_back(job.state_event());
        events.push_back(job.event("log", news, 1));
      },
      [&](const Events& events) { store_.save(job.stored_, events, Durability::kProgress); });
}

void JobTransitions::patch(ActiveJob& job, const proto::JobPatch& patch) const {
  apply(
      job,
      [&](store::StoredJob& s, Events&) {
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
      [&](const Events& events) { store_.save(job.stored_, events, Durability::kPromise); });
}

bool keep_trying(const std::string& job, const std::stop_token& stop,
                 const std::function<void()>& attempt) {
  for (bool first = true;; first = false) {
    try {
      attempt();
      return true;
    } catch (const store::DatabaseError& e) {
      if (first) log_store_failure(job, e.what());
      if (stop.stop_requested()) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(500));
    } catch (const std::bad_alloc&) {
      std::this_thread::sleep_for(std::chrono::milliseconds(100));  // the bake's is free by now
    }
  }
}

}  // namespace kiln::jobs
