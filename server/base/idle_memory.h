#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <thread>

namespace kiln::base {

/// Gives memory back to the system while the service is idle. What a bake frees stays with the
/// allocator, scattered over an arena for each of the threads that took part, and would count as
/// used until the next burst.
class IdleMemory {
 public:
  /// `idle` returns whether nothing runs now. It is asked on a thread of this object's, every
  /// `interval`.
  explicit IdleMemory(std::function<bool()> idle,
                      std::chrono::milliseconds interval = std::chrono::seconds(2));

 private:
  std::jthread thread_;
};

/// Returns the memory of this process that no file stands behind; 0 when the system does not tell.
std::uint64_t anonymous_memory_bytes();

}  // namespace kiln::base
