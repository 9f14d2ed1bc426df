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

#include "baker/checkpoint/pass_part.h"
#include "baker/lightmap/lightmap.h"
#include "baker/solver/solver.h"
#include "proto/expected.h"
#include "proto/manifest.h"

namespace kiln::checkpoint {

/// Writes the checkpoints of one bake from a thread of its own while the next passes run, and tells
/// which passes are durable. A pass counts as finished once it is: until then a bake that is cut
/// makes it again, afterwards never.
///
/// Short passes share a checkpoint: one is written when the passes since the last one have taken so
/// long that writing keeps to its share of the processors' time. When that is, is a matter of
/// clocks; what a bake gives after any of them is not.
///
/// Used by one thread. What it tells comes from its own thread, one at a time, in order.
class CheckpointWriter {
 public:
  struct Options {
    std::filesystem::path dir;  ///< empty: nothing is written, and every pass is finished at once
    std::string key;            ///< see write_checkpoint()
    /// Of the processors' time that checkpoints may take. 1 or more: each pass has its own, and the
    /// next one waits for it.
    double share = 0.05;
    unsigned threads = 1;  ///< that the passes run on
    std::stop_token stop;  ///< ends the writing within a second; what is not durable then never is
  };
  struct Listener {
    std::function<void(const proto::PassReport&)> on_durable;
    /// Once. The passes go on without checkpoints, and count as finished all the same.
    std::function<void(const proto::Error&)> on_failed;
  };

  /// @param known passes that are durable already
  CheckpointWriter(Options, Listener, std::size_t known);
  ~CheckpointWriter();  ///< what is not being written is dropped
  CheckpointWriter(const CheckpointWriter&) = delete;
  CheckpointWriter& operator=(const CheckpointWriter&) = delete;

  /// Before a pass: release_state() where the pass will change it. Waits where large light of an
  /// earlier pass than the last is still being written.
  void before(const solver::Pass&);
  /// After a pass: the light after `passes`, and the solver's state, which stays as it is until
  /// before() of a pass that fills or completes it.
  void offer(const solver::Pass&, std::span<const proto::PassReport> passes,
             std::shared_ptr<const lightmap::Lightmap>, std::span<const std::byte> state);
  /// Restores what an earlier process has written of a pass that has just begun.
  solver::PassProgress restore(const solver::Pass&, const lightmap::Lightmap& before,
                               lightmap::Lightmap& after, std::span<std::byte> state);
  /// In the middle of a pass: its texels so far, and their share of the state, which stay as they
  /// are until release_part(). They are written once the pass before is durable.
  void offer_part(const solver::Pass&, std::shared_ptr<const lightmap::Lightmap> before,
                  std::shared_ptr<const lightmap::Lightmap> after, const solver::PassProgress&,
                  std::span<const std::byte> state);
  /// From here on the pass's light is not read: waits where it is being written, and drops what
  /// waits to be.
  void release_part();
  /// Writes what was offered as soon as may be; waits only while that reads the solver's state.
  void hurry();
  /// From here on the solver's state is not read: waits where it is being written, and drops what
  /// waits to be written with it.
  void release_state();
  /// Waits until all passes are durable, and the listener has been told. False when stopped.
  bool flush();

 private:
  using Clock = std::chrono::steady_clock;
  struct Offer {
    std::vector<proto::PassReport> passes;
    std::shared_ptr<const lightmap::Lightmap> light;
    std::span<const std::byte> state;  ///< empty: none is needed, or it is on the disk
  };

  struct Part {
    std::uint32_t pass;
    std::shared_ptr<const lightmap::Lightmap> before, after;
    solver::PassProgress progress;
    std::span<const std::byte> state;
  };
  /// What is on the disk of the pass under way.
  struct Parts {
    std::uint32_t pass = 0, count = 0;
    solver::PassProgress progress;
  };

  void loop(const std::stop_token&);
  bool write(const Offer&);
  bool write(const Part&, const PassPart&);
  void fail(const proto::Error&);
  void tell(std::span<const proto::PassReport>);
  // Need mutex_:
  void write_next(std::unique_lock<std::mutex>&);
  bool is_due() const;
  Clock::time_point due() const;
  double next_bytes() const;
  PassPart next_part(const Part&);
  bool has_lost_its_pass(const Part&) const;
  bool reads_state() const;  ///< now or later
  void take_over_bug();      ///< throws it

  const Options options_;
  const Listener listener_;
  const std::size_t known_;
  std::size_t told_;  ///< passes; of the thread that writes

  std::mutex mutex_;  ///< guards what follows
  std::condition_variable_any changed_;
  std::optional<Offer> waiting_;
  std::optional<Part> waiting_part_;
  std::size_t durable_;  ///< passes in the newest checkpoint
  Parts parts_;
  bool stale_parts_ = true;  ///< there may be some, of a pass that is done
  bool writing_ = false, writing_state_ = false, writing_part_ = false;
  bool hurried_ = false, failed_ = false;
  bool has_state_ = false;  ///< a pass of this attempt has filled it
  bool state_on_disk_ = false;
  std::exception_ptr bug_;  ///< of the listener, for the next call
  Clock::time_point last_ = Clock::now();
  double seconds_ = 0, bytes_ = 0;  ///< of processor time, for what has been written

  std::jthread thread_;  ///< last: it uses the others
};

}  // namespace kiln::checkpoint
