#include "server/base/clock.h"

#include <date/date.h>

#include <sstream>

namespace kiln::base {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

// std::chrono of GCC 12 has neither format() nor parse() yet.
constexpr const char* kRfc3339 = "%FT%TZ";

date::sys_time<milliseconds> after_now(seconds later) {
  return date::floor<milliseconds>(std::chrono::system_clock::now()) + later;
}

}  // namespace

std::string now_rfc3339(seconds later) {
  return date::format(kRfc3339, after_now(later));
}

std::string seconds_after(const std::string& text, seconds later) {
  date::sys_time<milliseconds> time;
  std::istringstream in(text);
  in >> date::parse(kRfc3339, time);
  // parse() takes fewer digits, and text that follows.
  if (!in || date::format(kRfc3339, time) != text) return {};
  return date::format(kRfc3339, time + later);
}

std::string today(seconds later) {
  return date::format("%F", after_now(later));
}

}  // namespace kiln::base
