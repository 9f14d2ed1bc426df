#include <algorithm>

#include "server/base/event_ring.h"
#include "server/store/job_store.h"
#include "server/store/rows.h"

/// The events of all jobs in one order. A row of `feed` names an event of a job; of each tenant the
/// newest EventRing::kCapacity are kept, whose events no job has forgotten yet.
namespace kiln::store {

std::string with_job(const std::string& id, const std::string& data) {
  const bool empty = data.size() <= 2;
  return "{\"job\":\"" + id + (empty ? "\"}" : "\"," + data.substr(1));
}

void JobStore::put_feed(const proto::Job& job, const proto::Event& event) {
  auto insert =
      writer_.prepare("INSERT INTO feed (tenant, job, event) VALUES (?,?,?) RETURNING sequence");
  insert.bind(1, job.tenant).bind(2, job.id).bind(3, as_int(event.id));
  while (insert.step())
    fresh_.push_back(
        {static_cast<std::uint64_t>(insert.number(0)), event.type, with_job(job.id, event.data)});
  if (event.id % 64 == 0 || event.type == base::kJobEnd) prune_feed(job.tenant);
}

void JobStore::prune_feed(const std::string& tenant) {
  auto query = writer_.prepare(
      "SELECT sequence FROM feed WHERE tenant=? ORDER BY sequence DESC LIMIT 1 OFFSET ?");
  query.bind(1, tenant).bind(2, as_int(base::EventRing::kCapacity));
  if (!query.step()) return;
  const std::int64_t floor = query.number(0);
  writer_.prepare("DELETE FROM feed WHERE tenant=? AND sequence<=?")
      .bind(1, tenant)
      .bind(2, floor)
      .step();
  writer_.prepare("INSERT OR REPLACE INTO feed_floor (tenant, sequence) VALUES (?,?)")
      .bind(1, tenant)
      .bind(2, floor)
      .step();
}

Feed JobStore::feed(const std::optional<std::string>& tenant) const {
  const std::string where = tenant ? "WHERE tenant=?2 " : "";
  const std::lock_guard lock(read_mutex_);
  Feed feed;
  reader_.run("BEGIN");  // what follows is of one moment
  try {
    auto floor = reader_.prepare("SELECT max(sequence), ?1 FROM feed_floor " + where);
    floor.bind(1, std::int64_t{0});
    if (tenant) floor.bind(2, *tenant);
    if (floor.step()) feed.floor = static_cast<std::uint64_t>(floor.number(0));
    auto last = reader_.prepare("SELECT seq FROM sqlite_sequence WHERE name='feed'");
    if (last.step()) feed.last = static_cast<std::uint64_t>(last.number(0));
    auto rows = reader_.prepare(
        "SELECT f.sequence, f.job, event.type, event.data FROM (SELECT * FROM feed " + where +
        "ORDER BY sequence DESC LIMIT ?1) AS f JOIN event ON event.job=f.job AND event.id=f.event "
        "ORDER BY f.sequence");
    rows.bind(1, as_int(base::EventRing::kCapacity));
    if (tenant) rows.bind(2, *tenant);
    while (rows.step())
      feed.events.push_back({static_cast<std::uint64_t>(rows.number(0)), rows.text(2),
                             with_job(rows.text(1), rows.text(3))});
  } catch (...) {
    reader_.run("COMMIT");
    throw;
  }
  reader_.run("COMMIT");
  if (feed.events.size() >= base::EventRing::kCapacity)
    feed.floor = std::max(feed.floor, feed.events.front().id - 1);
  return feed;
}

}  // namespace kiln::store
