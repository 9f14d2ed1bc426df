#include "server/base/clock.h"
#include "server/store/job_store.h"
#include "server/store/rows.h"

/// The usage of tenants, for their quotas.
namespace kiln::store {

void JobStore::add_usage(const std::string& tenant, const std::string& day, const Usage& more) {
  constexpr std::chrono::hours kKept{24 * 62};
  const std::lock_guard lock(write_mutex_);
  writer_.transaction(Database::Durability::kProgress, [&] {
    auto add = writer_.prepare(
        "INSERT INTO usage (tenant, day, texels, cpu_seconds) VALUES (?,?,?,?) ON CONFLICT DO"
        " UPDATE SET texels=texels+excluded.texels, cpu_seconds=cpu_seconds+excluded.cpu_seconds");
    add.bind(1, tenant).bind(2, day).bind(3, as_int(more.texels)).bind(4, more.cpu_seconds).step();
    auto forget = writer_.prepare("DELETE FROM usage WHERE tenant=? AND day<?");
    forget.bind(1, tenant).bind(2, base::today(-kKept)).step();
  });
}

Usage JobStore::usage(const std::string& tenant, const std::string& day) const {
  const std::lock_guard lock(read_mutex_);
  auto query = reader_.prepare("SELECT texels, cpu_seconds FROM usage WHERE tenant=? AND day=?");
  query.bind(1, tenant).bind(2, day);
  if (!query.step()) return {};
  return {static_cast<std::uint64_t>(query.number(0)), query.real(1)};
}

}  // namespace kiln::store
