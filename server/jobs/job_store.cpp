#include "server/jobs/job_store.h"

#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/jobs/event_ring.h"

namespace kiln::server {
namespace {

using Durability = Database::Durability;

// Never edit an entry that was released: append the next.
constexpr const char* kMigrations[] = {
    R"sql(
CREATE TABLE job (
  sequence INTEGER PRIMARY KEY AUTOINCREMENT,
  id TEXT NOT NULL UNIQUE,
  state TEXT NOT NULL,
  priority INTEGER NOT NULL DEFAULT 0,
  attempt INTEGER NOT NULL,
  crashes INTEGER NOT NULL DEFAULT 0,
  version INTEGER NOT NULL,
  scene TEXT NOT NULL,
  scene_bytes INTEGER NOT NULL,
  settings TEXT NOT NULL,
  created_at TEXT NOT NULL,
  started_at TEXT NOT NULL DEFAULT '',
  finished_at TEXT NOT NULL DEFAULT '',
  stage TEXT NOT NULL DEFAULT '',
  pass INTEGER NOT NULL DEFAULT 0,
  max_passes INTEGER NOT NULL DEFAULT 0,
  batches_done INTEGER NOT NULL DEFAULT 0,
  batches_total INTEGER NOT NULL DEFAULT 0,
  residual REAL NOT NULL DEFAULT 1,
  fraction REAL NOT NULL DEFAULT 0,
  error TEXT NOT NULL DEFAULT ''
) STRICT;
CREATE INDEX job_unfinished ON job (priority DESC, sequence)
  WHERE state NOT IN ('succeeded', 'failed', 'canceled');
CREATE TABLE event (
  job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
  id INTEGER NOT NULL,
  type TEXT NOT NULL,
  data TEXT NOT NULL,
  PRIMARY KEY (job, id)
) STRICT, WITHOUT ROWID;
CREATE TABLE result (
  job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
  position INTEGER NOT NULL,
  name TEXT NOT NULL,
  media_type TEXT NOT NULL,
  bytes INTEGER NOT NULL,
  sha256 TEXT NOT NULL,
  PRIMARY KEY (job, position)
) STRICT, WITHOUT ROWID;
)sql",
    R"sql(
ALTER TABLE job ADD COLUMN bake_key TEXT NOT NULL DEFAULT '';
ALTER TABLE job ADD COLUMN labels TEXT NOT NULL DEFAULT '{}';
ALTER TABLE job ADD COLUMN ttl_seconds INTEGER NOT NULL DEFAULT 0;
ALTER TABLE job ADD COLUMN expires_at TEXT NOT NULL DEFAULT '';
ALTER TABLE job ADD COLUMN cached INTEGER NOT NULL DEFAULT 0;
CREATE INDEX job_scene ON job (scene);
CREATE INDEX job_succeeded ON job (bake_key, sequence) WHERE state = 'succeeded';
CREATE INDEX job_expires ON job (expires_at) WHERE expires_at <> '';
CREATE TABLE request (
  key TEXT NOT NULL PRIMARY KEY,
  fingerprint TEXT NOT NULL,
  job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE
) STRICT, WITHOUT ROWID;
CREATE INDEX request_job ON request (job);
)sql",
    R"sql(
ALTER TABLE job ADD COLUMN tenant TEXT NOT NULL DEFAULT '';
CREATE INDEX job_tenant ON job (tenant, sequence);
CREATE TABLE scene_owner (
  scene TEXT NOT NULL,
  tenant TEXT NOT NULL,
  PRIMARY KEY (scene, tenant)
) STRICT, WITHOUT ROWID;
)sql"};
static_assert(std::size(kMigrations) == JobStore::kSchemaVersion);

constexpr std::string_view kColumns =
    "SELECT sequence, id, state, priority, attempt, crashes, version, scene, scene_bytes, settings,"
    " created_at, started_at, finished_at, stage, pass, max_passes, batches_done, batches_total,"
    " residual, fraction, error, bake_key, labels, ttl_seconds, expires_at, cached, tenant"
    " FROM job ";
constexpr std::string_view kIsOver = "state IN ('succeeded', 'failed', 'canceled') ";

std::int64_t as_int(std::uint64_t value) {
  return static_cast<std::int64_t>(value);
}

void read_settings(const std::string& text, proto::Job& job) {
  auto settings = proto::parse_settings(text);
  if (settings) {
    job.settings = std::move(*settings);
  } else if (!job.error) {
    job.error = proto::Error{"internal", "The stored settings of this job can't be read.",
                             settings.error().details};
  }
}

