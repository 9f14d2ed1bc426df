#include "server/jobs/job_store.h"

#include <gtest/gtest.h>
#include <sqlite3.h>

#include "server/jobs/event_ring.h"
#include "server/jobs/ids.h"
#include "support/temp_files.h"

namespace kiln::server {
namespace {

using proto::JobState;

proto::Job new_job() {
  proto::Job job;
  job.id = new_id("job_");
  job.scene_sha256 = std::string(64, 'a');
  job.scene_bytes = 7;
  job.settings.solver.samples = 17;
  job.created_at = now_rfc3339();
  return job;
}

TEST(JobStore, KeepsEverythingOverAReopen) {
  const test::TempFolder folder;
  proto::Job job = new_job();
  {
    JobStore store(folder.path() / "jobs.db");
    StoredJob stored{job, store.insert(job, {1, "job.state", "{}"}), 0, 2};
    stored.job.state = JobState::kFailed;
    stored.job.version = 5;
    stored.job.progress = {"solve", 3, 16, 4, 9, 0.25, 0.5};
    stored.job.error = proto::Error{"no_light", "Dark.", {{"scene", "/nodes", "none"}}};
    store.finish(stored, {{2, "job.state", "{}"}, {3, "job.end", "{}"}},
                 {{"a.exr", "image/x-exr", 5, std::string(64, 'b')}});
  }
  JobStore store(folder.path() / "jobs.db");
  const auto found = store.find(job.id);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->job.state, JobState::kFailed);
  EXPECT_EQ(found->job.version, 5u);
  EXPECT_EQ(found->crashes, 2u);
  EXPECT_EQ(found->job.settings.solver.samples, 17u);
  EXPECT_EQ(found->job.progress.pass, 3u);
  EXPECT_DOUBLE_EQ(found->job.progress.residual, 0.25);
  EXPECT_EQ(found->job.error->details.at(0).pointer, "/nodes");
  EXPECT_EQ(store.events_after(job.id, 1).size(), 2u);
  EXPECT_EQ(store.results(job.id).at(0).bytes, 5u);
  EXPECT_TRUE(store.unfinished().empty());
  store.remove(job.id);
  EXPECT_FALSE(store.find(job.id));
  EXPECT_TRUE(store.events_after(job.id, 0).empty());
  EXPECT_TRUE(store.results(job.id).empty());
}

TEST(JobStore, ListsNewestFirstByPageAndState) {
  const test::TempFolder folder;
  JobStore store(folder.path() / "jobs.db");
  std::vector<std::string> ids;
  for (int i = 0; i < 5; ++i) {
    proto::Job job = new_job();
    if (i == 2) job.state = JobState::kSucceeded;
    store.insert(job, {1, "job.state", "{}"});
    ids.push_back(job.id);
  }
  const auto first = store.list({std::nullopt, 2, std::nullopt});
  ASSERT_EQ(first.size(), 2u);
  EXPECT_EQ(first[0].job.id, ids[4]);
  const auto second = store.list({std::nullopt, 2, first[1].sequence});
  EXPECT_EQ(second.at(0).job.id, ids[2]);
  const auto done = store.list({JobState::kSucceeded, 10, std::nullopt});
  ASSERT_EQ(done.size(), 1u);
  EXPECT_EQ(done[0].job.id, ids[2]);
  EXPECT_EQ(store.unfinished().size(), 4u);
}

TEST(JobStore, ForgetsOldEventsOfLongJobs) {
  const test::TempFolder folder;
  JobStore store(folder.path() / "jobs.db");
  const proto::Job job = new_job();
  const StoredJob stored{job, store.insert(job, {1, "job.state", "{}"}), 0, 0};
  std::vector<proto::Event> events;
  for (std::uint64_t id = 2; id <= 3000; ++id) events.push_back({id, "job.progress", "{}"});
  store.save(stored, events, Database::Durability::kProgress);
  const auto kept = store.events_after(job.id, 0);
  EXPECT_EQ(kept.back().id, 3000u);
  EXPECT_GE(kept.size(), EventRing::kCapacity);
  EXPECT_LT(kept.size(), EventRing::kCapacity + 64);
}

TEST(JobStore, RefusesAStoreOfALaterVersion) {
  const test::TempFolder folder;
  const auto path = folder.path() / "jobs.db";
  { const JobStore store(path); }
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(path.c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db, "PRAGMA user_version=99", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(db);
  EXPECT_THROW(JobStore{path}, DatabaseError);
}

TEST(EventRing, HandsOutWhatComesAfterAnId) {
  EventRing ring;
  for (std::uint64_t id = 1; id <= 1500; ++id) ring.push({id, "job.progress", "{}"});
  EXPECT_FALSE(ring.after(0).complete) << "the first 476 are gone";
  EXPECT_FALSE(ring.after(475).complete);
  EXPECT_TRUE(ring.after(476).complete);
  EXPECT_EQ(ring.after(476).events.front().id, 477u);
  EXPECT_EQ(ring.after(1490, 4).events.size(), 4u);
  EXPECT_TRUE(ring.after(1500).events.empty());
  EXPECT_FALSE(ring.after(1501).complete) << "an id of the future";
  ring.push({1501, kJobEnd, "{}"});
  EXPECT_FALSE(ring.after(1490, 4).ended);
  EXPECT_TRUE(ring.after(1490).ended);
}

}  // namespace
}  // namespace kiln::server
