#include "server/base/log.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <atomic>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/base/clock.h"

namespace kiln::base {
namespace {

std::atomic<LogFormat> g_format{LogFormat::kText};
thread_local std::string t_request_id;

spdlog::logger& logger() {
  static const auto instance = [] {
    auto made = std::make_shared<spdlog::logger>("lightkiln",
                                                 std::make_shared<spdlog::sinks::stderr_sink_mt>());
    made->set_pattern("%v");
    made->flush_on(spdlog::level::trace);
    return made;
  }();
  return *instance;
}

spdlog::level::level_enum spdlog_level(LogLevel level) {
  switch (level) {
    case LogLevel::kTrace:
      return spdlog::level::trace;
    case LogLevel::kDebug:
      return spdlog::level::debug;
    case LogLevel::kInfo:
      return spdlog::level::info;
    case LogLevel::kWarn:
      return spdlog::level::warn;
    case LogLevel::kError:
      return spdlog::level::err;
  }
  return spdlog::level::err;
}

const char* name_of(LogLevel level) {
  constexpr const char* kNames[] = {"trace", "debug", "info", "warn", "error"};
  return kNames[static_cast<int>(level)];
}

}  // namespace

void set_up_log(const std::string& level, LogFormat format) {
  g_format = format;
  logger().set_level(spdlog::level::from_str(level));
}

LogRequest::LogRequest(std::string id) {
  t_request_id = std::move(id);
}

LogRequest::~LogRequest() {
  t_request_id.clear();
}

void log_line(LogLevel level, std::string_view event, const nlohmann::json& given) {
  const auto severity = spdlog_level(level);
  if (!logger().should_log(severity)) return;
  nlohmann::json fields = given;
  if (!t_request_id.empty()) fields["request_id"] = t_request_id;
  if (g_format == LogFormat::kJson) {
    nlohmann::json line{{"ts", now_rfc3339()}, {"level", name_of(level)}, {"event", event}};
    line.update(fields);
    logger().log(severity, proto::to_text(line));
    return;
  }
  std::string line = now_rfc3339() + " " + name_of(level) + " " + std::string(event);
  for (const auto& [key, value] : fields.items()) {
    const bool bare = value.is_string() && value.get_ref<const std::string&>().find_first_of(
                                               " \"\r\n\t\x1b") == std::string::npos;
    line += " " + key + "=" + (bare ? value.get<std::string>() : proto::to_text(value));
  }
  logger().log(severity, line);
}

}  // namespace kiln::base
