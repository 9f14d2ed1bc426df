#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "server/base/event_ring.h"
#include "server/store/job_store.h"

namespace kiln::jobs {

/// The events of all jobs of a tenant, or of everyone, as rings that streams can follow. A ring
/// lives as long as somebody follows it, and is filled from the store. Thread-safe.
class EventFeeds {
 public:
  using EventHook = std::function<void(const base::EventRing*)>;
  /// Becomes the store's feed hook. `hook` is called after each new event, from any thread.
  EventFeeds(store::JobStore&, EventHook hook);

  std::shared_ptr<const base::EventRing> of(
      const std::optional<std::string>& tenant);  ///< nothing: all

 private:
  using Key = std::optional<std::string>;
  void publish(const std::string& tenant, const std::vector<proto::Event>&);
  void push(const Key&, const std::vector<proto::Event>&);  ///< needs mutex_

  store::JobStore& store_;
  const EventHook hook_;
  std::mutex mutex_;
  std::map<Key, std::weak_ptr<base::EventRing>> rings_;  ///< guarded by mutex_
};

}  // namespace kiln::jobs
