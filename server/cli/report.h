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

/// Returns the exit code for an error: kUsage when other input would help, else kFailed.
Exit exit_code_of(const proto::Error&);

/// Describes an error: what is wrong, where, and what to do about it. The text has several lines,
/// each ending in a line break. Control characters from outside are replaced.
std::string error_text(const proto::Error&);

/// Prints error_text() on stderr and returns exit_code_of().
int report(const proto::Error&);

}  // namespace kiln::cli
