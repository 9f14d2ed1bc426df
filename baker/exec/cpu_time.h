#pragma once

namespace kiln::exec {

/// Returns the processor time of the calling thread so far, s.
double thread_seconds();

}  // namespace kiln::exec
