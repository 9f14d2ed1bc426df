#include "server/jobs/job_queue.h"

#include <algorithm>
#include <utility>

namespace kiln::jobs {

std::size_t JobQueue::count(const Counts& counts, const std::string& tenant) {
  const auto found = counts.find(tenant);
  return found == counts.end() ? 0 : found->second;
}

void JobQueue::less(Counts& counts, const std::string& tenant) {
  const auto found = counts.find(tenant);
  if (--found->second == 0) counts.erase(found);
}

void JobQueue::insert(const Entry& entry) {
  if (!levels_[entry.priority][entry.tenant].emplace(entry.sequence, entry.bytes).second) return;
  auto& ages = ages_[entry.priority];
  ages.insert(std::ranges::lower_bound(ages, entry.sequence), entry.sequence);
  ++size_;
  ++waiting_[entry.tenant];
}

std::size_t JobQueue::position(const Entry& entry) const {
  if (!contains(entry)) return 0;
  std::size_t before = 0;
  for (const auto& [priority, ages] : ages_) {
    if (priority == entry.priority)
      return before + std::size_t(std::ranges::lower_bound(ages, entry.sequence) - ages.begin()) +
             1;
    before += ages.size();
  }
  return 0;
}

bool JobQueue::contains(const Entry& entry) const {
  const auto level = levels_.find(entry.priority);
  if (level == levels_.end()) return false;
  const auto jobs = level->second.find(entry.tenant);
  return jobs != level->second.end() && jobs->second.contains(entry.sequence);
}

bool JobQueue::erase(const Entry& entry) {
  if (!contains(entry)) return false;
  const auto level = levels_.find(entry.priority);
  const auto jobs = level->second.find(entry.tenant);
  jobs->second.erase(entry.sequence);
  if (jobs->second.empty()) level->second.erase(jobs);
  if (level->second.empty()) levels_.erase(level);
  const auto ages = ages_.find(entry.priority);
  ages->second.erase(std::ranges::lower_bound(ages->second, entry.sequence));
  if (ages->second.empty()) ages_.erase(ages);
  --size_;
  less(waiting_, entry.tenant);
  return true;
}

std::optional<JobQueue::Entry> JobQueue::take(std::size_t max_running, std::uint64_t free_bytes) {
  std::optional<Entry> best;
  for (const auto& [priority, level] : levels_) {
    std::pair<std::size_t, std::int64_t> best_rank;
    for (const auto& [tenant, jobs] : level) {
      const auto& [sequence, bytes] = *jobs.begin();
      const std::pair rank(count(running_, tenant), sequence);
      if ((max_running > 0 && rank.first >= max_running) || (best && rank >= best_rank)) continue;
      best = Entry{tenant, priority, sequence, bytes};
      best_rank = rank;
    }
    if (best) break;
  }
  if (!best || best->bytes > free_bytes) return std::nullopt;
  erase(*best);
  ++running_total_;
  ++running_[best->tenant];
  return best;
}

void JobQueue::release(const std::string& tenant) {
  --running_total_;
  less(running_, tenant);
}

}  // namespace kiln::jobs
