#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "baker/lightmap/lightmap.h"
#include "baker/lightmap/texel_patch.h"
#include "baker/solver/pass.h"
#include "proto/expected.h"
#include "proto/manifest.h"

namespace kiln::checkpoint {

/// Writes the checkpoints of one bake from a thread of its own while the next passes run, and
/// reports which passes are durable. A pass counts as finished once it is: until then a bake that
/// is cut makes it again, afterwards never.
///
/// Short passes share a checkpoint: one is written when the passes since the last one have taken so
/// long that writing keeps to its share of the processors' time. Clocks decide when that is; the
/// result of a bake does not depend on it.
///
/// submit_part() may be called from any thread, the others from one. The listener is called from
/// the writer's own thread, one call at a time, in order.
class CheckpointWriter {
 public:
  struct Options {
    std::filesystem::path dir;  ///< empty: nothing is written, and every pass is finished at once
    std::string key;            ///< see write_checkpoint()
    /// The share of the processors' time that checkpoints may take. From 1 on each pass has a
    /// checkpoint of its own, and the next pass waits for it.
    double share = 0.05;
    unsigned threads = 1;  ///< threads that the passes run on
    std::stop_token stop;  ///< ends the writing within a second; what is not durable then never is
  };
  struct Listener {
    std::function<void(const proto::PassReport&)> on_durable;
    /// Called once. The passes go on without checkpoints, and count as finished all the same.
    std::function<void(const proto::Error&)> on_failed;
  };

  /// @param known number of passes that are durable already
  CheckpointWriter(Options, Listener, std::size_t known);
  ~CheckpointWriter();  ///< what is not being written is dropped
  CheckpointWriter(const CheckpointWriter&) = delete;
  CheckpointWriter& operator=(const CheckpointWriter&) = delete;

  /// Prepares for a pass. When the pass writes or gives up shared planes, no earlier light whose
  /// checkpoint needs them is read from here on: this waits while one is being written, and drops
  /// one that waits to be. It also waits while large light of an earlier pass than the last is
  /// being written.
  void begin_pass(const solver::PassPlan&);
  /// Takes the light after `passes`, once a pass is done.
  void submit(const solver::PassPlan&, std::span<const proto::PassReport> passes,
              std::shared_ptr<const lightmap::Lightmap>);
  /// Restores what an earlier process wrote of a pass that has just begun.
  solver::PassProgress restore(const solver::PassPlan&, const lightmap::Lightmap& before,
                               lightmap::Lightmap& after);
  /// Takes the texels of a pass so far, which stay as they are until end_parts(). They are written
  /// once the pass before is durable.
  void submit_part(const solver::PassPlan&, std::shared_ptr<const lightmap::Lightmap> after,
                   const solver::PassProgress&);
  /// Ends the reading of the light of the pass under way: waits while it is being written, and
  /// drops what waits to be written.
  void end_parts();
  /// Has what was submitted written as soon as possible.
  void write_now();
  /// Waits until all passes are durable and the listener has been called. Returns false when
  /// stopped.
  bool flush();

 private:
  using Clock = std::chrono::steady_clock;
  struct Submitted {
    std::vector<proto::PassReport> passes;
    std::shared_ptr<const lightmap::Lightmap> light;
    bool with_shared = false;  ///< shared planes are written, too: they are not on the disk
  };

  struct Part {
    solver::PassPlan plan;
    std::shared_ptr<const lightmap::Lightmap> after;
    solver::PassProgress progress;
  };
  /// The parts of the pass under way that are on the disk.
  struct Parts {
    std::uint32_t pass = 0, count = 0;
    solver::PassProgress progress;
  };
  /// The piece that one part adds to those on the disk.
  struct NewPart {
    std::uint32_t number = 0;
    lightmap::PatchHead head;
  };

  void loop(const std::stop_token&);
  bool write(const Submitted&);
  bool write(const Part&, const NewPart&);
  void fail(const proto::Error&);
  void notify(std::span<const proto::PassReport>);
  // The caller of these holds mutex_.
  void write_next(std::unique_lock<std::mutex>&);
  bool is_due() const;
  Clock::time_point due() const;
  double next_bytes() const;
  NewPart next_part(const Part&);
  bool has_lost_its_pass(const Part&) const;
  void release_shared(std::unique_lock<std::mutex>&);
  void rethrow_bug();

  const Options options_;
  const Listener listener_;
  const std::size_t known_;
  std::size_t notified_;  ///< passes reported; used by the writing thread only

  std::mutex mutex_;  ///< guards what follows
  std::condition_variable_any changed_;
  std::optional<Submitted> waiting_;
  std::optional<Part> waiting_part_;
  std::size_t durable_;  ///< passes in the newest checkpoint
  Parts parts_;
  bool stale_parts_ = true;  ///< there may be parts of a pass that is done
  bool writing_ = false, writing_shared_ = false, writing_part_ = false;
  bool now_ = false, failed_ = false;
  bool shared_is_filled_ = false;  ///< a pass of this attempt has filled it
  bool shared_is_on_disk_ = false;
  std::exception_ptr bug_;  ///< an exception of the listener, for the next call
  Clock::time_point last_ = Clock::now();
  double seconds_ = 0, bytes_ = 0;  ///< processor time and bytes of what has been written

  std::jthread thread_;  ///< last: it uses the others
};

}  // namespace kiln::checkpoint
