#pragma once

#include <cstdint>
#include <string>

namespace kiln::proto {

/// One entry of a job's event stream. Ids count from 1 in each job and have no holes. The types are
/// snapshot, job.state, job.progress, pass.completed, log, result.ready, job.end; server.draining
/// has no id.
struct Event {
  std::uint64_t id = 0;
  std::string type;
  std::string data;  ///< one line of JSON
};

}  // namespace kiln::proto
