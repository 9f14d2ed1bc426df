#include "server/base/event_ring.h"

#include <algorithm>
#include <utility>

namespace kiln::base {

EventRing::EventRing(std::uint64_t last, std::vector<proto::Event> kept)
    : events_(std::make_move_iterator(kept.begin()), std::make_move_iterator(kept.end())),
      floor_(events_.empty() ? last : events_.front().id - 1),
      last_(last) {
  ended_ = !events_.empty() && events_.back().type == kJobEnd;
}

std::shared_ptr<EventRing> EventRing::endless(std::uint64_t floor, std::uint64_t last,
                                              std::vector<proto::Event> kept) {
  auto ring = std::make_shared<EventRing>(last, std::move(kept));
  ring->floor_ = floor;
  ring->endless_ = true;
  ring->ended_ = false;
  return ring;
}

void EventRing::push(proto::Event event) {
  const std::lock_guard lock(mutex_);
  last_ = event.id;
  ended_ = !endless_ && event.type == kJobEnd;
  events_.push_back(std::move(event));
  if (events_.size() <= kCapacity) return;
  floor_ = events_.front().id;
  events_.pop_front();
}

std::uint64_t EventRing::last() const {
  const std::lock_guard lock(mutex_);
  return last_;
}

EventRing::Tail EventRing::after(std::uint64_t id, std::size_t limit) const {
  const std::lock_guard lock(mutex_);
  Tail tail;
  tail.last = last_;
  tail.complete = id <= last_ && id >= floor_;
  const auto begin = std::partition_point(events_.begin(), events_.end(),
                                          [&](const proto::Event& e) { return e.id <= id; });
  const auto left = static_cast<std::size_t>(events_.end() - begin);
  tail.events.assign(begin, begin + static_cast<std::ptrdiff_t>(std::min(left, limit)));
  tail.ended = ended_ && left <= limit;
  return tail;
}

}  // namespace kiln::base