void read_error(const std::string& text, proto::Job& job) {
  if (text.empty()) return;
  auto document = proto::parse_json(text, "store");
  auto error = document ? proto::error_from_json(*document) : tl::make_unexpected(document.error());
  job.error = error ? *error : error.error();
}

void read_labels(const std::string& text, proto::Job& job) {
  auto document = proto::parse_json(text, "store");
  auto labels =
      document ? proto::labels_from_json(*document) : tl::make_unexpected(document.error());
  if (labels) job.labels = std::move(*labels);
}

StoredJob read_row(const Statement& row) {
  StoredJob stored;
  proto::Job& job = stored.job;
  stored.sequence = row.number(0);
  job.id = row.text(1);
  job.state = proto::job_state_from_string(row.text(2)).value();
  job.priority = static_cast<std::int32_t>(row.number(3));
  job.attempt = static_cast<std::uint32_t>(row.number(4));
  stored.crashes = static_cast<std::uint32_t>(row.number(5));
  job.version = static_cast<std::uint64_t>(row.number(6));
  job.scene_sha256 = row.text(7);
  job.scene_bytes = static_cast<std::uint64_t>(row.number(8));
  job.created_at = row.text(10);
  job.started_at = row.text(11);
  job.finished_at = row.text(12);
  job.progress.stage = row.text(13);
  job.progress.pass = static_cast<std::uint32_t>(row.number(14));
  job.progress.max_passes = static_cast<std::uint32_t>(row.number(15));
  job.progress.batches_done = static_cast<std::uint32_t>(row.number(16));
  job.progress.batches_total = static_cast<std::uint32_t>(row.number(17));
  job.progress.residual = row.real(18);
  job.progress.fraction = row.real(19);
  read_error(row.text(20), job);
  read_settings(row.text(9), job);
  stored.bake_key = row.text(21);
  read_labels(row.text(22), job);
  job.ttl_seconds = static_cast<std::uint64_t>(row.number(23));
  job.expires_at = row.text(24);
  job.cached = row.number(25) != 0;
  job.tenant = row.text(26);
  return stored;
}

std::vector<StoredJob> read_all(Statement& rows) {
  std::vector<StoredJob> jobs;
  while (rows.step()) jobs.push_back(read_row(rows));
  return jobs;
}

}  // namespace

JobStore::JobStore(const std::filesystem::path& path, std::function<void(double)> on_commit)
    : writer_(path), reader_(path) {
  migrate();
  writer_.on_commit(std::move(on_commit));
}

void JobStore::migrate() {
  const std::int64_t version = [&] {
    auto query = writer_.prepare("PRAGMA user_version");
    query.step();
    return query.number(0);
  }();
  if (version > kSchemaVersion)
    throw DatabaseError("the job store was written by a later version of lightkiln (schema " +
                            std::to_string(version) + ", known: " + std::to_string(kSchemaVersion) +
                            ")",
                        false);
  for (std::int64_t next = version; next < kSchemaVersion; ++next)
    writer_.transaction(Durability::kPromise, [&] {
      writer_.run(kMigrations[next]);
      writer_.run("PRAGMA user_version=" + std::to_string(next + 1));
    });
}

std::int64_t JobStore::insert(const StoredJob& stored, const std::vector<proto::Event>& events,
                              const std::vector<proto::ResultFile>& files,
                              const std::optional<IdempotencyKey>& request) {
  const proto::Job& job = stored.job;
  const std::string settings = proto::to_json(job.settings).dump();
  std::int64_t sequence = 0;
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(Durability::kPromise, [&] {
    auto insert = writer_.prepare(
        "INSERT INTO job (id, state, attempt, version, scene, scene_bytes, settings, created_at,"
        " bake_key, cached, tenant) VALUES (?,?,?,?,?,?,?,?,?,?,?) RETURNING sequence");
    insert.bind(1, job.id).bind(2, proto::to_string(job.state)).bind(3, as_int(job.attempt));
    insert.bind(4, as_int(job.version)).bind(5, job.scene_sha256).bind(6, as_int(job.scene_bytes));
    insert.bind(7, settings).bind(8, job.created_at).bind(9, stored.bake_key);
    insert.bind(10, std::int64_t{job.cached}).bind(11, job.tenant);
    while (insert.step()) sequence = insert.number(0);
    update(stored);
    put_events(job.id, events);
    put_results(job.id, files);
    if (!request) return;
    auto remember = writer_.prepare("INSERT INTO request (key, fingerprint, job) VALUES (?,?,?)");
    remember.bind(1, request->key).bind(2, request->fingerprint).bind(3, job.id).step();
  });
  return sequence;
}

