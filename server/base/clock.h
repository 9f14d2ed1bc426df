#pragma once

#include <chrono>
#include <string>

/// The wall clock, as texts.
namespace kiln::base {

/// Returns the time now, or so many seconds later: RFC 3339, UTC, with milliseconds. Such texts
/// sort by time.
std::string now_rfc3339(std::chrono::seconds later = {});
/// Returns the time so many seconds after one that now_rfc3339() gave; "" when it is not of that
/// form.
std::string seconds_after(const std::string& rfc3339, std::chrono::seconds);
/// Returns the day now, or so many seconds later: "2026-11-22", UTC.
std::string today(std::chrono::seconds later = {});

}  // namespace kiln::base
