#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "proto/event.h"

namespace kiln::base {

/// The latest events of one job, or of all jobs of a tenant, for their streams. Thread-safe.
class EventRing {
 public:
  static constexpr std::size_t kCapacity = 1024;

  /// Makes the ring of a job, whose ids have no holes. `kept`: the tail of its stored events, in
  /// order; `last`: the highest id ever given.
  explicit EventRing(std::uint64_t last = 0, std::vector<proto::Event> kept = {});
  /// Makes the ring of many jobs: job.end ends nothing, and ids may have holes. Nothing is missing
  /// after `floor`.
  static std::shared_ptr<EventRing> endless(std::uint64_t floor, std::uint64_t last,
                                            std::vector<proto::Event> kept);

  void push(proto::Event);
  std::uint64_t last() const;

  struct Tail {
    std::vector<proto::Event> events;
    bool complete = true;  ///< false: events right after `after` are gone, or never were
    bool ended = false;    ///< job.end is the last of `events`, or is at or before `after`
    std::uint64_t last = 0;
  };
  /// The first `limit` events after `id`.
  Tail after(std::uint64_t id, std::size_t limit = kCapacity) const;

 private:
  mutable std::mutex mutex_;
  std::deque<proto::Event> events_;
  std::uint64_t floor_ = 0;  ///< every event after this id is in events_
  std::uint64_t last_ = 0;
  bool endless_ = false;
  bool ended_ = false;
};

inline constexpr const char* kJobEnd = "job.end";

}  // namespace kiln::base
