#include "server/store/job_store.h"

#include <gtest/gtest.h>
#include <sqlite3.h>

#include "server/base/clock.h"
#include "server/base/event_ring.h"
#include "server/base/ids.h"
#include "tests/support/temp_files.h"

namespace kiln::store {
namespace {

using proto::JobState;

StoredJob new_job() {
  StoredJob stored;
  proto::Job& job = stored.job;
  job.id = base::new_id("job_");
  job.scene_sha256 = std::string(64, 'a');
  job.scene_bytes = 7;
  job.settings.solver.samples = 17;
  job.created_at = base::now_rfc3339();
  return stored;
}

TEST(JobStore, KeepsEverythingOverAReopen) {
  const test::TempFolder folder;
  StoredJob stored = new_job();
  const std::string id = stored.job.id;
  {
    JobStore store(folder.path() / "jobs.db");
    stored.bake_key = "key";
    stored.sequence = store.insert(stored, {{1, "job.state", "{}"}});
    stored.crashes = 2;
    stored.job.priority = -7;
    stored.job.labels = {{"team", "light's \"house\""}};
    stored.job.ttl_seconds = 60;
    stored.job.expires_at = "2030-01-01T00:00:00.000Z";
    stored.job.state = JobState::kFailed;
    stored.job.version = 5;
    stored.job.progress = {"solve", 3, 16, 4, 9, 0.25, 0.5};
    stored.job.error = proto::Error{"no_light", "Dark.", {{"scene", "/nodes", "none"}}};
    store.finish(stored, {{2, "job.state", "{}"}, {3, "job.end", "{}"}},
                 {{"a.exr", "image/x-exr", 5, std::string(64, 'b')}});
  }
  JobStore store(folder.path() / "jobs.db");
  const auto found = store.find(id);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->job.state, JobState::kFailed);
  EXPECT_EQ(found->job.version, 5u);
  EXPECT_EQ(found->crashes, 2u);
  EXPECT_EQ(found->bake_key, "key");
  EXPECT_EQ(found->job.priority, -7);
  EXPECT_EQ(found->job.labels, stored.job.labels);
  EXPECT_EQ(found->job.ttl_seconds, 60u);
  EXPECT_EQ(found->job.expires_at, stored.job.expires_at);
  EXPECT_EQ(store.expired("2030-01-01T00:00:00.000Z"), std::vector<std::string>{id});
  EXPECT_TRUE(store.expired("2029-12-31T23:59:59.999Z").empty());
  EXPECT_EQ(found->job.settings.solver.samples, 17u);
  EXPECT_EQ(found->job.progress.pass, 3u);
  EXPECT_DOUBLE_EQ(found->job.progress.residual, 0.25);
  EXPECT_EQ(found->job.error->details.at(0).pointer, "/nodes");
  EXPECT_EQ(store.events_after(id, 1).size(), 2u);
  EXPECT_EQ(store.results(id).at(0).bytes, 5u);
  EXPECT_TRUE(store.unfinished().empty());
  EXPECT_TRUE(store.names_scene(stored.job.scene_sha256));
  store.remove(id);
  EXPECT_FALSE(store.names_scene(stored.job.scene_sha256));
  EXPECT_FALSE(store.find(id));
  EXPECT_TRUE(store.events_after(id, 0).empty());
  EXPECT_TRUE(store.results(id).empty());
}

TEST(JobStore, ListsNewestFirstByPageAndState) {
  const test::TempFolder folder;
  JobStore store(folder.path() / "jobs.db");
  std::vector<std::string> ids;
  for (int i = 0; i < 5; ++i) {
    StoredJob stored = new_job();
    if (i == 2) stored.job.state = JobState::kSucceeded;
    if (i % 2 == 0) stored.job.labels = {{"parity", "even"}, {"i", std::to_string(i)}};
    store.insert(stored, {{1, "job.state", "{}"}});
    ids.push_back(stored.job.id);
  }
  const auto first = store.list({std::nullopt, std::nullopt, {}, 2, std::nullopt});
  ASSERT_EQ(first.size(), 2u);
  EXPECT_EQ(first[0].job.id, ids[4]);
  const auto second = store.list({std::nullopt, std::nullopt, {}, 2, first[1].sequence});
  EXPECT_EQ(second.at(0).job.id, ids[2]);
  const auto done = store.list({std::nullopt, JobState::kSucceeded, {}, 10, std::nullopt});
  ASSERT_EQ(done.size(), 1u);
  EXPECT_EQ(done[0].job.id, ids[2]);
  EXPECT_EQ(store.unfinished().size(), 4u);
  EXPECT_EQ(store.list({std::nullopt, std::nullopt, {{"parity", "even"}}, 10, std::nullopt}).size(),
            3u);
  const auto one =
      store.list({std::nullopt, std::nullopt, {{"parity", "even"}, {"i", "4"}}, 10, std::nullopt});
  ASSERT_EQ(one.size(), 1u);
  EXPECT_EQ(one[0].job.id, ids[4]);
  EXPECT_TRUE(
      store.list({std::nullopt, std::nullopt, {{"parity", "' OR 1=1"}}, 10, std::nullopt}).empty());
}

TEST(JobStore, ForgetsOldEventsOfLongJobs) {
  const test::TempFolder folder;
  JobStore store(folder.path() / "jobs.db");
  const StoredJob stored = new_job();
  const std::string id = stored.job.id;
  store.insert(stored, {{1, "job.state", "{}"}});
  std::vector<proto::Event> events;
  for (std::uint64_t n = 2; n <= 3000; ++n) events.push_back({n, "job.progress", "{}"});
  store.save(stored, events, Database::Durability::kProgress);
  const auto kept = store.events_after(id, 0);
  EXPECT_EQ(kept.back().id, 3000u);
  EXPECT_GE(kept.size(), base::EventRing::kCapacity);
  EXPECT_LT(kept.size(), base::EventRing::kCapacity + 64);
}

void run_sql(const std::filesystem::path& path, const std::string& sql) {
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(path.c_str(), &db), SQLITE_OK);
  char* error = nullptr;
  EXPECT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, &error), SQLITE_OK) << error;
  sqlite3_close(db);
}

