#include "server/store/job_store.h"

#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/base/event_ring.h"
#include "server/store/rows.h"
#include "server/store/schema.h"

/// The store's writes, by its writer connection.
namespace kiln::store {
namespace {

using Durability = Database::Durability;

}  // namespace

JobStore::JobStore(const std::filesystem::path& path, std::function<void(double)> on_commit)
    : writer_(path), reader_(path) {
  migrate_job_store(writer_);
  writer_.on_commit(std::move(on_commit));
}

std::int64_t JobStore::insert(const StoredJob& stored, const std::vector<proto::Event>& events,
                              const std::vector<proto::ResultFile>& files,
                              const std::optional<IdempotencyKey>& request) {
  const proto::Job& job = stored.job;
  const std::string settings = proto::to_json(job.settings).dump();
  std::int64_t sequence = 0;
  write(job.tenant, Durability::kPromise, [&] {
    auto insert = writer_.prepare(
        "INSERT INTO job (id, state, attempt, version, scene, scene_bytes, settings, created_at,"
        " bake_key, cached, tenant, webhook) VALUES (?,?,?,?,?,?,?,?,?,?,?,?) RETURNING sequence");
    insert.bind(1, job.id).bind(2, proto::to_string(job.state)).bind(3, as_int(job.attempt));
    insert.bind(4, as_int(job.version)).bind(5, job.scene_sha256).bind(6, as_int(job.scene_bytes));
    insert.bind(7, settings).bind(8, job.created_at).bind(9, stored.bake_key);
    insert.bind(10, std::int64_t{job.cached}).bind(11, job.tenant);
    insert.bind(12, job.webhook ? proto::to_text(proto::to_json(*job.webhook)) : std::string());
    while (insert.step()) sequence = insert.number(0);
    update(stored);
    put_events(job, events);
    put_results(job.id, files);
    if (!request) return;
    auto remember = writer_.prepare("INSERT INTO request (key, fingerprint, job) VALUES (?,?,?)");
    remember.bind(1, request->key).bind(2, request->fingerprint).bind(3, job.id).step();
  });
  return sequence;
}

void JobStore::write(const std::string& tenant, Durability durability,
                     const std::function<void()>& body) {
  std::function<void()> delivered;
  {
    const std::lock_guard lock(write_mutex_);
    fresh_.clear();
    new_deliveries_ = false;
    writer_.transaction(durability, body);
    // Under the lock, so that the feed's order is that of its ids.
    if (feed_hook_ && !fresh_.empty()) feed_hook_(tenant, fresh_);
    if (new_deliveries_) delivered = delivery_hook_;
  }
  if (delivered) delivered();
}

void JobStore::put_events(const proto::Job& job, const std::vector<proto::Event>& events) {
  const std::string& id = job.id;
  for (const auto& event : events) {
    auto insert = writer_.prepare("INSERT INTO event (job, id, type, data) VALUES (?,?,?,?)");
    insert.bind(1, id).bind(2, as_int(event.id)).bind(3, event.type).bind(4, event.data).step();
    put_feed(job, event);
    put_delivery(job, event);
    if (event.id <= base::EventRing::kCapacity || event.id % 64 != 0) continue;
    auto prune = writer_.prepare("DELETE FROM event WHERE job=? AND id<=?");
    prune.bind(1, id).bind(2, as_int(event.id - base::EventRing::kCapacity)).step();
  }
}

void JobStore::update(const StoredJob& stored) {
  const proto::Job& job = stored.job;
  auto update = writer_.prepare(
      "UPDATE job SET state=?, priority=?, attempt=?, crashes=?, version=?, started_at=?,"
      " finished_at=?, stage=?, pass=?, max_passes=?, batches_done=?, batches_total=?, residual=?,"
      " fraction=?, error=?, labels=?, ttl_seconds=?, expires_at=?, memory_estimate=? WHERE id=?");
  update.bind(1, proto::to_string(job.state)).bind(2, std::int64_t{job.priority});
  update.bind(3, as_int(job.attempt)).bind(4, as_int(stored.crashes));
  update.bind(5, as_int(job.version)).bind(6, job.started_at).bind(7, job.finished_at);
  update.bind(8, job.progress.stage).bind(9, as_int(job.progress.pass));
  update.bind(10, as_int(job.progress.max_passes)).bind(11, as_int(job.progress.batches_done));
  update.bind(12, as_int(job.progress.batches_total)).bind(13, job.progress.residual);
  update.bind(14, job.progress.fraction);
  update.bind(15, job.error ? proto::to_json(*job.error).dump() : std::string());
  update.bind(16, proto::to_text(job.labels)).bind(17, as_int(job.ttl_seconds));
  update.bind(18, job.expires_at).bind(19, as_int(job.memory_estimate_bytes));
  update.bind(20, job.id).step();
}

void JobStore::save(const StoredJob& stored, const std::vector<proto::Event>& events,
                    Durability durability) {
  write(stored.job.tenant, durability, [&] {
    update(stored);
    put_events(stored.job, events);
  });
}

void JobStore::finish(const StoredJob& stored, const std::vector<proto::Event>& events,
                      const std::vector<proto::ResultFile>& files) {
  write(stored.job.tenant, Durability::kPromise, [&] {
    update(stored);
    put_events(stored.job, events);
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
  write(stored.job.tenant, Durability::kPromise, [&] {
    update(stored);
    put_events(stored.job, events);
    writer_.prepare("DELETE FROM result WHERE job=?").bind(1, stored.job.id).step();
  });
}

void JobStore::remove(const std::string& id) {
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(Durability::kPromise,
                      [&] { writer_.prepare("DELETE FROM job WHERE id=?").bind(1, id).step(); });
}

void JobStore::grant_scene(const std::string& scene, const std::string& tenant) {
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(Durability::kPromise, [&] {
    auto insert = writer_.prepare("INSERT OR IGNORE INTO scene_owner (scene, tenant) VALUES (?,?)");
    insert.bind(1, scene).bind(2, tenant).step();
  });
}

void JobStore::forget_scene(const std::string& scene) {
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(Durability::kProgress, [&] {
    writer_.prepare("DELETE FROM scene_owner WHERE scene=?").bind(1, scene).step();
  });
}

bool JobStore::writable() {
  const std::lock_guard lock(write_mutex_);
  try {
    // Rewrites the version with itself: a real write that changes nothing.
    writer_.transaction(Durability::kProgress, [&] {
      writer_.run("PRAGMA user_version=" + std::to_string(kJobSchemaVersion));
    });
    return true;
  } catch (const DatabaseError&) {
    return false;
  }
}

}  // namespace kiln::store
