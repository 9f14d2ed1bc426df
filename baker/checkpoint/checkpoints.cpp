#include "baker/checkpoint/checkpoints.h"

#include <utility>

#include "baker/checkpoint/store.h"

namespace kiln::checkpoint {

Checkpoints::Checkpoints(CheckpointWriter::Options options, Listener listener)
    : options_(std::move(options)), listener_(std::move(listener)) {}

solver::SolveStart Checkpoints::find(const solver::Solver& solver, std::uint32_t texels) {
  solver::SolveStart start = read(solver, texels);
  const CheckpointWriter::Listener listener{
      listener_.on_durable, [this](const proto::Error& error) {
        listener_.on_warning(
            {"checkpoint_failed", "", error.message + " The bake goes on without checkpoints."});
      }};
  writer_.emplace(options_, listener, start.passes.size());
  return start;
}

solver::SolveStart Checkpoints::read(const solver::Solver& solver, std::uint32_t texels) {
  if (options_.dir.empty()) return {};
  auto found = read_checkpoint(options_.dir, options_.key, solver, texels, options_.stop);
  if (options_.stop.stop_requested()) return {};  // the solve will say so
  if (found) return found->value_or(solver::SolveStart{});
  listener_.on_warning(
      {"checkpoint_ignored", "", found.error().message + " The bake starts at its first pass."});
  remove_checkpoints(options_.dir);
  return {};
}

}  // namespace kiln::checkpoint