TEST(JobStore, RefusesAStoreOfALaterVersion) {
  const test::TempFolder folder;
  const auto path = folder.path() / "jobs.db";
  { const JobStore store(path); }
  run_sql(path, "PRAGMA user_version=99");
  EXPECT_THROW(JobStore{path}, DatabaseError);
}

// The store as version 1 of the schema wrote it, with a job that runs and one that is over.
constexpr const char* kStoreOfVersion1 = R"sql(
CREATE TABLE job (
  sequence INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, state TEXT NOT NULL,
  priority INTEGER NOT NULL DEFAULT 0, attempt INTEGER NOT NULL,
  crashes INTEGER NOT NULL DEFAULT 0, version INTEGER NOT NULL, scene TEXT NOT NULL,
  scene_bytes INTEGER NOT NULL, settings TEXT NOT NULL, created_at TEXT NOT NULL,
  started_at TEXT NOT NULL DEFAULT '', finished_at TEXT NOT NULL DEFAULT '',
  stage TEXT NOT NULL DEFAULT '', pass INTEGER NOT NULL DEFAULT 0,
  max_passes INTEGER NOT NULL DEFAULT 0, batches_done INTEGER NOT NULL DEFAULT 0,
  batches_total INTEGER NOT NULL DEFAULT 0, residual REAL NOT NULL DEFAULT 1,
  fraction REAL NOT NULL DEFAULT 0, error TEXT NOT NULL DEFAULT '') STRICT;
CREATE INDEX job_unfinished ON job (priority DESC, sequence)
  WHERE state NOT IN ('succeeded', 'failed', 'canceled');
