#pragma once

#include <sys/types.h>

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <thread>

#include "proto/files.h"

namespace kiln::sandbox {

/// Work that needs the image module waits this long for a zygote.
inline constexpr std::chrono::milliseconds kZygotePatience{60'000};

/// Keeps a process that has the image module open, from which import processes are forked: they pay
/// neither for a program's start nor for the module. It has one thread, sees no byte from outside
/// and may start no program and open no socket. One that ends is replaced. Thread-safe.
class Zygote {
 public:
  struct Options {
    std::filesystem::path program = "/proc/self/exe";
    /// Gets the reason why there is none for now, on a thread of its own.
    std::function<void(const std::string& reason)> failed;
  };
  /// Begins to start it and returns at once.
  explicit Zygote(Options);
  /// Ends it, and the import processes that came from it.
  ~Zygote();
  Zygote(const Zygote&) = delete;
  Zygote& operator=(const Zygote&) = delete;

  /// Forks an import process (child.h) that has copies of `files` as its descriptors 0, 1, 2 and so
  /// on, and no others. It is a child of this process. Waits until there is a zygote,
  /// `patience` at most. Returns nothing when there is none then, or a stop was requested.
  std::optional<pid_t> fork(std::span<const int> files, std::chrono::milliseconds patience,
                            const std::stop_token&);

  /// Returns the zygote's id; -1 while there is none.
  pid_t pid() const;
  /// Returns why the zygote has no image module; "" where it has one, or there is no zygote yet.
  std::string fault() const;

 private:
  void keep(const std::stop_token&);
  std::string run(const std::stop_token&);
  void publish(proto::Fd socket, pid_t pid, std::string fault = {});

  const Options options_;
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  proto::Fd socket_;  ///< to the zygote; invalid while there is none
  pid_t pid_ = -1;
  std::string fault_;
  proto::Fd stop_;  ///< readable once it is to end
  std::jthread keeper_;
};

/// The whole life of a zygote: `lightkiln import-zygote PID`, which only a service with this
/// process id starts, with a socket as descriptor 0. Never returns.
[[noreturn]] void run_import_zygote(int parent);

}  // namespace kiln::sandbox
