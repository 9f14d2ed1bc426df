#include "server/jobs/job_run.h"

#include <algorithm>
#include <condition_variable>
#include <new>
#include <nlohmann/json.hpp>
#include <thread>

#include "proto/json.h"
#include "server/base/log.h"
#include "server/base/metrics.h"

namespace kiln::jobs {
namespace {

using proto::JobState;
using Durability = store::Database::Durability;
using Clock = std::chrono::steady_clock;

/// Calls `late` unless it goes before the time is up. No time: never.
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

JobRun::End JobRun::run(std::stop_token service_stop) {
  bool canceled_before_start = false;
  record([&] {
    canceled_before_start = job_.cancel_requested;
    if (!canceled_before_start)
      change_state(context_.store, job_, JobState::kPreparing, Durability::kProgress);
    if (context_.metrics)
      context_.metrics->job_started(
          std::chrono::duration<double>(Clock::now() - job_.waiting_since).count());
  });
  Outcome outcome;
  if (canceled_before_start) {
    outcome.error = proto::Error{proto::kCanceledCode, "Canceled.", {}};
  } else {
    outcome = bake();
  }
  if (deferred_ && outcome.error) return End::kDeferred;
  conclude(std::move(outcome), std::move(service_stop));
  return End::kConcluded;
}

JobRun::Outcome JobRun::bake() {
  const proto::Job job = [&] {
    const std::lock_guard lock(job_.mutex);
    return job_.stored.job;
  }();
  try {
    auto scene = context_.scenes.find(job.scene_sha256);
    if (!scene) return {scene.error(), {}};
    if (auto made = context_.data.make_job_folders(job.id); !made) return {made.error(), {}};
    log_.line("attempt " + std::to_string(job.attempt) + " of job " + job.id +
              ", scene sha256:" + job.scene_sha256 + ", lightkiln " LIGHTKILN_VERSION);
    JobInput input;
    input.job = job.id;
    input.files = scene->files;
    input.settings = job.settings;
    input.limits = context_.import_limits;
    input.output_dir = context_.data.results(job.id);
    input.checkpoint_dir = context_.data.checkpoints(job.id);
    input.checkpoint_share = context_.limits.checkpoint_share;
    input.part_time = context_.limits.part_time;
    input.scene_sha256 = scene->main_sha256;
    input.scene_key = scene->key;
    input.finish_early = job_.enough.get_token();
    input.reserve_memory = [this](std::uint64_t bytes, const std::stop_token&) {
      return reserve(bytes);
    };
    const Timer timer(context_.limits.run, [this] {
      timed_out_ = true;
      job_.stop.request_stop();
    });
    auto manifest = context_.bake(input, context_.pool, job_.stop.get_token(), *this);
    if (!manifest && timed_out_ && manifest.error().code == proto::kCanceledCode)
      return {proto::Error{"bake_timeout",
                           "The attempt took longer than the " +
                               std::to_string(context_.limits.run.count()) +
                               " seconds that the service allows.",
                           {}},
              {}};
    if (!manifest) return {manifest.error(), {}};
    texels_ = manifest->statistics.texels;
    auto files = collect(*manifest);
    if (!files) return {files.error(), {}};
    return {std::nullopt, std::move(*files)};
  } catch (const std::bad_alloc&) {
    return {proto::Error{"out_of_memory", "The bake needs more memory than there is.", {}}, {}};
  } catch (const std::exception& e) {
    log_line(base::LogLevel::kError, "job.exception", {{"job", job.id}, {"what", e.what()}});
  } catch (...) {
    log_line(base::LogLevel::kError, "job.exception", {{"job", job.id}, {"what", "unknown type"}});
  }
  return {
      proto::Error{"internal", "The bake failed by a fault of the service; its log says more.", {}},
      {}};
}

// The files to offer, flushed to the disk: the job may be called succeeded after this.
proto::Expected<std::vector<proto::ResultFile>> JobRun::collect(
    const proto::Manifest& manifest) const {
  const auto folder = context_.data.results(job_.id);
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

// As it is now: a result has to stay as it is, and later attempts go on with the log.
proto::Expected<void> JobRun::copy_log(const std::filesystem::path& to) const {
  auto text = proto::read_file(JobLog::path(context_.data, job_.id), JobLog::kMaxBytes);
  if (!text) text = std::string();  // on a disk that was full
  return proto::write_bytes(to, *text);
}

void JobRun::conclude(Outcome outcome, std::stop_token service_stop) {
  JobState end = JobState::kQueued;
  const auto attempt = [&] {
    const std::lock_guard lock(job_.mutex);
    const bool stopped = outcome.error && outcome.error->code == proto::kCanceledCode;
    if (job_.cancel_requested) {
      // What a bake that was told `enough` wrote is a result.
      if (job_.stop.stop_requested()) outcome.files.clear();
      finish_job(context_.store, job_, JobState::kCancelled, std::nullopt, outcome.files);
    } else if (stopped && service_stop.stop_requested()) {
      requeue_job(context_.store, job_);
    } else if (outcome.error) {
      finish_job(context_.store, job_, JobState::kFailed, outcome.error, {});
    } else {
      finish_job(context_.store, job_, JobState::kSucceeded, std::nullopt, outcome.files);
    }
    job_.snapshot = {};
    end = job_.stored.job.state;
  };
  // The outcome is a promise. While the store can't take it (a full disk), hold on to it.
  for (bool first = true;; first = false) {
    try {
      attempt();
      break;
    } catch (const store::DatabaseError& e) {
      if (first) log_line(base::LogLevel::kError, "store", {{"job", job_.id}, {"what", e.what()}});
      if (service_stop.stop_requested()) return;  // the next process runs the job again
      std::this_thread::sleep_for(std::chrono::milliseconds(500));
    } catch (const std::bad_alloc&) {
      std::this_thread::sleep_for(std::chrono::milliseconds(100));  // the bake's is free by now
    }
  }
  log_.line(std::string("state ") + proto::to_string(end) +
            (end == JobState::kFailed && outcome.error
                 ? ": " + outcome.error->code + ": " + outcome.error->message
                 : ""));
  if (context_.metrics && proto::is_terminal(end)) context_.metrics->job_ended(end);
  // The others may be run again from theirs.
  if (end == JobState::kSucceeded) context_.data.remove_checkpoints(job_.id);
  context_.notify();
}

void JobRun::record(const std::function<void()>& change) {
  try {
    const std::lock_guard lock(job_.mutex);
    change();
  } catch (const store::DatabaseError& e) {
    log_line(base::LogLevel::kError, "store", {{"job", job_.id}, {"what", e.what()}});
  } catch (
      const std::bad_alloc&) {  // what the event tells is lost; the bake may find what it needs
  }
  context_.notify();
}

void JobRun::on_stage(const std::string& name) {
  log_.line("stage " + name);
  record([&] {
    job_.stored.job.progress.stage = name;
    const JobState state = name == "solve"    ? JobState::kRunning
                           : name == "output" ? JobState::kFinalizing
                                              : JobState::kPreparing;
    if (job_.cancel_requested || job_.stored.job.state == state) return;
    change_state(context_.store, job_, state, Durability::kProgress);
  });
}

void JobRun::on_progress(const proto::JobProgress& progress) {
  {
    const std::lock_guard lock(job_.mutex);
    const auto now = Clock::now();
    job_.stored.job.progress = progress;
    ++job_.stored.job.version;
    if (now - last_progress_ < context_.limits.progress_interval) return;
    last_progress_ = now;
  }
  record([&] { add_event(context_.store, job_, "job.progress", proto::to_json(progress)); });
}

void JobRun::on_resume(std::uint32_t passes) {
  tell_resumed("Goes on after " + std::to_string(passes) + " passes of an earlier attempt.");
  log_line(base::LogLevel::kInfo, "job.resumed", {{"job", job_.id}, {"passes", passes}});
}

void JobRun::on_resume_within(const std::string& pass, double share) {
  const int percent = static_cast<int>(100 * share);
  tell_resumed("Of the pass '" + pass + "', " + std::to_string(percent) +
               " % are there from an earlier attempt.");
  log_line(base::LogLevel::kInfo, "job.resumed_within",
           {{"job", job_.id}, {"pass", pass}, {"percent", percent}});
}

void JobRun::tell_resumed(const std::string& text) {
  log_.line(text);
  const nlohmann::json data{
      {"level", "info"}, {"code", "resumed"}, {"pointer", ""}, {"message", text}};
  record([&] { add_event(context_.store, job_, "log", data); });
}

// Does not wait: what has to is queued again, and leaves its runner to others.
proto::Expected<void> JobRun::reserve(std::uint64_t peak_bytes) {
  {
    const std::lock_guard lock(job_.mutex);  // stored with the next change
    job_.stored.job.memory_estimate_bytes = peak_bytes;
    ++job_.stored.job.version;
  }
  const Admission admission = context_.admit(peak_bytes);
  if (admission == Admission::kYes) return {};
  deferred_ = admission == Admission::kLater;
  if (deferred_) return proto::fail(proto::kCanceledCode, "Waits for memory.");
  return proto::fail("job_too_large",
                     "The bake takes about " + std::to_string(peak_bytes >> 20) +
                         " MiB at its peak; all bakes of this service together may take " +
                         std::to_string(context_.memory_bytes >> 20) +
                         ". Fewer texels or samples need less.");
}

// A pass that is done is progress: what ended the attempts before was not this job.
void JobRun::on_pass(const proto::PassReport& report) {
  log_.line("pass " + std::to_string(report.index) + " " + report.name + ": " +
            proto::to_text(proto::to_json(report)));
  if (context_.metrics) context_.metrics->pass_done(report);
  record([&] {
    job_.stored.crashes = 0;
    add_event(context_.store, job_, "pass.completed", proto::to_json(report));
  });
}

void JobRun::on_snapshot(baker::Snapshot snapshot) {
  if (snapshot.texels) texels_ = snapshot.texels->size();
  const std::lock_guard lock(job_.mutex);
  job_.snapshot = std::move(snapshot);
}

void JobRun::on_warning(const proto::Warning& warning) {
  log_.line("warning " + warning.code + " " + warning.pointer + ": " + warning.message);
  nlohmann::json data = proto::to_json(warning);
  data["level"] = "warning";
  record([&] { add_event(context_.store, job_, "log", data); });
}

}  // namespace kiln::jobs
