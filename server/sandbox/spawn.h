#pragma once

#include <spawn.h>
#include <sys/types.h>

#include <filesystem>
#include <string>
#include <vector>

#include "proto/files.h"

namespace kiln::sandbox {

/// Starts this program anew for a part of its work. All descriptors but those that are given
/// stay behind, since they may hold secrets, and so does the environment but for what the loader
/// and sanitizers read. The process is in a group of its own, so that Ctrl-C reaches it through the
/// service only, and starts with the signals that end a service blocked.
class SpawnPlan {
 public:
  SpawnPlan();
  SpawnPlan(const SpawnPlan&) = delete;
  SpawnPlan& operator=(const SpawnPlan&) = delete;
  ~SpawnPlan();

  /// The process gets these as 0, 1, 2 ... and nothing else. They are copied out of the way first,
  /// for one may lie where another is to go. Returns 0 or an errno.
  int give(std::vector<int> sources);
  /// `lightkiln command PID`, with this process's id. Returns 0 or an errno.
  int run(const std::filesystem::path& program, std::string command, pid_t& pid);

 private:
  posix_spawn_file_actions_t actions_{};
  posix_spawnattr_t attributes_{};
  std::vector<proto::Fd> copies_;
};

/// A child of this process, which it does not outlive: the destructor kills it.
class Child {
 public:
  explicit Child(pid_t pid) : pid_(pid) {}
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child();

  /// Waits for its end by itself. Returns its status, as waitpid() gives it.
  int wait();
  /// Kills it, with all of its group, unless it has ended, and waits. Returns its status.
  int end();

 private:
  pid_t pid_;
};

}  // namespace kiln::sandbox
