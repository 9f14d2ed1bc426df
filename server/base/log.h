#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "server/base/config.h"

namespace kiln::base {

enum class LogLevel { kTrace, kDebug, kInfo, kWarn, kError };

/// Sets level and format of the process's log (stderr). Call once, before threads start.
void set_up_log(const std::string& level, LogFormat);

/// While this object lives, every line that this thread logs has the field `request_id`, so that
/// all lines on behalf of a request can be found by its id. One at a time per thread.
class LogRequest {
 public:
  explicit LogRequest(std::string id);
  ~LogRequest();
  LogRequest(const LogRequest&) = delete;
  LogRequest& operator=(const LogRequest&) = delete;
};

/// Writes one line: {"ts", "level", "event", ...fields} as JSON, or the same as text for people.
/// `fields` is an object. Thread-safe.
void log_line(LogLevel, std::string_view event, const nlohmann::json& fields);

}  // namespace kiln::base