CREATE TABLE event (
  job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE, id INTEGER NOT NULL,
  type TEXT NOT NULL, data TEXT NOT NULL, PRIMARY KEY (job, id)) STRICT, WITHOUT ROWID;
CREATE TABLE result (
  job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE, position INTEGER NOT NULL,
  name TEXT NOT NULL, media_type TEXT NOT NULL, bytes INTEGER NOT NULL, sha256 TEXT NOT NULL,
  PRIMARY KEY (job, position)) STRICT, WITHOUT ROWID;
INSERT INTO job (id, state, attempt, version, scene, scene_bytes, settings, created_at)
  VALUES ('job_a', 'running', 1, 9, 's', 4, '{"solver":{"samples":17}}', '2026-01-01T00:00:00.000Z'),
         ('job_b', 'succeeded', 1, 9, 's', 4, '{}', '2026-01-01T00:00:00.000Z');
INSERT INTO event VALUES ('job_a', 1, 'job.state', '{}');
INSERT INTO result VALUES ('job_b', 0, 'page_00.exr', 'image/x-exr', 5, 'digest');
PRAGMA user_version=1;
)sql";

TEST(JobStore, TakesOverAStoreOfVersion1) {
  const test::TempFolder folder;
  const auto path = folder.path() / "jobs.db";
  run_sql(path, kStoreOfVersion1);
  for (int start = 0; start < 2; ++start) {  // the second finds it migrated
    JobStore store(path);
    const auto running = store.unfinished();
    ASSERT_EQ(running.size(), 1u);
    EXPECT_EQ(running[0].job.id, "job_a");
    EXPECT_EQ(running[0].job.settings.solver.samples, 17u);
    EXPECT_TRUE(running[0].job.labels.empty());
    EXPECT_EQ(running[0].job.ttl_seconds, 0u) << "kept for ever, as before";
    EXPECT_FALSE(running[0].job.cached);
    EXPECT_EQ(store.events_after("job_a", 0).size(), 1u);
    EXPECT_EQ(store.results("job_b").at(0).bytes, 5u);
    EXPECT_FALSE(store.find_succeeded("", "")) << "a job without a key is no one's twin";
    EXPECT_TRUE(store.writable());
  }
  JobStore store(path);
  StoredJob job = store.find("job_a").value();
  job.job.labels = {{"a", "b"}};
  store.save(job, {}, Database::Durability::kPromise);
  EXPECT_EQ(store.find("job_a")->job.labels, job.job.labels);
}

StoredJob insert_job(JobStore& store, const std::string& tenant) {
  StoredJob stored = new_job();
  stored.job.tenant = tenant;
  store.insert(stored, {{1, "job.state", R"({"state":"queued"})"}});
  return stored;
}

TEST(JobStore, FeedsHoldTheEventsOfAllJobsInOneOrder) {
  const test::TempFolder folder;
  JobStore store(folder.path() / "jobs.db");
  std::vector<std::pair<std::string, proto::Event>> told;
  store.on_feed([&](const std::string& tenant, const std::vector<proto::Event>& events) {
    for (const auto& event : events) told.emplace_back(tenant, event);
  });
  const StoredJob a = insert_job(store, "art"), g = insert_job(store, "game");
  store.save(a, {{2, "log", "{}"}, {3, "log", R"({"x":1})"}}, Database::Durability::kProgress);
  const auto feed = store.feed("art");
  ASSERT_EQ(feed.events.size(), 3u);
  EXPECT_EQ(feed.events[0].id, 1u);
  EXPECT_EQ(feed.events[0].data, "{\"job\":\"" + a.job.id + R"(","state":"queued"})");
  EXPECT_EQ(feed.events[1].data, "{\"job\":\"" + a.job.id + "\"}");
  EXPECT_EQ(feed.events[2].data, "{\"job\":\"" + a.job.id + R"(","x":1})");
  EXPECT_EQ(feed.floor, 0u);
  EXPECT_EQ(feed.last, 4u) << "of all tenants: ids are never given twice";
  const auto all = store.feed(std::nullopt);
  ASSERT_EQ(all.events.size(), 4u);
  ASSERT_EQ(told.size(), 4u);
  for (std::size_t i = 0; i < told.size(); ++i) {
    EXPECT_EQ(told[i].second.id, all.events[i].id);
    EXPECT_EQ(told[i].second.data, all.events[i].data);
  }
  EXPECT_EQ(told[1].first, "game");
  store.remove(a.job.id);
  EXPECT_TRUE(store.feed("art").events.empty());
  EXPECT_EQ(store.feed("art").last, 4u);
  EXPECT_EQ(store.feed("game").events.size(), 1u);
}

