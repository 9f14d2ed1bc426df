#include "server/store/schema.h"

#include <iterator>
#include <string>

namespace kiln::store {
namespace {

// Never edit an entry that was released: append the next.
constexpr const char* kJobMigrations[] = {
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
)sql",
    R"sql(
CREATE TABLE feed (
  sequence INTEGER PRIMARY KEY AUTOINCREMENT,
  tenant TEXT NOT NULL,
  job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
  event INTEGER NOT NULL
) STRICT;
CREATE INDEX feed_tenant ON feed (tenant, sequence);
CREATE INDEX feed_job ON feed (job);
CREATE TABLE feed_floor (
  tenant TEXT NOT NULL PRIMARY KEY,
  sequence INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
)sql",
    R"sql(
ALTER TABLE job ADD COLUMN webhook TEXT NOT NULL DEFAULT '';
CREATE TABLE delivery (
  id TEXT NOT NULL PRIMARY KEY,
  tenant TEXT NOT NULL,
  url TEXT NOT NULL,
  origin TEXT NOT NULL,
  secret_ref TEXT NOT NULL,
  body TEXT NOT NULL,
  tries INTEGER NOT NULL DEFAULT 0,
  claimed INTEGER NOT NULL DEFAULT 0,
  due_ms INTEGER NOT NULL
) STRICT;
CREATE INDEX delivery_due ON delivery (due_ms);
)sql",
    R"sql(
CREATE TABLE usage (
  tenant TEXT NOT NULL,
  day TEXT NOT NULL,
  texels INTEGER NOT NULL,
  cpu_seconds REAL NOT NULL,
  PRIMARY KEY (tenant, day)
) STRICT, WITHOUT ROWID;
)sql",
    R"sql(
ALTER TABLE job ADD COLUMN memory_estimate INTEGER NOT NULL DEFAULT 0;
)sql"};
static_assert(std::size(kJobMigrations) == kJobSchemaVersion);

}  // namespace

void migrate_job_store(Database& database) {
  const std::int64_t version = [&] {
    auto query = database.prepare("PRAGMA user_version");
    query.step();
    return query.number(0);
  }();
  if (version > kJobSchemaVersion)
    throw DatabaseError("the job store was written by a later version of lightkiln (schema " +
                            std::to_string(version) +
                            ", known: " + std::to_string(kJobSchemaVersion) + ")",
                        false);
  for (std::int64_t next = version; next < kJobSchemaVersion; ++next)
    database.transaction(Database::Durability::kPromise, [&] {
      database.run(kJobMigrations[next]);
      database.run("PRAGMA user_version=" + std::to_string(next + 1));
    });
}

}  // namespace kiln::store
