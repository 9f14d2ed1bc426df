#include "server/base/idle_memory.h"

#include <malloc.h>
#include <unistd.h>

#include <condition_variable>
#include <fstream>
#include <mutex>

namespace kiln::base {
namespace {

// Below this a trim is not worth the locks that it takes.
constexpr std::uint64_t kWorthIt = 4 << 20;

}  // namespace

std::uint64_t anonymous_memory_bytes() {
  std::uint64_t size = 0, resident = 0, of_files = 0;
  std::ifstream("/proc/self/statm") >> size >> resident >> of_files;
  const auto page = static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  return resident < of_files ? 0 : (resident - of_files) * page;
}

IdleMemory::IdleMemory(std::function<bool()> idle, std::chrono::milliseconds interval)
    : thread_([idle = std::move(idle), interval](std::stop_token stop) {
        std::mutex mutex;
        std::condition_variable_any wake;
        std::unique_lock lock(mutex);
        std::uint64_t left = 0;  // bytes that the last trim could not give back
        while (!stop.stop_requested()) {
          wake.wait_for(lock, stop, interval, [] { return false; });
          if (stop.stop_requested() || anonymous_memory_bytes() < left + kWorthIt || !idle())
            continue;
          ::malloc_trim(0);
          left = anonymous_memory_bytes();
        }
      }) {}

}  // namespace kiln::base