TEST(JobStore, FeedsForgetOldEventsAndSaySo) {
  const test::TempFolder folder;
  JobStore store(folder.path() / "jobs.db");
  const StoredJob a = insert_job(store, "art"), g = insert_job(store, "game");
  std::vector<proto::Event> events;
  for (std::uint64_t n = 2; n <= 1500; ++n) events.push_back({n, "job.progress", "{}"});
  events.push_back({1501, base::kJobEnd, "{}"});
  store.save(a, events, Database::Durability::kProgress);
  const auto feed = store.feed("art");
  EXPECT_EQ(feed.events.size(), base::EventRing::kCapacity);
  EXPECT_EQ(feed.events.back().id, 1502u) << "the other tenant had one";
  EXPECT_EQ(feed.floor, 1502 - base::EventRing::kCapacity);
  EXPECT_EQ(store.feed("game").events.size(), 1u) << "a busy tenant pushes no one's events out";
  EXPECT_EQ(store.feed("game").floor, 0u);
  const StoredJob b = insert_job(store, "art");
  store.remove(a.job.id);
  EXPECT_EQ(store.feed("art").events.size(), 1u);
  EXPECT_GE(store.feed("art").floor, 1502 - base::EventRing::kCapacity)
      << "what is gone stays gone";
}

TEST(EventRing, OfManyJobsGoesOnAfterAJobsEndAndOverHoles) {
  const auto ring = base::EventRing::endless(4, 20, {{7, "log", "{}"}, {20, base::kJobEnd, "{}"}});
  EXPECT_FALSE(ring->after(3).complete);
  EXPECT_TRUE(ring->after(4).complete);
  EXPECT_EQ(ring->after(8).events.size(), 1u);
  EXPECT_FALSE(ring->after(8).ended);
  ring->push({33, base::kJobEnd, "{}"});
  EXPECT_FALSE(ring->after(33).ended);
  for (std::uint64_t id = 40; id < 40 + 2 * base::EventRing::kCapacity; id += 2)
    ring->push({id, "log", "{}"});
  EXPECT_FALSE(ring->after(32).complete);
  EXPECT_TRUE(ring->after(33).complete) << "33 is gone, what comes after it is there";
  EXPECT_EQ(ring->after(33).events.front().id, 40u);
}

TEST(EventRing, HandsOutWhatComesAfterAnId) {
  base::EventRing ring;
  for (std::uint64_t id = 1; id <= 1500; ++id) ring.push({id, "job.progress", "{}"});
  EXPECT_FALSE(ring.after(0).complete) << "the first 476 are gone";
  EXPECT_FALSE(ring.after(475).complete);
  EXPECT_TRUE(ring.after(476).complete);
  EXPECT_EQ(ring.after(476).events.front().id, 477u);
  EXPECT_EQ(ring.after(1490, 4).events.size(), 4u);
  EXPECT_TRUE(ring.after(1500).events.empty());
  EXPECT_FALSE(ring.after(1501).complete) << "an id of the future";
  ring.push({1501, base::kJobEnd, "{}"});
  EXPECT_FALSE(ring.after(1490, 4).ended);
  EXPECT_TRUE(ring.after(1490).ended);
}

}  // namespace
}  // namespace kiln::store
