#include "server/jobs/event_feeds.h"

#include <utility>

namespace kiln::jobs {

EventFeeds::EventFeeds(store::JobStore& store, EventHook hook)
    : store_(store), hook_(std::move(hook)) {
  store_.on_feed([this](const std::string& tenant, const std::vector<proto::Event>& events) {
    publish(tenant, events);
  });
}

std::shared_ptr<const base::EventRing> EventFeeds::of(const Key& tenant) {
  // Under the lock: an event that is stored meanwhile is in what is read, or pushed afterwards.
  const std::lock_guard lock(mutex_);
  std::erase_if(rings_, [](const auto& entry) { return entry.second.expired(); });
  auto& known = rings_[tenant];
  auto ring = known.lock();
  if (!ring) {
    store::Feed feed = store_.feed(tenant);
    ring = base::EventRing::endless(feed.floor, feed.last, std::move(feed.events));
    known = ring;
  }
  return ring;
}

void EventFeeds::push(const Key& key, const std::vector<proto::Event>& events) {
  const auto found = rings_.find(key);
  const auto ring = found == rings_.end() ? nullptr : found->second.lock();
  if (!ring) return;
  for (const auto& event : events)
    if (event.id > ring->last()) ring->push(event);
  hook_(ring.get());
}

void EventFeeds::publish(const std::string& tenant, const std::vector<proto::Event>& events) {
  const std::lock_guard lock(mutex_);
  push(tenant, events);
  push(std::nullopt, events);
}

}  // namespace kiln::jobs
