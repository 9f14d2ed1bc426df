#include "baker/exec/cpu_time.h"

#include <ctime>

namespace kiln::exec {

double thread_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return double(now.tv_sec) + double(now.tv_nsec) * 1e-9;
}

}  // namespace kiln::exec