void JobStore::put_events(const std::string& id, const std::vector<proto::Event>& events) {
  for (const auto& event : events) {
    auto insert = writer_.prepare("INSERT INTO event (job, id, type, data) VALUES (?,?,?,?)");
    insert.bind(1, id).bind(2, as_int(event.id)).bind(3, event.type).bind(4, event.data).step();
    if (event.id <= EventRing::kCapacity || event.id % 64 != 0) continue;
    auto prune = writer_.prepare("DELETE FROM event WHERE job=? AND id<=?");
    prune.bind(1, id).bind(2, as_int(event.id - EventRing::kCapacity)).step();
  }
}

void JobStore::update(const StoredJob& stored) {
  const proto::Job& job = stored.job;
  auto update = writer_.prepare(
      "UPDATE job SET state=?, priority=?, attempt=?, crashes=?, version=?, started_at=?,"
      " finished_at=?, stage=?, pass=?, max_passes=?, batches_done=?, batches_total=?, residual=?,"
      " fraction=?, error=?, labels=?, ttl_seconds=?, expires_at=? WHERE id=?");
  update.bind(1, proto::to_string(job.state)).bind(2, std::int64_t{job.priority});
  update.bind(3, as_int(job.attempt)).bind(4, as_int(stored.crashes));
  update.bind(5, as_int(job.version)).bind(6, job.started_at).bind(7, job.finished_at);
  update.bind(8, job.progress.stage).bind(9, as_int(job.progress.pass));
  update.bind(10, as_int(job.progress.max_passes)).bind(11, as_int(job.progress.batches_done));
  update.bind(12, as_int(job.progress.batches_total)).bind(13, job.progress.residual);
  update.bind(14, job.progress.fraction);
  update.bind(15, job.error ? proto::to_json(*job.error).dump() : std::string());
  update.bind(16, proto::to_text(job.labels)).bind(17, as_int(job.ttl_seconds));
  update.bind(18, job.expires_at).bind(19, job.id).step();
}

void JobStore::save(const StoredJob& stored, const std::vector<proto::Event>& events,
                    Durability durability) {
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(durability, [&] {
    update(stored);
    put_events(stored.job.id, events);
  });
}

void JobStore::finish(const StoredJob& stored, const std::vector<proto::Event>& events,
                      const std::vector<proto::ResultFile>& files) {
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(Durability::kPromise, [&] {
    update(stored);
    put_events(stored.job.id, events);
    put_results(stored.job.id, files);
  });
}

void JobStore::put_results(const std::string& id, const std::vector<proto::ResultFile>& files) {
  std::int64_t position = 0;
  for (const auto& file : files) {
    auto insert = writer_.prepare("INSERT INTO result VALUES (?,?,?,?,?,?)");
    insert.bind(1, id).bind(2, position++).bind(3, file.name);
    insert.bind(4, file.media_type).bind(5, as_int(file.bytes)).bind(6, file.sha256).step();
  }
}

void JobStore::restart(const StoredJob& stored, const std::vector<proto::Event>& events) {
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(Durability::kPromise, [&] {
    update(stored);
    put_events(stored.job.id, events);
    writer_.prepare("DELETE FROM result WHERE job=?").bind(1, stored.job.id).step();
  });
}

void JobStore::remove(const std::string& id) {
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(Durability::kPromise,
                      [&] { writer_.prepare("DELETE FROM job WHERE id=?").bind(1, id).step(); });
}

std::optional<StoredJob> JobStore::find(const std::string& id) const {
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare(std::string(kColumns) + "WHERE id=?");
  query.bind(1, id);
  if (!query.step()) return std::nullopt;
  return read_row(query);
}

std::vector<StoredJob> JobStore::list(const JobFilter& filter) const {
  std::string sql = std::string(kColumns) + "WHERE (?1='' OR state=?1) AND (?2<0 OR sequence<?2) ";
  if (filter.tenant) sql += "AND tenant=?4 ";
  for (std::size_t i = 0; i < filter.labels.size(); ++i)
    sql += "AND EXISTS (SELECT 1 FROM json_each(job.labels) WHERE key=?" +
           std::to_string(5 + 2 * i) + " AND value=?" + std::to_string(6 + 2 * i) + ") ";
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare(sql + "ORDER BY sequence DESC LIMIT ?3");
  query.bind(1, filter.state ? proto::to_string(*filter.state) : "");
  query.bind(2, filter.before.value_or(-1)).bind(3, as_int(filter.limit));
  if (filter.tenant) query.bind(4, *filter.tenant);
  int next = 5;
  for (const auto& [name, value] : filter.labels) {
    query.bind(next++, name);
    query.bind(next++, value);
  }
  return read_all(query);
}

