#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <vector>

#include "proto/event.h"

namespace kiln::server {

/// The latest events of one job that is not over, for its streams. Thread-safe.
class EventRing {
 public:
  static constexpr std::size_t kCapacity = 1024;

  /// `kept`: the tail of the job's stored events, in order; `last`: the highest id ever given.
  explicit EventRing(std::uint64_t last = 0, std::vector<proto::Event> kept = {});

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
  std::uint64_t last_ = 0;
  bool ended_ = false;
};

inline constexpr const char* kJobEnd = "job.end";

}  // namespace kiln::server
