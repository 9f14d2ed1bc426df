#include <algorithm>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/base/clock.h"
#include "server/base/ids.h"
#include "server/store/job_store.h"
#include "server/store/rows.h"

/// Messages to webhooks that are not delivered yet.
namespace kiln::store {
namespace {

// Scheme, host and port as the URL writes them: what shares a receiver.
std::string origin_of(const std::string& url) {
  const auto host = url.find("://");
  std::string origin =
      url.substr(0, url.find_first_of("/?#", host == std::string::npos ? 0 : host + 3));
  std::transform(origin.begin(), origin.end(), origin.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
  return origin;
}

}  // namespace

void JobStore::put_delivery(const proto::Job& job, const proto::Event& event) {
  if (!job.webhook || !job.webhook->wants(event.type)) return;
  const std::string body = "{\"type\":\"" + event.type + "\",\"timestamp\":\"" +
                           base::now_rfc3339() + "\",\"data\":" + with_job(job.id, event.data) +
                           "}";
  auto insert = writer_.prepare(
      "INSERT INTO delivery (id, tenant, url, origin, secret_ref, body, due_ms)"
      " VALUES (?,?,?,?,?,?,0)");
  insert.bind(1, base::new_id("msg_")).bind(2, job.tenant).bind(3, job.webhook->url);
  insert.bind(4, origin_of(job.webhook->url)).bind(5, job.webhook->secret_ref).bind(6, body).step();
  new_deliveries_ = true;
}

std::optional<Delivery> JobStore::claim_delivery(std::int64_t now, std::int64_t horizon,
                                                 std::int64_t until,
                                                 const std::vector<std::string>& busy) {
  // Most of the time there is nothing: a look costs no write.
  if (const auto next = next_delivery(); !next || (*next > now && *next <= horizon)) return {};
  std::string others;
  for (std::size_t i = 0; i < busy.size(); ++i)
    others += (i > 0 ? ",?" : "?") + std::to_string(i + 4);
  std::optional<Delivery> found;
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(Database::Durability::kProgress, [&] {
    auto claim = writer_.prepare(
        "UPDATE delivery SET due_ms=?3, claimed=1 WHERE id=(SELECT id FROM delivery WHERE "
        "(due_ms<=?1 OR"
        " due_ms>?2) AND origin NOT IN (" +
        others +
        ") ORDER BY due_ms, id LIMIT 1)"
        " RETURNING id, tenant, url, origin, secret_ref, body, tries");
    claim.bind(1, now).bind(2, horizon).bind(3, until);
    for (std::size_t i = 0; i < busy.size(); ++i) claim.bind(static_cast<int>(i) + 4, busy[i]);
    while (claim.step())
      found = Delivery{claim.text(0),
                       claim.text(1),
                       claim.text(2),
                       claim.text(3),
                       claim.text(4),
                       claim.text(5),
                       static_cast<std::uint32_t>(claim.number(6))};
  });
  return found;
}

void JobStore::release_deliveries() {
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(Database::Durability::kProgress, [&] {
    writer_.run("UPDATE delivery SET due_ms=0, claimed=0 WHERE claimed=1");
  });
}

std::optional<std::int64_t> JobStore::next_delivery() const {
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare("SELECT due_ms FROM delivery ORDER BY due_ms LIMIT 1");
  if (!query.step()) return std::nullopt;
  return query.number(0);
}

std::uint64_t JobStore::deliveries() const {
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare("SELECT count(*) FROM delivery");
  query.step();
  return static_cast<std::uint64_t>(query.number(0));
}

void JobStore::postpone_delivery(const std::string& id, std::uint32_t tries, std::int64_t due_ms) {
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(Database::Durability::kProgress, [&] {
    auto update = writer_.prepare("UPDATE delivery SET tries=?, due_ms=?, claimed=0 WHERE id=?");
    update.bind(1, as_int(tries)).bind(2, due_ms).bind(3, id).step();
  });
}

void JobStore::forget_delivery(const std::string& id) {
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(Database::Durability::kProgress, [&] {
    writer_.prepare("DELETE FROM delivery WHERE id=?").bind(1, id).step();
  });
}

}  // namespace kiln::store
