#include "server/jobs/job_lookup.h"

#include <utility>

#include "server/jobs/job_messages.h"

namespace kiln::jobs {

proto::Expected<proto::Job> JobLookup::get(const std::string& id) const {
  if (const JobPtr job = registry_.find(id)) return job->copy();
  if (auto stored = store_.find(id)) return std::move(stored->job);
  return no_such_job(id);
}

JobLookup::Page JobLookup::list(const store::JobFilter& filter) const {
  store::JobFilter one_more = filter;
  ++one_more.limit;
  std::vector<store::StoredJob> stored = store_.list(one_more);
  Page page;
  if (stored.size() > filter.limit) {
    stored.pop_back();
    page.next = stored.back().sequence;
  }
  for (auto& row : stored) page.jobs.push_back(std::move(row.job));
  return page;
}

std::vector<proto::Job> JobLookup::unfinished(const std::optional<std::string>& tenant) const {
  std::vector<proto::Job> jobs;
  for (const JobPtr& job : registry_.all()) {
    if (tenant && *tenant != job->tenant) continue;
    proto::Job now = job->copy();
    if (!proto::is_terminal(now.state)) jobs.push_back(std::move(now));
  }
  return jobs;
}

std::size_t JobLookup::queue_position(const std::string& id) const {
  const JobRegistry::Lock lock = registry_.lock();
  const JobPtr job = registry_.find(lock, id);
  if (!job) return 0;
  const std::lock_guard job_lock(job->mutex);
  return registry_.queue(lock).position(job->queue_entry());
}

std::shared_ptr<const base::EventRing> JobLookup::events(const std::string& id) const {
  if (const JobPtr job = registry_.find(id)) return job->ring;
  if (!store_.find(id)) return nullptr;
  auto kept = store_.events_after(id, 0);
  const std::uint64_t last = kept.empty() ? 0 : kept.back().id;
  return std::make_shared<base::EventRing>(last, std::move(kept));
}

baker::Snapshot JobLookup::snapshot(const std::string& id) const {
  const JobPtr job = registry_.find(id);
  return job ? job->snapshot() : baker::Snapshot{};
}

std::vector<proto::ResultFile> JobLookup::results(const std::string& id) const {
  return store_.results(id);
}

JobWatches::Watch JobLookup::watch(const std::string& id, std::optional<std::uint64_t> since,
                                   std::function<void()> moved) const {
  auto watch = watches_.add(id, since, std::move(moved));
  // The watch is on: this look sees a change from before it, and one from now on is told.
  const auto job = get(id);
  watches_.tell(id, job ? job->version : 0, !job || proto::is_terminal(job->state));
  return watch;
}

}  // namespace kiln::jobs
