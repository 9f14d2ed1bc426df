#pragma once

#include <functional>
#include <optional>

#include "baker/checkpoint/writer.h"
#include "baker/solver/solver.h"
#include "proto/manifest.h"

namespace kiln::checkpoint {

/// Holds the checkpoints of one bake: those that it finds, and those that it leaves.
class Checkpoints {
 public:
  struct Listener {
    std::function<void(const proto::PassReport&)> on_durable;  ///< see CheckpointWriter
    /// Receives `checkpoint_ignored` from find(), and `checkpoint_failed` from the writer's thread.
    std::function<void(const proto::Warning&)> on_warning;
  };
  /// @param options an empty folder: there are no checkpoints
  Checkpoints(CheckpointWriter::Options options, Listener listener);

  /// Returns where the solver can go on: at its first pass, when nothing usable is found. Files
  /// that are damaged, or belong to another bake or an old form, are removed with a warning. It is
  /// called once, before the others.
  solver::SolveStart find(const solver::Solver&, std::uint32_t texels);
  CheckpointWriter& writer() { return *writer_; }

 private:
  solver::SolveStart read(const solver::Solver&, std::uint32_t texels);

  const CheckpointWriter::Options options_;
  const Listener listener_;
  std::optional<CheckpointWriter> writer_;
};

}  // namespace kiln::checkpoint
