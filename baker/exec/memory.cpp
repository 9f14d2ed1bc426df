#include "baker/exec/memory.h"

#include <sys/resource.h>

namespace kiln::exec {

std::uint64_t peak_memory_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return std::uint64_t(usage.ru_maxrss) * 1024;
}

}  // namespace kiln::exec
