#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "server/base/config.h"

namespace kiln::server {

enum class Health { kOk, kWarn, kFail };

/// One thing that was looked at.
struct Finding {
  std::string name;  ///< stable, for programs: "data_fsync"
  Health health = Health::kOk;
  std::string value;   ///< what was found, for people: "3.9 ms"
  std::string advice;  ///< what to do about it; "" when it is well
};

/// Looks at the machine as a service with this configuration would meet it: processor, memory,
/// disk, descriptors, ports, clock, SQLite. Writes one small file into the data folder, and removes
/// it. The service may run meanwhile; its ports are then found in use.
std::vector<Finding> examine(const base::ServerConfig&);

/// Returns the worst outcome of all.
Health worst(const std::vector<Finding>&);

const char* to_string(Health);  ///< "ok", "warn", "fail"
nlohmann::json to_json(const std::vector<Finding>&);

}  // namespace kiln::server
