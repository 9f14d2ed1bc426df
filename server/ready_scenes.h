#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <vector>

#include "baker/trace/ray_scene.h"
#include "proto/expected.h"
#include "server/base/memory_budget.h"

namespace kiln::server {

/// Scenes that rays can be traced in. Requests for one scene share it, and it is made once, however
/// many come together. One that no request uses is kept for the next, the most recently used ones
/// of all up to a number of bytes. All of them are reserved in the memory budget; those that are
/// kept are its spare memory, which anyone else is given. Thread-safe.
class ReadyScenes : public std::enable_shared_from_this<ReadyScenes> {
 public:
  /// @param most_kept bytes
  static std::shared_ptr<ReadyScenes> create(std::shared_ptr<base::MemoryBudget>,
                                             std::uint64_t most_kept);
  ~ReadyScenes();
  ReadyScenes(const ReadyScenes&) = delete;
  ReadyScenes& operator=(const ReadyScenes&) = delete;

  /// Reserves so much for a scene in place of what it had; false when there is not so much.
  using Reserve = std::function<bool(std::uint64_t bytes)>;
  /// Makes a scene ready. It ends soon after a stop request.
  using Make =
      std::function<proto::Expected<trace::RayScene>(const Reserve&, const std::stop_token&)>;

  struct Use {
    /// The scene, which stays ready for as long as this lives; it may outlive the ReadyScenes.
    std::shared_ptr<const trace::RayScene> rays;
    bool was_ready = true;  ///< false for the one request that made it
  };
  /// Returns the scene, after `make` if it is not ready. Who asks for a scene that is being made
  /// waits for that; making it is stopped once all have left that asked for it. Errors: those of
  /// `make`, for all who wait for it, and `canceled`. Throws what `make` throws.
  proto::Expected<Use> get(const std::string& key, const Make& make, const std::stop_token&);

  std::uint64_t kept_bytes() const { return *kept_; }  ///< of scenes that no request uses

 private:
  struct Entry;
  using EntryPtr = std::shared_ptr<Entry>;
  using Entries = std::list<EntryPtr>;

  ReadyScenes(std::shared_ptr<base::MemoryBudget> memory, std::uint64_t most_kept)
      : memory_(std::move(memory)), most_kept_(most_kept) {}
  EntryPtr enter(const std::string& key, bool& is_new);
  proto::Expected<Use> wait_for(const EntryPtr&, const std::stop_token&);
  void make_entry(const EntryPtr&, const Make&);
  void leave(const EntryPtr&);
  bool give_back(std::uint64_t bytes);
  /// Takes scenes out that no request uses, longest unused first, until `enough()`. Needs mutex_.
  std::vector<EntryPtr> take_unused(const std::function<bool()>& enough);
  void release(const std::vector<EntryPtr>&) const;

  const std::shared_ptr<base::MemoryBudget> memory_;
  const std::uint64_t most_kept_;
  std::mutex mutex_;
  /// Changed under mutex_. The memory budget looks at it, too, with a lock of its own.
  const std::shared_ptr<std::atomic<std::uint64_t>> kept_ =
      std::make_shared<std::atomic<std::uint64_t>>(0);
  std::condition_variable_any made_;
  Entries entries_;  ///< the most recently used one last; guarded by mutex_
};

}  // namespace kiln::server
