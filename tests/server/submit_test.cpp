#include "tests/server/job_service_fixture.h"

namespace kiln::jobs {
namespace {

using Submit = JobServiceTest;

TEST_F(Submit, HigherPrioritiesRunFirst) {
  start(fake_.holding(), {1, 10});
  reach(submit(), JobState::kRunning);
  Submission low = submission(), high = submission();
  low.options.priority = -5;
  high.options.priority = 5;
  const std::string last = submitter().submit(low)->job.id, middle = submit();
  const std::string first = submitter().submit(high)->job.id,
                    raised = submitter().submit(low)->job.id;
  proto::JobPatch patch;
  patch.priority = 7;
  EXPECT_EQ(control().patch(raised, patch, [](auto) { return true; })->priority, 7);
  start(fake_.instant(), {1, 10});  // the order survives the process
  for (const auto& id : {last, middle, first, raised}) wait(id);
  const auto began = [&](const std::string& id) { return lookup().get(id)->started_at; };
  EXPECT_LE(began(raised), began(first));
  EXPECT_LE(began(first), began(middle));
  EXPECT_LE(began(middle), began(last));
}

TEST_F(Submit, AnIdempotencyKeyNamesOneJob) {
  start(fake_.instant());
  Submission s = submission();
  s.idempotency_key = "k1";
  const auto first = submitter().submit(s);
  EXPECT_FALSE(first->replayed);
  const auto again = submitter().submit(s);
  EXPECT_TRUE(again->replayed);
  EXPECT_EQ(again->job.id, first->job.id);
  Submission other = s;
  other.settings.solver.seed = 2;
  EXPECT_EQ(submitter().submit(other).error().code, "idempotency_mismatch");
  other.idempotency_key = "k2";
  EXPECT_NE(submitter().submit(other)->job.id, first->job.id);
  wait(first->job.id);
  start(fake_.instant());  // over a restart
  EXPECT_EQ(submitter().submit(s)->job.id, first->job.id);
  jobs().begin_drain();
  EXPECT_TRUE(submitter().accepting("", "k1")) << "an answer that was given takes no room";
  EXPECT_FALSE(submitter().accepting("", "k3"));
  EXPECT_EQ(submitter().submit(s)->job.id, first->job.id);
  EXPECT_TRUE(control().remove(first->job.id, false));
  EXPECT_FALSE(submitter().accepting("", "k1")) << "the key goes with the job";
}

TEST_F(Submit, AnIdenticalBakeIsNotMadeAgain) {
  start(fake_.instant());
  Submission s = submission();
  const std::string first = submitter().submit(s)->job.id;
  wait(first);
  s.options.dedupe = true;
  const proto::Job twin = submitter().submit(s)->job;
  EXPECT_NE(twin.id, first);
  EXPECT_EQ(twin.state, JobState::kSucceeded);
  EXPECT_TRUE(twin.cached);
  EXPECT_EQ(fake_.started, 1);
  const auto seen = events(twin.id);
  expect_no_holes(seen);
  EXPECT_EQ(seen.back().type, "job.end");
  EXPECT_EQ(lookup().results(twin.id).size(), 3u);
  EXPECT_TRUE(control().remove(first, false));
  const auto page = process_->data.results(twin.id) / "page_00.exr";
  EXPECT_EQ(proto::digest_file(page)->sha256, lookup().results(twin.id).at(0).sha256)
      << "each of the two can be deleted by itself";
  s.settings.solver.seed = 2;
  EXPECT_FALSE(submitter().submit(s)->job.cached);
}

TEST_F(Submit, ATwinWithoutFilesIsBakedInstead) {
  start(fake_.instant());
  Submission s = submission();
  const std::string first = submitter().submit(s)->job.id;
  wait(first);
  std::filesystem::remove(process_->data.results(first) / "page_00.exr");
  s.options.dedupe = true;
  const proto::Job job = submitter().submit(s)->job;
  EXPECT_FALSE(job.cached);
  EXPECT_EQ(wait(job.id).state, JobState::kSucceeded);
  EXPECT_EQ(fake_.started, 2);
}

}  // namespace
}  // namespace kiln::jobs
