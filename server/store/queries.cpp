#include "server/store/job_store.h"
#include "server/store/rows.h"

/// The store's reads, by its reader connection.
namespace kiln::store {

std::optional<StoredJob> JobStore::find(const std::string& id) const {
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare(std::string(kJobColumns) + "WHERE id=?");
  query.bind(1, id);
  if (!query.step()) return std::nullopt;
  return read_job_row(query);
}

std::vector<StoredJob> JobStore::list(const JobFilter& filter) const {
  std::string sql =
      std::string(kJobColumns) + "WHERE (?1='' OR state=?1) AND (?2<0 OR sequence<?2) ";
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
  return read_job_rows(query);
}

std::optional<StoredJob> JobStore::find_succeeded(const std::string& bake_key,
                                                  const std::string& tenant) const {
  const std::lock_guard lock(read_mutex_);
  auto query =
      reader_.prepare(std::string(kJobColumns) +
                      "WHERE state='succeeded' AND bake_key=? AND bake_key<>'' AND tenant=?"
                      " ORDER BY sequence DESC LIMIT 1");
  query.bind(1, bake_key).bind(2, tenant);
  if (!query.step()) return std::nullopt;
  return read_job_row(query);
}

std::uint64_t JobStore::result_bytes(const std::string& tenant) const {
  const std::lock_guard lock(read_mutex_);
  auto query =
      reader_.prepare("SELECT sum(bytes) FROM result JOIN job ON job.id=result.job WHERE tenant=?");
  query.bind(1, tenant);
  query.step();
  return static_cast<std::uint64_t>(query.number(0));
}

bool JobStore::owns_scene(const std::string& scene, const std::string& tenant) const {
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare("SELECT 1 FROM scene_owner WHERE scene=? AND tenant=?");
  query.bind(1, scene).bind(2, tenant);
  return query.step();
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
  auto query = reader_.prepare(std::string(kJobColumns) +
                               "WHERE state NOT IN ('succeeded', 'failed', 'canceled')"
                               " ORDER BY sequence");
  return read_job_rows(query);
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

}  // namespace kiln::store
