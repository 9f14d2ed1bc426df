#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/base/ids.h"
#include "server/jobs/job_transitions.h"
#include "tests/support/temp_files.h"

namespace kiln::jobs {
namespace {

using proto::JobState;

class Transitions : public ::testing::Test {
 protected:
  ActiveJob new_job() {
    store::StoredJob stored;
    stored.job.id = base::new_id("job_");
    stored.crashes = 1;
    return ActiveJob(std::move(stored));
  }
  // From now on the store takes nothing.
  void break_store() { store::Database(path_).run("ALTER TABLE job RENAME TO gone"); }

  const test::TempFolder folder_;
  const std::filesystem::path path_ = folder_.path() / "jobs.db";
  store::JobStore store_{path_};
  const JobTransitions transitions_{store_};
};

TEST_F(Transitions, KeepMemoryStoreAndEventsInStep) {
  ActiveJob job = new_job();
  transitions_.submit(job, std::nullopt);
  transitions_.start(job);
  transitions_.begin_stage(job, "solve");
  transitions_.complete_pass(job, {});
  transitions_.finish(job, JobState::kSucceeded, std::nullopt, {{"a.exr", "image/x-exr", 1, "0"}});
  const auto stored = store_.find(job.id);
  ASSERT_TRUE(stored);
  EXPECT_EQ(proto::to_json(stored->job), proto::to_json(job.job()));
  EXPECT_EQ(stored->crashes, 0u) << "a pass was done";
  EXPECT_EQ(stored->sequence, job.stored().sequence);
  const auto kept = store_.events_after(job.id, 0), shown = job.ring->after(0).events;
  ASSERT_EQ(kept.size(), 7u) << "queued, preparing, running, a pass, files, succeeded, the end";
  ASSERT_EQ(shown.size(), kept.size());
  for (std::size_t i = 0; i < kept.size(); ++i) {
    EXPECT_EQ(kept[i].id, i + 1);
    EXPECT_EQ(shown[i].data, kept[i].data);
  }
}

// A change that the store refuses does not happen.
TEST_F(Transitions, LeaveTheJobAsItWasWhenTheStoreFails) {
  ActiveJob job = new_job();
  transitions_.submit(job, std::nullopt);
  break_store();
  const nlohmann::json before = proto::to_json(job.job());
  proto::JobPatch patch;
  patch.priority = 7;
  const std::function<void()> all[]{
      [&] { transitions_.start(job); },
      [&] { transitions_.complete_pass(job, {}); },
      [&] { transitions_.add_event(job, "log", {}); },
      [&] { transitions_.cancel(job); },
      [&] {
        transitions_.finish(job, JobState::kFailed, proto::Error{"internal", "x", {}}, {});
      },
      [&] { transitions_.requeue(job); },
      [&] { transitions_.restart(job); },
      [&] { transitions_.defer(job); },
      [&] { transitions_.patch(job, patch); }};
  for (const auto& transition : all) {
    EXPECT_THROW(transition(), store::DatabaseError);
    EXPECT_EQ(proto::to_json(job.job()), before);
    EXPECT_EQ(job.stored().crashes, 1u);
    EXPECT_EQ(job.ring->last(), 1u) << "nobody is told";
  }
}

TEST_F(Transitions, AStageDoesNotHideThatAJobIsBeingCanceled) {
  ActiveJob job = new_job();
  transitions_.submit(job, std::nullopt);
  transitions_.start(job);
  transitions_.cancel(job);
  transitions_.note_cancel(job);
  transitions_.begin_stage(job, "output");
  EXPECT_EQ(job.job().state, JobState::kCanceling);
  EXPECT_EQ(job.job().progress.stage, "output");
}

// The third end of the process at the same pass is the job's fault.
TEST_F(Transitions, AJobThatEndsTheProcessAgainAndAgainFails) {
  ActiveJob job = new_job();
  transitions_.submit(job, std::nullopt);
  transitions_.start(job);
  transitions_.recover(job, 3);
  EXPECT_EQ(job.job().state, JobState::kQueued);
  EXPECT_EQ(job.job().attempt, 2u);
  EXPECT_EQ(job.stored().crashes, 2u);
  transitions_.start(job);
  transitions_.recover(job, 3);
  EXPECT_EQ(job.job().state, JobState::kFailed);
  EXPECT_EQ(job.job().error->code, "worker_lost");
}

}  // namespace
}  // namespace kiln::jobs
