#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <stop_token>
#include <vector>

#include "baker/image/module.h"
#include "server/sandbox/image_wire.h"
#include "server/sandbox/zygote.h"

namespace kiln::sandbox {

/// While this lives, the pictures of this process are decoded and encoded by other processes, each
/// forked from a zygote for one call and confined as an import is. This process never loads the
/// image module, which would take 126 MiB and a third of a second. Calls come from many threads.
/// One that fails because its process ends, lies, or can't be started gives Outcome::kUnavailable,
/// which says so; where memory lacks, std::bad_alloc is thrown.
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

/// One call with its bytes, as this process holds them.
struct ImageCall {
  ImageHead head;
  std::vector<std::span<const char>> input;  ///< parts of the file, or samples
  image::FloatRows* rows = nullptr;          ///< of kWriteExr
  image::Sink* sink = nullptr;               ///< of functions that write
  std::vector<std::span<char>> pixels;       ///< of functions that read: gets what was decoded
};

/// Holds this process's side of the talk over `socket`, which must not block. Checks every number
/// that arrives. Returns the outcome of the call; kUnavailable without words when the other side
/// went; kUnavailable with words when it broke the rules of the talk or fell silent for
/// `silence`. Throws std::bad_alloc when the other side had too little memory.
image::Outcome hold_image_talk(const ImageCall&, int socket, const std::stop_token&,
                               std::chrono::milliseconds silence = std::chrono::minutes(5));

}  // namespace kiln::sandbox
