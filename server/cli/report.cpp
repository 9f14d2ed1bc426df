#include "server/cli/report.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <string_view>
#include <utility>

#include "proto/problems.h"

namespace kiln::cli {
namespace {

using Hint = std::pair<std::string_view, std::string_view>;

constexpr std::array<Hint, 12> kHints{{
    {"bad_document", "check the address given with --server"},
    {"draining", "the service is shutting down: try again when it is back"},
    {"invalid_config", "`lightkiln serve --help` lists flags, variables and keys"},
    {"invalid_lightmap_uv", "let the baker unwrap the scene: --set atlas.unwrap=auto"},
    {"invalid_settings", "`lightkiln settings` lists all names, ranges and defaults"},
    {"missing_file",
     "files that the scene needs are looked for beside it; name others with --side FILE"},
    {"no_light",
     "add a sky (--set sky.radiance=[1,1,1]) or lights (--settings FILE), or bake it dark all the "
     "same (--set allow_dark=true)"},
    {"queue_full", "try again later"},
    {"result_not_ready", "wait for the job with `lightkiln watch ID`"},
    {"server_unreachable", "start a service with `lightkiln serve`, or name one with --server URL"},
    {"storage_full", "make room on the disk; a service can be given another --data folder"},
    {"unknown_generator", "`lightkiln scene --list` names them all"},
}};

/// Foreign text must not move the cursor or color the terminal.
std::string printable(std::string text) {
  std::replace_if(
      text.begin(), text.end(),
      [](unsigned char c) { return (c < 0x20 && c != '\t') || c == 0x7f; }, '?');
  return text;
}

}  // namespace

Exit exit_code_of(const proto::Error& error) {
  if (error.code == "invalid_config" || error.code == "usage") return kUsage;
  const int status = proto::problem_kind(error.code).status;
  // 4xx means other input would help, but for those that time or another job's state decides.
  const bool passing = status == 408 || status == 409 || status == 425 || status == 429;
  return status >= 400 && status < 500 && !passing ? kUsage : kFailed;
}

std::string error_text(const proto::Error& error) {
  std::string out =
      "lightkiln: " + printable(error.message) + "  [" + printable(error.code) + "]\n";
  for (const auto& place : error.details) {
    if (place.detail == error.message && place.pointer.empty()) continue;
    const std::string where = place.source + (place.pointer.empty() ? "" : " " + place.pointer);
    out += "  at " + printable(where) +
           (place.detail == error.message ? "" : ": " + printable(place.detail)) + "\n";
  }
  for (const auto& [code, hint] : kHints)
    if (code == error.code) out += "  hint: " + std::string(hint) + "\n";
  return out;
}

int report(const proto::Error& error) {
  std::fputs(error_text(error).c_str(), stderr);
  return exit_code_of(error);
}

}  // namespace kiln::cli
