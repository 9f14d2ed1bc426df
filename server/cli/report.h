#pragma once

#include <string>

#include "proto/expected.h"

namespace kiln::cli {

/// Exit codes of every command.
enum Exit : int {
  kDone = 0,
  kFailed = 1,  ///< the job failed, or something outside the user's hands
  kUsage = 2,   ///< the command line or the input is wrong
};

/// Whom an error is to be put down to: kUsage when other input would help, else kFailed.
Exit exit_code_of(const proto::Error&);

/// What was wrong, where, and what to do about it: several lines, each ending in a line break.
/// Control characters of foreign text are replaced.
std::string error_text(const proto::Error&);

/// error_text() on stderr; returns exit_code_of().
int report(const proto::Error&);

}  // namespace kiln::cli
