#include <new>
#include <stdexcept>

#include "tests/server/job_service_fixture.h"

namespace kiln::jobs {
namespace {

TEST_F(JobServiceTest, RunsAJobToItsEnd) {
  start(fake_.instant());
  const std::string id = submit();
  const proto::Job job = wait(id);
  EXPECT_EQ(job.state, JobState::kSucceeded);
  EXPECT_DOUBLE_EQ(job.progress.fraction, 1);
  EXPECT_FALSE(job.finished_at.empty());
  const auto files = lookup().results(id);
  ASSERT_EQ(files.size(), 3u);
  EXPECT_EQ(files[1].name, "log.txt");
  EXPECT_EQ(files[2].name, "manifest.json");
  const auto seen = events(id);
  expect_no_holes(seen);
  EXPECT_EQ(seen.front().type, "job.state");
  EXPECT_EQ(seen.back().type, "job.end");
  EXPECT_EQ(std::count_if(seen.begin(), seen.end(),
                          [](const auto& e) { return e.type == "pass.completed"; }),
            3);
}

TEST_F(JobServiceTest, RunsAsManyAsAllowedAndOldestFirst) {
  start(fake_.holding(), {2, 10});
  std::vector<std::string> ids;
  for (int i = 0; i < 4; ++i) ids.push_back(submit());
  reach(ids[0], JobState::kRunning);
  reach(ids[1], JobState::kRunning);
  EXPECT_EQ(fake_.started, 2);
  EXPECT_EQ(admission().counts().queued, 2u);
  EXPECT_EQ(lookup().get(ids[2])->state, JobState::kQueued);
  fake_.go = true;
  for (const auto& id : ids) EXPECT_EQ(wait(id).state, JobState::kSucceeded);
}

TEST_F(JobServiceTest, BoundsTheQueue) {
  start(fake_.holding(), {1, 2});
  const std::string first = submit();
  reach(first, JobState::kRunning);
  submit();
  submit();
  EXPECT_EQ(submitter().submit(submission()).error().code, "queue_full");
  EXPECT_EQ(submitter().accepting("").error().code, "queue_full");
  fake_.go = true;
}

TEST_F(JobServiceTest, CancelsWithinASecond) {
  start(fake_.holding(), {1, 10});
  const std::string running = submit(), queued = submit();
  reach(running, JobState::kRunning);
  EXPECT_EQ(control().cancel(queued)->state, JobState::kCanceled) << "a queued job ends at once";
  const auto before = std::chrono::steady_clock::now();
  EXPECT_EQ(control().cancel(running)->state, JobState::kCanceling);
  EXPECT_EQ(wait(running).state, JobState::kCanceled);
  EXPECT_LT(std::chrono::steady_clock::now() - before, 1s);
  EXPECT_EQ(control().cancel(running)->state, JobState::kCanceled) << "again: no change";
  EXPECT_EQ(events(running).back().type, "job.end");
}

TEST_F(JobServiceTest, CoalescesProgress) {
  start(fake_.holding());
  const std::string id = submit();
  reach(id, JobState::kRunning);
  std::this_thread::sleep_for(1s);  // the fake reports up to 200 times a second
  const auto seen = events(id);
  const auto progress = std::count_if(seen.begin(), seen.end(),
                                      [](const auto& e) { return e.type == "job.progress"; });
  EXPECT_GE(progress, 2);
  EXPECT_LE(progress, 7);
  EXPECT_GT(lookup().get(id)->progress.batches_done, 5u) << "the job itself is up to date";
  fake_.go = true;
}

TEST_F(JobServiceTest, AnAttemptThatTakesTooLongFails) {
  JobLimits limits;
  limits.run = 1s;
  start(fake_.holding(), limits);
  const proto::Job job = wait(submit());
  EXPECT_EQ(job.state, JobState::kFailed);
  EXPECT_EQ(job.error->code, "bake_timeout");
  start(fake_.instant(), limits);
  EXPECT_EQ(wait(submit()).state, JobState::kSucceeded);
}

TEST_F(JobServiceTest, AFaultFailsThatJobOnly) {
  start(FakeBake::throwing([] { throw std::bad_alloc(); }));
  EXPECT_EQ(wait(submit()).error->code, "out_of_memory");
  start(FakeBake::throwing([] { throw std::runtime_error("secret path"); }));
  const proto::Job job = wait(submit());
  EXPECT_EQ(job.error->code, "internal");
  EXPECT_EQ(job.error->message.find("secret"), std::string::npos);
  start(FakeBake::throwing([] { throw 1; }));
  EXPECT_EQ(wait(submit()).error->code, "internal");
  start(fake_.instant());
  EXPECT_EQ(wait(submit()).state, JobState::kSucceeded);
}

TEST_F(JobServiceTest, DeletesOnlyWhatIsOver) {
  start(fake_.holding());
  const std::string id = submit();
  reach(id, JobState::kRunning);
  EXPECT_EQ(control().remove(id, false).error().code, "job_not_terminal");
  EXPECT_TRUE(control().remove(id, true));
  EXPECT_EQ(lookup().get(id).error().code, "not_found");
  EXPECT_EQ(lookup().events(id), nullptr);
  EXPECT_FALSE(std::filesystem::exists(process_->data.job(id)));
  EXPECT_EQ(control().remove(id, false).error().code, "not_found");
}

TEST_F(JobServiceTest, ADrainPutsRunningJobsBackIntoTheQueue) {
  start(fake_.holding(), {1, 10});
  const std::string running = submit(), queued = submit();
  reach(running, JobState::kRunning);
  jobs().begin_drain();
  EXPECT_EQ(submitter().submit(submission()).error().code, "draining");
  EXPECT_FALSE(admission().wait_idle(50ms));
  const auto before = lookup().get(running)->version;
  jobs().stop();
  EXPECT_EQ(lookup().get(running)->state, JobState::kQueued);
  start(fake_.instant());
  const proto::Job again = wait(running);
  EXPECT_EQ(again.state, JobState::kSucceeded);
  EXPECT_EQ(again.attempt, 2u);
  EXPECT_GT(again.version, before);
  EXPECT_EQ(wait(queued).attempt, 1u);
  expect_no_holes(events(running));
}

}  // namespace
}  // namespace kiln::jobs
