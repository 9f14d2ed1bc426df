#pragma once

#include <sys/types.h>

#include <chrono>
#include <functional>
#include <memory>

#include "server/sandbox/zygote.h"

namespace kiln::sandbox {

/// While this lives, the pictures of this process are decoded and encoded by other processes, each
/// forked from a zygote for one call and confined as an import is. This process never loads the
/// image module, which would take 126 MiB and a fifth of a second. Calls come from many threads.
/// A call whose process ends, lies, or can't be started gives Outcome::kUnavailable with the
/// reason. It throws std::bad_alloc where memory lacks.
class ImageProcesses {
 public:
  struct Options {
    std::shared_ptr<Zygote> zygote;
    /// A call waits this long for a zygote.
    std::chrono::milliseconds patience = kZygotePatience;
    /// Gets each process's id, on the thread that made the call.
    std::function<void(pid_t)> started = nullptr;
  };
  /// Calls image::use_module(); the destructor gives the module back. One at a time may live.
  explicit ImageProcesses(Options);
  ~ImageProcesses();
  ImageProcesses(const ImageProcesses&) = delete;
  ImageProcesses& operator=(const ImageProcesses&) = delete;
};

}  // namespace kiln::sandbox
