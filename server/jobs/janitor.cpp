#include "server/jobs/janitor.h"

#include <condition_variable>
#include <mutex>
#include <nlohmann/json.hpp>

#include "server/base/clock.h"
#include "server/base/log.h"

namespace kiln::jobs {

Janitor::Janitor(const data::DataFolder& data, store::JobStore& store,
                 const data::SceneStore& scenes, data::UploadStore& uploads, JobControl& jobs,
                 Retention retention, std::chrono::milliseconds interval)
    : data_(data),
      store_(store),
      scenes_(scenes),
      uploads_(uploads),
      jobs_(jobs),
      retention_(retention) {
  thread_ = std::jthread([this, interval](std::stop_token stop) {
    std::mutex mutex;
    std::condition_variable_any wake;
    std::unique_lock lock(mutex);
    while (!stop.stop_requested()) {
      try {
        sweep();
      } catch (const store::DatabaseError& e) {
        log_line(base::LogLevel::kError, "store", {{"what", e.what()}});
      }
      wake.wait_for(lock, stop, interval, [] { return false; });
    }
  });
}

void Janitor::sweep() {
  const std::lock_guard lock(sweeping_);
  sweep_jobs();
  uploads_.sweep(base::now_rfc3339());
  sweep_checkpoints();
  sweep_scenes();
  if (retention_.max_bytes > 0) sweep_to_budget();
}

void Janitor::remove_job(const std::string& id, const char* reason) {
  if (jobs_.remove(id, /*force=*/false))
    log_line(base::LogLevel::kInfo, "retention", {{"job", id}, {"reason", reason}});
}

void Janitor::sweep_jobs() {
  for (const auto& id : store_.expired(base::now_rfc3339())) remove_job(id, "expired");
}

void Janitor::sweep_checkpoints() const {
  for (const auto& id : data_.job_folders()) {
    std::error_code error;
    if (!std::filesystem::exists(data_.checkpoints(id), error)) continue;
    const auto stored = store_.find(id);
    if (!stored || !proto::is_terminal(stored->job.state)) continue;
    if (base::seconds_after(stored->job.finished_at, retention_.leftovers) > base::now_rfc3339())
      continue;
    data_.remove_checkpoints(id);
    log_line(base::LogLevel::kInfo, "retention", {{"checkpoints", id}, {"reason", "unused"}});
  }
}

void Janitor::sweep_scenes() const {
  const auto is_named = [&](const std::string& key) { return store_.names_scene(key); };
  for (const auto& key : scenes_.collect(retention_.leftovers, is_named)) {
    store_.forget_scene(key);
    log_line(base::LogLevel::kInfo, "retention", {{"scene", key}, {"reason", "unused"}});
  }
}

void Janitor::sweep_to_budget() {
  constexpr std::uint32_t kAtATime = 64;
  for (const auto& id : store_.oldest_over(kAtATime)) {
    if (data_.bytes() <= retention_.max_bytes) return;
    remove_job(id, "disk budget");
    sweep_scenes();
  }
}

}  // namespace kiln::jobs