std::optional<StoredJob> JobStore::find_succeeded(const std::string& bake_key,
                                                  const std::string& tenant) const {
  const std::lock_guard lock(read_mutex_);
  auto query =
      reader_.prepare(std::string(kColumns) +
                      "WHERE state='succeeded' AND bake_key=? AND bake_key<>'' AND tenant=?"
                      " ORDER BY sequence DESC LIMIT 1");
  query.bind(1, bake_key).bind(2, tenant);
  if (!query.step()) return std::nullopt;
  return read_row(query);
}

std::uint64_t JobStore::result_bytes(const std::string& tenant) const {
  const std::lock_guard lock(read_mutex_);
  auto query =
      reader_.prepare("SELECT sum(bytes) FROM result JOIN job ON job.id=result.job WHERE tenant=?");
  query.bind(1, tenant);
  query.step();
  return static_cast<std::uint64_t>(query.number(0));
}

void JobStore::grant_scene(const std::string& scene, const std::string& tenant) {
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(Durability::kPromise, [&] {
    auto insert = writer_.prepare("INSERT OR IGNORE INTO scene_owner (scene, tenant) VALUES (?,?)");
    insert.bind(1, scene).bind(2, tenant).step();
  });
}

bool JobStore::owns_scene(const std::string& scene, const std::string& tenant) const {
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare("SELECT 1 FROM scene_owner WHERE scene=? AND tenant=?");
  query.bind(1, scene).bind(2, tenant);
  return query.step();
}

void JobStore::forget_scene(const std::string& scene) {
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(Durability::kProgress, [&] {
    writer_.prepare("DELETE FROM scene_owner WHERE scene=?").bind(1, scene).step();
  });
}

std::optional<std::pair<std::string, std::string>> JobStore::find_request(
    const std::string& key) const {
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare("SELECT fingerprint, job FROM request WHERE key=?");
  query.bind(1, key);
  if (!query.step()) return std::nullopt;
  return std::pair(query.text(0), query.text(1));
}

bool JobStore::names_scene(const std::string& scene) const {
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare("SELECT 1 FROM job WHERE scene=? LIMIT 1");
  query.bind(1, scene);
  return query.step();
}

std::vector<std::string> JobStore::expired(const std::string& now) const {
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare("SELECT id FROM job WHERE expires_at<>'' AND expires_at<=?");
  query.bind(1, now);
  std::vector<std::string> ids;
  while (query.step()) ids.push_back(query.text(0));
  return ids;
}

std::vector<std::string> JobStore::oldest_over(std::uint32_t limit) const {
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare("SELECT id FROM job WHERE " + std::string(kIsOver) +
                               "ORDER BY finished_at, sequence LIMIT ?");
  query.bind(1, as_int(limit));
  std::vector<std::string> ids;
  while (query.step()) ids.push_back(query.text(0));
  return ids;
}

std::vector<StoredJob> JobStore::unfinished() const {
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare(std::string(kColumns) +
                               "WHERE state NOT IN ('succeeded', 'failed', 'canceled')"
                               " ORDER BY sequence");
  return read_all(query);
}

std::vector<proto::Event> JobStore::events_after(const std::string& id, std::uint64_t after) const {
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare("SELECT id, type, data FROM event WHERE job=? AND id>? ORDER BY id");
  query.bind(1, id).bind(2, as_int(after));
  std::vector<proto::Event> events;
  while (query.step())
    events.push_back({static_cast<std::uint64_t>(query.number(0)), query.text(1), query.text(2)});
  return events;
}

std::vector<proto::ResultFile> JobStore::results(const std::string& id) const {
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare(
      "SELECT name, media_type, bytes, sha256 FROM result WHERE job=? ORDER BY position");
  query.bind(1, id);
  std::vector<proto::ResultFile> files;
  while (query.step())
    files.push_back(
        {query.text(0), query.text(1), static_cast<std::uint64_t>(query.number(2)), query.text(3)});
  return files;
}

bool JobStore::writable() {
  const std::lock_guard lock(write_mutex_);
  try {
    // Rewrites the version with itself: a real write that changes nothing.
    writer_.transaction(Durability::kProgress, [&] {
      writer_.run("PRAGMA user_version=" + std::to_string(kSchemaVersion));
    });
    return true;
  } catch (const DatabaseError&) {
    return false;
  }
}

}  // namespace kiln::server
