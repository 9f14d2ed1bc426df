#include <fstream>

#include "server/jobs/janitor.h"
#include "tests/server/job_service_fixture.h"

namespace kiln::jobs {
namespace {

class Edit : public JobServiceTest {
 protected:
  static bool always(std::uint64_t) { return true; }
  void leave_checkpoint(const std::string& id) {
    std::filesystem::create_directories(process_->data.checkpoints(id));
    std::ofstream(process_->data.checkpoints(id) / "pass_0.bin") << "light";
  }
  bool has_checkpoint(const std::string& id) {
    return std::filesystem::exists(process_->data.checkpoints(id));
  }
  std::ptrdiff_t scenes() {
    using std::filesystem::directory_iterator;
    return std::distance(directory_iterator(process_->data.scenes()), directory_iterator());
  }
  void sweep(Retention retention) {
    data::UploadStore uploads(process_->data, 24h);
    Janitor(process_->data, process_->store, process_->scenes, uploads, control(), retention, 1h)
        .sweep();
  }
};

TEST_F(Edit, APatchChangesWhatItNames) {
  start(fake_.instant());
  Submission s = submission();
  s.options.labels = {{"team", "a"}, {"level", "1"}};
  s.options.ttl_seconds = 100;
  const std::string id = submitter().submit(s)->job.id;
  const proto::Job before = wait(id);
  EXPECT_EQ(before.labels, s.options.labels);
  EXPECT_GT(before.expires_at, before.finished_at);
  proto::JobPatch patch;
  patch.labels = {{"team", "b"}, {"level", std::nullopt}, {"new", "x"}};
  patch.ttl_seconds = 0;
  const auto other = [&](std::uint64_t version) { return version != before.version; };
  EXPECT_EQ(control().patch(id, patch, other).error().code, "precondition_failed");
  const proto::Job after = control().patch(id, patch, always).value();
  EXPECT_EQ(after.labels, (proto::Labels{{"new", "x"}, {"team", "b"}}));
  EXPECT_EQ(after.expires_at, "");
  EXPECT_GT(after.version, before.version);
  EXPECT_EQ(lookup().get(id)->labels, after.labels);
  EXPECT_EQ(events(id).back().type, "job.end") << "no event comes after the last";
  patch.labels.clear();
  for (int i = 0; i < 31; ++i) patch.labels["l" + std::to_string(i)] = "";
  EXPECT_EQ(control().patch(id, patch, always).error().code, "invalid_request") << "33 labels";
  EXPECT_EQ(control().patch("job_none", patch, always).error().code, "not_found");
}

TEST_F(Edit, ACancelThatDrainsKeepsTheLight) {
  start(fake_.holding());
  const std::string id = submit();
  reach(id, JobState::kRunning);
  EXPECT_EQ(control().cancel(id, CancelMode::kDrain)->state, JobState::kCanceling);
  EXPECT_EQ(wait(id).state, JobState::kCanceled);
  EXPECT_EQ(lookup().results(id).size(), 3u);
  const std::string cut = submit();
  reach(cut, JobState::kRunning);
  control().cancel(cut);
  EXPECT_EQ(wait(cut).state, JobState::kCanceled);
  EXPECT_TRUE(lookup().results(cut).empty());
}

TEST_F(Edit, ARetryIsTheNextAttemptOfTheSameJob) {
  start(FakeBake::throwing([] { throw std::bad_alloc(); }));
  const std::string id = submit();
  EXPECT_EQ(wait(id).state, JobState::kFailed);
  start(fake_.holding());
  leave_checkpoint(id);
  const proto::Job again = control().retry(id, RetryFrom::kCheckpoint).value();
  EXPECT_EQ(again.attempt, 2u);
  EXPECT_FALSE(again.error);
  EXPECT_EQ(again.finished_at, "");
  reach(id, JobState::kRunning);
  EXPECT_TRUE(has_checkpoint(id));
  EXPECT_EQ(control().retry(id, RetryFrom::kStart).error().code, "job_not_retryable");
  control().cancel(id, CancelMode::kDrain);
  EXPECT_EQ(wait(id).state, JobState::kCanceled);
  EXPECT_EQ(control().retry(id, RetryFrom::kStart)->attempt, 3u);
  EXPECT_FALSE(std::filesystem::exists(process_->data.checkpoints(id) / "pass_0.bin"));
  EXPECT_TRUE(lookup().results(id).empty()) << "those of the attempt before are gone";
  fake_.go = true;
  EXPECT_EQ(wait(id).state, JobState::kSucceeded);
  EXPECT_FALSE(has_checkpoint(id));
  expect_no_holes(events(id));
  EXPECT_EQ(control().retry(id, RetryFrom::kStart).error().code, "job_not_retryable");
  EXPECT_EQ(control().retry("job_none", RetryFrom::kStart).error().code, "not_found");
}

// Found by a storm of requests: a retry could queue a job that was being deleted.
TEST_F(Edit, RetryAndDeleteAtTheSameTimeAgree) {
  start(FakeBake::throwing([] { throw std::bad_alloc(); }));
  for (int round = 0; round < 30; ++round) {
    const std::string id = submit();
    ASSERT_EQ(wait(id).state, JobState::kFailed);
    std::vector<std::jthread> threads;
    for (int i = 0; i < 2; ++i) {
      threads.emplace_back([&] { EXPECT_NO_THROW((void)control().retry(id, RetryFrom::kStart)); });
      threads.emplace_back([&] { EXPECT_NO_THROW((void)control().remove(id, true)); });
    }
    threads.clear();  // joins
    if (lookup().get(id)) {
      EXPECT_EQ(wait(id).state, JobState::kFailed);
      EXPECT_TRUE(control().remove(id, true));
    }
  }
}

TEST_F(Edit, LeftoversOfACrashAreCleared) {
  start(fake_.instant());
  const std::string id = submit(), orphan = "job_" + std::string(26, '0');
  wait(id);
  leave_checkpoint(id);
  leave_checkpoint(orphan);
  start(fake_.instant());
  EXPECT_FALSE(has_checkpoint(id));
  EXPECT_FALSE(std::filesystem::exists(process_->data.job(orphan)));
  EXPECT_EQ(lookup().results(id).size(), 3u);
  EXPECT_TRUE(std::filesystem::exists(process_->data.results(id) / "page_00.exr"));
}

TEST_F(Edit, TheJanitorKeepsWhatSomeoneMayAskFor) {
  start(fake_.instant());
  Submission s = submission();
  s.options.ttl_seconds = 1;
  const std::string brief = submitter().submit(s)->job.id, kept = submit();
  wait(brief);
  wait(kept);
  std::this_thread::sleep_for(1100ms);
  sweep({0s, 0});
  EXPECT_EQ(lookup().get(brief).error().code, "not_found");
  EXPECT_TRUE(lookup().get(kept));
  EXPECT_EQ(scenes(), 1) << "a job names it";
  EXPECT_TRUE(control().remove(kept, false));
  sweep({1h, 0});
  EXPECT_EQ(scenes(), 1) << "it was used a moment ago";
  sweep({0s, 0});
  EXPECT_EQ(scenes(), 0);
}

TEST_F(Edit, CheckpointsOfAFailedJobGoAfterAWhile) {
  start(FakeBake::throwing([] { throw std::bad_alloc(); }));
  const std::string id = submit();
  wait(id);
  leave_checkpoint(id);
  sweep({1h, 0});
  EXPECT_TRUE(has_checkpoint(id));
  sweep({0s, 0});
  EXPECT_FALSE(has_checkpoint(id));
  EXPECT_TRUE(lookup().get(id));
}

TEST_F(Edit, TheDiskBudgetTakesTheOldestJobs) {
  start(fake_.instant());
  std::vector<std::string> ids;
  for (int i = 0; i < 4; ++i) {
    ids.push_back(submit());  // each leaves 100 kB
    wait(ids.back());
  }
  sweep({1h, process_->data.bytes() - 150'000});
  EXPECT_FALSE(lookup().get(ids[0]));
  EXPECT_FALSE(lookup().get(ids[1]));
  EXPECT_TRUE(lookup().get(ids[2]));
  EXPECT_TRUE(lookup().get(ids[3]));
}

}  // namespace
}  // namespace kiln::jobs
