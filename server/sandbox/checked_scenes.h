#pragma once

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>

#include "baker/files/upload.h"
#include "proto/files.h"
#include "server/base/memory_budget.h"
#include "server/sandbox/supervisor.h"

namespace kiln::sandbox {

/// A scene that a process has checked and still has read, so that its import parses nothing.
struct CheckedScene {
  std::string files;  ///< identity_of() the checked files
  /// The process's right to run; ends after it.
  std::optional<base::MemoryBudget::Place> place;
  proto::Fd product;                ///< the import's, empty so far
  std::filesystem::path temporary;  ///< path of the product, unlinked with this; "": it has none
  std::uint64_t memory_bytes = 0;   ///< that the process may take
  std::unique_ptr<CheckedProcess> process;

  CheckedScene() = default;
  CheckedScene(const CheckedScene&) = delete;
  CheckedScene& operator=(const CheckedScene&) = delete;
  ~CheckedScene();
};

/// Names files by what they are on the disk, whatever their paths: a process that has read them
/// keeps their inodes from being used again. "" when one of them can't be read.
std::string identity_of(const files::SceneFiles&);

/// Keeps scenes between their check and their import, each for a quarter of a minute at most, few
/// at a time, and none whose place another process waits for. Thread-safe.
class CheckedScenes {
 public:
  CheckedScenes();
  CheckedScenes(const CheckedScenes&) = delete;
  CheckedScenes& operator=(const CheckedScenes&) = delete;

  void put(std::unique_ptr<CheckedScene>);
  /// Takes out a scene with these files; null when there is none.
  std::unique_ptr<CheckedScene> take(const std::string& files);
  /// Ends the process that was kept for longest. False when there was none.
  bool drop_oldest();

 private:
  using Clock = std::chrono::steady_clock;
  struct Kept {
    Clock::time_point until;
    std::unique_ptr<CheckedScene> scene;
  };
  void drop_in_time(const std::stop_token&);

  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::list<Kept> kept_;  ///< oldest first
  std::jthread dropper_;
};

}  // namespace kiln::sandbox
