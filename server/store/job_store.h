#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "proto/event.h"
#include "proto/job.h"
#include "proto/manifest.h"
#include "server/store/database.h"

namespace kiln::store {

/// A job as stored, with what only the server knows of it.
struct StoredJob {
  proto::Job job;
  std::int64_t sequence = 0;  ///< order of submission
  std::uint32_t crashes = 0;  ///< attempts in a row that ended with the process, no pass done
  std::string bake_key;       ///< baker::bake_key()
};

/// A client's name for a request that made a job.
struct IdempotencyKey {
  std::string key;          ///< with the tenant's name before it
  std::string fingerprint;  ///< of what the request asked for
};

struct JobFilter {
  std::optional<std::string> tenant;  ///< nothing: of all
  std::optional<proto::JobState> state;
  std::vector<std::pair<std::string, std::string>> labels;  ///< all of them: name, value
  std::uint32_t limit = 50;
  std::optional<std::int64_t> before;  ///< sequence: only older jobs
};

/// The newest events of all jobs of a tenant, by their place in the order of all events.
struct Feed {
  std::vector<proto::Event> events;  ///< oldest first; `data` names the job
  std::uint64_t floor = 0;           ///< no event after this one is missing, but of deleted jobs
  std::uint64_t last = 0;            ///< the highest id ever given to any tenant
};

/// A message to a webhook.
struct Delivery {
  std::string id;  ///< msg_..., the same at every try
  std::string tenant, url, origin, secret_ref, body;
  std::uint32_t tries = 0;  ///< that failed
};

/// The work of a tenant's bakes in a day.
struct Usage {
  std::uint64_t texels = 0;
  double cpu_seconds = 0;
};

/// Jobs, their events and results in SQLite. One writer and one reader connection, each behind its
/// mutex. Throws DatabaseError.
class JobStore {
 public:
  /// Opens or creates the file and migrates its schema. Throws when it was written by a later
  /// version.
  /// `on_commit` is called with the seconds that each write took.
  explicit JobStore(const std::filesystem::path&, std::function<void(double)> on_commit = {});

  /// Stores a new job with its events, its result files when it is over already, and the key of the
  /// request; on the disk when it returns. Returns its sequence.
  std::int64_t insert(const StoredJob&, const std::vector<proto::Event>&,
                      const std::vector<proto::ResultFile>& = {},
                      const std::optional<IdempotencyKey>& = {});
  /// Stores the job's new state and the events of the change in one transaction.
  void save(const StoredJob&, const std::vector<proto::Event>&, Database::Durability);
  /// The last change of a job: terminal state, events and result files. On the disk when it
  /// returns.
  void finish(const StoredJob&, const std::vector<proto::Event>&,
              const std::vector<proto::ResultFile>&);
  /// A job that was over is queued again: its result files are forgotten. On the disk when it
  /// returns.
  void restart(const StoredJob&, const std::vector<proto::Event>&);
  void remove(const std::string& id);

  /// Is called with each event right after it was stored, with its id in the feed, in the order of
  /// these ids; must not write to the store. It is set before the first change.
  using FeedHook = std::function<void(const std::string& tenant, const std::vector<proto::Event>&)>;
  void on_feed(FeedHook hook) { feed_hook_ = std::move(hook); }
  Feed feed(const std::optional<std::string>& tenant) const;  ///< nothing: of all tenants

  /// Events that a job's webhook wants are stored with a message to it, in one transaction. `hook`
  /// is called after such a transaction, with no lock held.
  void on_delivery(std::function<void()> hook) { delivery_hook_ = std::move(hook); }
  /// The message that is due first, but to none of these origins; it is not due again before
  /// `until`. Times are Unix milliseconds; due is what is at `now` or earlier, or after `horizon`.
  std::optional<Delivery> claim_delivery(std::int64_t now, std::int64_t horizon, std::int64_t until,
                                         const std::vector<std::string>& busy);
  void release_deliveries();  ///< what an earlier process had claimed is due
  std::optional<std::int64_t> next_delivery() const;  ///< when the first one is due
  std::uint64_t deliveries() const;                   ///< that are not delivered
  void postpone_delivery(const std::string& id, std::uint32_t tries, std::int64_t due_ms);
  void forget_delivery(const std::string& id);

  std::optional<StoredJob> find(const std::string& id) const;
  std::vector<StoredJob> list(const JobFilter&) const;  ///< newest first
  std::vector<StoredJob> unfinished() const;            ///< oldest first
  /// The tenant's newest job with this key that succeeded.
  std::optional<StoredJob> find_succeeded(const std::string& bake_key,
                                          const std::string& tenant) const;
  std::uint64_t result_bytes(const std::string& tenant) const;
  /// The tenant uploaded this scene, and may name it: others must not learn that it is there.
  void grant_scene(const std::string& scene, const std::string& tenant);
  bool owns_scene(const std::string& scene, const std::string& tenant) const;
  void forget_scene(const std::string& scene);  ///< it was deleted
  /// The fingerprint and job id of a request.
  std::optional<std::pair<std::string, std::string>> find_request(const std::string& key) const;
  bool names_scene(const std::string& scene) const;                 ///< any job does
  std::vector<std::string> expired(const std::string& now) const;   ///< ids; RFC 3339
  std::vector<std::string> oldest_over(std::uint32_t limit) const;  ///< ids of jobs that are over
  std::vector<proto::Event> events_after(const std::string& id, std::uint64_t after) const;
  std::vector<proto::ResultFile> results(const std::string& id) const;

  /// `day`: "2026-11-22". Adding forgets days that are long over.
  void add_usage(const std::string& tenant, const std::string& day, const Usage&);
  Usage usage(const std::string& tenant, const std::string& day) const;

  bool writable();  ///< whether a transaction can be written now

 private:
  /// Runs `body` in a transaction, then tells the feed hook of the events that it put.
  void write(const std::string& tenant, Database::Durability, const std::function<void()>& body);
  void put_events(const proto::Job&, const std::vector<proto::Event>&);
  void put_feed(const proto::Job&, const proto::Event&);
  void prune_feed(const std::string& tenant);
  void put_delivery(const proto::Job&, const proto::Event&);
  void put_results(const std::string& id, const std::vector<proto::ResultFile>&);
  void update(const StoredJob&);

  std::mutex write_mutex_;
  Database writer_;
  std::vector<proto::Event> fresh_;  ///< of this transaction, for the hook
  FeedHook feed_hook_;
  bool new_deliveries_ = false;  ///< of this transaction
  std::function<void()> delivery_hook_;
  mutable std::mutex read_mutex_;
  mutable Database reader_;
};

}  // namespace kiln::store
