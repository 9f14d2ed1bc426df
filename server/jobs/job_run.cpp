#include "server/jobs/job_run.h"

#include <algorithm>
#include <condition_variable>
#include <new>
#include <nlohmann/json.hpp>
#include <thread>

#include "proto/json.h"
#include "server/base/log.h"
#include "server/base/metrics.h"
#include "server/jobs/job_messages.h"

namespace kiln::jobs {
namespace {

using proto::JobState;
using Clock = std::chrono::steady_clock;

/// Calls `late` when the time is up, unless the timer is destroyed before. No time: never.
class Timer {
 public:
  Timer(std::chrono::seconds time, std::function<void()> late) {
    if (time.count() == 0) return;
    thread_ = std::jthread([time, late = std::move(late)](std::stop_token stop) {
      std::mutex mutex;
      std::condition_variable_any wake;
      std::unique_lock lock(mutex);
      wake.wait_for(lock, stop, time, [] { return false; });
      if (!stop.stop_requested()) late();
    });
  }

 private:
  std::jthread thread_;
};

bool is_plain_name(const std::string& name) {
  return !name.empty() && name[0] != '.' && name.find('/') == std::string::npos;
}

}  // namespace

JobRun::JobRun(const Bakery& bakery, const JobLimits& limits, Admission& admission,
               const JobTransitions& transitions, JobNotifier& notifier, ActiveJob& job)
    : bakery_(bakery),
      limits_(limits),
      admission_(admission),
      transitions_(transitions),
      notifier_(notifier),
      job_(job),
      log_(JobLog::path(bakery.data, job.id)) {}

JobRun::End JobRun::run(std::stop_token service_stop) {
  bool canceled_before_start = false;
  record([&] {
    canceled_before_start = job_.cancel_requested();
    if (!canceled_before_start) transitions_.start(job_);
    if (bakery_.metrics)
      bakery_.metrics->job_started(
          std::chrono::duration<double>(Clock::now() - job_.created).count());
  });
  Outcome outcome;
  if (canceled_before_start) {
    outcome.error = proto::Error{proto::kCanceledCode, "Canceled.", {}};
  } else {
    outcome = bake();
  }
  if (deferred_ && outcome.error) return End::kDeferred;
  conclude(std::move(outcome), service_stop);
  return End::kConcluded;
}

JobRun::Outcome JobRun::bake() {
  const auto log_exception = [&](const char* what) {
    log_line(base::LogLevel::kError, "job.exception", {{"job", job_.id}, {"what", what}});
  };
  try {
    return bake_scene(job_.copy());
  } catch (const std::bad_alloc&) {
    return {proto::Error{"out_of_memory", "The bake needs more memory than there is.", {}}, {}};
  } catch (const std::exception& e) {
    log_exception(e.what());
  } catch (...) {
    log_exception("unknown type");
  }
  return {
      proto::Error{"internal", "The bake failed by a fault of the service; its log says more.", {}},
      {}};
}

JobRun::Outcome JobRun::bake_scene(const proto::Job& job) {
  const auto scene = bakery_.scenes.find(job.scene_sha256);
  if (!scene) return {scene.error(), {}};
  if (auto made = bakery_.data.make_job_folders(job.id); !made) return {made.error(), {}};
  log_.line("attempt " + std::to_string(job.attempt) + " of job " + job.id +
            ", scene sha256:" + job.scene_sha256 + ", lightkiln " LIGHTKILN_VERSION);
  const Timer timer(limits_.run, [this] {
    timed_out_ = true;
    job_.stop.request_stop();
  });
  auto manifest = bakery_.bake(input_for(job, *scene), bakery_.pool, job_.stop.get_token(), *this);
  if (!manifest && timed_out_ && manifest.error().code == proto::kCanceledCode)
    return {proto::Error{"bake_timeout",
                         "The attempt took longer than the " + std::to_string(limits_.run.count()) +
                             " seconds that the service allows.",
                         {}},
            {}};
  if (!manifest) return {manifest.error(), {}};
  texels_ = manifest->statistics.texels;
  auto files = collect(*manifest);
  if (!files) return {files.error(), {}};
  return {std::nullopt, std::move(*files)};
}

JobInput JobRun::input_for(const proto::Job& job, const data::StoredScene& scene) {
  JobInput input;
  input.job = job.id;
  input.files = scene.files;
  input.settings = job.settings;
  input.limits = bakery_.import_limits;
  input.output_dir = bakery_.data.results(job.id);
  input.checkpoint_dir = bakery_.data.checkpoints(job.id);
  input.checkpoint_share = limits_.checkpoint_share;
  input.part_time = limits_.part_time;
  input.scene_sha256 = scene.main_sha256;
  input.scene_key = scene.key;
  input.finish_early = job_.finish_early.get_token();
  input.reserve_memory = [this](std::uint64_t bytes, const std::stop_token&) {
    return reserve(bytes);
  };
  return input;
}

// Returns the files to offer, flushed to the disk: the job may be called succeeded after this.
proto::Expected<std::vector<proto::ResultFile>> JobRun::collect(
    const proto::Manifest& manifest) const {
  const auto folder = bakery_.data.results(job_.id);
  log_.line("done: " + std::to_string(manifest.statistics.texels) + " texels, " +
            std::to_string(manifest.pages.size()) + " pages");
  if (auto copied = copy_log(folder / "log.txt"); !copied) return proto::Unexpected(copied.error());
  if (auto synced = proto::sync_tree(folder); !synced) return proto::Unexpected(synced.error());
  std::vector<proto::ResultFile> files;
  for (const auto& file : manifest.files)
    if (is_plain_name(file.name) && file.name != "manifest.json" && file.name != "log.txt")
      files.push_back(file);
  for (const auto& [name, type] : {std::pair("log.txt", "text/plain; charset=utf-8"),
                                   std::pair("manifest.json", "application/json")}) {
    auto digest = proto::digest_file(folder / name);
    if (!digest) return proto::Unexpected(digest.error());
    files.push_back({name, type, digest->bytes, digest->sha256});
  }
  return files;
}

// Copies the log as it is now: a result stays as it is, and later attempts go on with the log.
proto::Expected<void> JobRun::copy_log(const std::filesystem::path& to) const {
  auto text = proto::read_file(JobLog::path(bakery_.data, job_.id), JobLog::kMaxBytes);
  if (!text) text = std::string();  // on a disk that was full
  return proto::write_bytes(to, *text);
}

// Stores how the attempt ended, and empties the files of `outcome` when they are no result.
void JobRun::store_end(Outcome& outcome, const std::stop_token& service_stop) {
  const std::lock_guard lock(job_.mutex);
  const bool stopped = outcome.error && outcome.error->code == proto::kCanceledCode;
  if (job_.cancel_requested()) {
    // A bake that was asked to finish early wrote a result.
    if (job_.stop.stop_requested()) outcome.files.clear();
    transitions_.finish(job_, JobState::kCanceled, std::nullopt, outcome.files);
  } else if (stopped && service_stop.stop_requested()) {
    transitions_.requeue(job_);
  } else if (outcome.error) {
    transitions_.finish(job_, JobState::kFailed, outcome.error, {});
  } else {
    transitions_.finish(job_, JobState::kSucceeded, std::nullopt, outcome.files);
  }
}

void JobRun::conclude(Outcome outcome, const std::stop_token& service_stop) {
  if (!keep_trying(job_.id, service_stop, [&] { store_end(outcome, service_stop); })) return;
  const JobState end = job_.copy().state;
  log_.line(std::string("state ") + proto::to_string(end) +
            (end == JobState::kFailed && outcome.error
                 ? ": " + outcome.error->code + ": " + outcome.error->message
                 : ""));
  if (bakery_.metrics && proto::is_terminal(end)) bakery_.metrics->job_ended(end);
  // The others may be run again from theirs.
  if (end == JobState::kSucceeded) bakery_.data.remove_checkpoints(job_.id);
  notifier_.notify(job_);
}

void JobRun::record(const std::function<void()>& change) {
  try {
    const std::lock_guard lock(job_.mutex);
    change();
  } catch (const store::DatabaseError& e) {
    log_store_failure(job_.id, e.what());
  } catch (const std::bad_alloc&) {  // the event is lost; the bake may find what it needs
  }
  notifier_.notify(job_);
}

void JobRun::on_stage(const std::string& name) {
  log_.line("stage " + name);
  record([&] { transitions_.begin_stage(job_, name); });
}

void JobRun::on_progress(const proto::JobProgress& progress) {
  {
    const std::lock_guard lock(job_.mutex);
    const auto now = Clock::now();
    transitions_.note_progress(job_, progress);
    if (now - last_progress_ < limits_.progress_interval) return;
    last_progress_ = now;
  }
  record([&] { transitions_.add_event(job_, "job.progress", proto::to_json(progress)); });
}

void JobRun::on_resume(std::uint32_t passes) {
  report_resumed("Goes on after " + std::to_string(passes) + " passes of an earlier attempt.");
  log_line(base::LogLevel::kInfo, "job.resumed", {{"job", job_.id}, {"passes", passes}});
}

void JobRun::on_resume_within(const std::string& pass, double share) {
  const int percent = static_cast<int>(100 * share);
  report_resumed("Of the pass '" + pass + "', " + std::to_string(percent) +
                 " % are there from an earlier attempt.");
  log_line(base::LogLevel::kInfo, "job.resumed_within",
           {{"job", job_.id}, {"pass", pass}, {"percent", percent}});
}

void JobRun::report_resumed(const std::string& text) {
  log_.line(text);
  const nlohmann::json data{
      {"level", "info"}, {"code", "resumed"}, {"pointer", ""}, {"message", text}};
  record([&] { transitions_.add_event(job_, "log", data); });
}

// Does not wait: a job without room is queued again, and leaves its runner to others.
proto::Expected<void> JobRun::reserve(std::uint64_t peak_bytes) {
  {
    const std::lock_guard lock(job_.mutex);
    transitions_.note_memory_estimate(job_, peak_bytes);
  }
  const MemoryGrant grant = admission_.reserve(job_, peak_bytes);
  if (grant == MemoryGrant::kGranted) return {};
  deferred_ = grant == MemoryGrant::kWait;
  if (deferred_) return proto::fail(proto::kCanceledCode, "Waits for memory.");
  return proto::fail("job_too_large",
                     "The bake takes about " + std::to_string(peak_bytes >> 20) +
                         " MiB at its peak; all bakes of this service together may take " +
                         std::to_string(admission_.bake_memory() >> 20) +
                         ". Fewer texels or samples need less.");
}

void JobRun::on_pass(const proto::PassReport& report) {
  log_.line("pass " + std::to_string(report.index) + " " + report.name + ": " +
            proto::to_text(proto::to_json(report)));
  if (bakery_.metrics) bakery_.metrics->pass_done(report);
  record([&] { transitions_.complete_pass(job_, report); });
}

void JobRun::on_snapshot(baker::Snapshot snapshot) {
  if (snapshot.texels) texels_ = snapshot.texels->size();
  job_.show(std::move(snapshot));
}

void JobRun::on_warning(const proto::Warning& warning) {
  log_.line("warning " + warning.code + " " + warning.pointer + ": " + warning.message);
  nlohmann::json data = proto::to_json(warning);
  data["level"] = "warning";
  record([&] { transitions_.add_event(job_, "log", data); });
}

}  // namespace kiln::jobs
