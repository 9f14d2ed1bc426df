#include "baker/checkpoint/checkpoint_writer.h"

#include <time.h>

#include <new>
#include <utility>

#include "baker/checkpoint/checkpoint.h"

namespace kiln::checkpoint {
namespace {

/// Processor time per byte before any has been measured, seconds.
constexpr double kUsualCost = 1.5e-9;

/// Of light: from here on memory counts more than the time that a pass waits for the disk.
constexpr double kManyBytes = 32 << 20;

proto::Unexpected no_memory() {
  return proto::fail("out_of_memory", "There is no memory to write a checkpoint.");
}

double thread_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

double bytes_of(const lightmap::Lightmap& light) {
  double all = 0;
  lightmap::Lightmap::for_planes(light, [&](const auto& plane) {
    all += double(plane.size()) * sizeof(plane.values().front());
  });
  return all;
}

}  // namespace

CheckpointWriter::CheckpointWriter(Options options, Listener listener, std::size_t known)
    : options_(std::move(options)),
      listener_(std::move(listener)),
      known_(known),
      told_(known),
      durable_(known),
      state_on_disk_(known > 0) {
  if (!options_.dir.empty())
    thread_ = std::jthread([this](const std::stop_token& end) { loop(end); });
}

CheckpointWriter::~CheckpointWriter() {
  thread_ = {};
}

void CheckpointWriter::before(const solver::Pass& pass) {
  if (pass.fills_state || pass.completes) release_state();
  std::unique_lock lock(mutex_);
  // The light of the pass before the last would be a third one in memory.
  if (waiting_ && bytes_of(*waiting_->light) > kManyBytes)
    changed_.wait(lock, [&] { return !writing_; });
  state_on_disk_ = state_on_disk_ && !pass.fills_state;
}

void CheckpointWriter::release_state() {
  std::unique_lock lock(mutex_);
  if (waiting_ && !waiting_->state.empty()) waiting_.reset();
  if (waiting_part_ && !waiting_part_->state.empty()) waiting_part_.reset();
  changed_.wait(lock, [&] { return !writing_state_; });
}

solver::PassProgress CheckpointWriter::restore(const solver::Pass& pass,
                                               const lightmap::Lightmap& before,
                                               lightmap::Lightmap& after,
                                               std::span<std::byte> state) {
  if (options_.dir.empty() || pass.index != known_) return {};
  const StoredParts stored =
      read_parts(options_.dir, options_.key, pass, before, after, state, options_.stop);
  const std::lock_guard lock(mutex_);
  parts_ = {pass.index, stored.count, stored.progress};
  return stored.progress;
}

void CheckpointWriter::offer_part(const solver::Pass& pass,
                                  std::shared_ptr<const lightmap::Lightmap> before,
                                  std::shared_ptr<const lightmap::Lightmap> after,
                                  const solver::PassProgress& progress,
                                  std::span<const std::byte> state) {
  std::unique_lock lock(mutex_);
  if (options_.dir.empty() || failed_) return;
  waiting_part_ = Part{pass.index, std::move(before), std::move(after), progress,
                       pass.fills_state ? state : std::span<const std::byte>{}};
  changed_.notify_all();
  if (options_.share >= 1)
    changed_.wait(lock, options_.stop, [&] { return !waiting_part_ && !writing_; });
}

void CheckpointWriter::release_part() {
  std::unique_lock lock(mutex_);
  waiting_part_.reset();
  changed_.wait(lock, [&] { return !writing_part_; });
}

void CheckpointWriter::offer(const solver::Pass& pass, std::span<const proto::PassReport> passes,
                             std::shared_ptr<const lightmap::Lightmap> light,
                             std::span<const std::byte> state) {
  if (options_.dir.empty()) return tell(passes);
  std::unique_lock lock(mutex_);
  take_over_bug();
  waiting_ = Offer{{passes.begin(), passes.end()}, std::move(light), {}};
  has_state_ = has_state_ || pass.fills_state;
  if (!pass.completes && has_state_ && !state_on_disk_) waiting_->state = state;
  changed_.notify_all();
  if (options_.share < 1) return;
  lock.unlock();
  flush();
}

void CheckpointWriter::hurry() {
  std::unique_lock lock(mutex_);
  hurried_ = true;
  changed_.notify_all();
  changed_.wait(lock, options_.stop, [&] { return !reads_state(); });
}

bool CheckpointWriter::flush() {
  std::unique_lock lock(mutex_);
  hurried_ = true;
  changed_.notify_all();
  changed_.wait(lock, options_.stop,
                [&] { return bug_ || (!waiting_ && !waiting_part_ && !writing_); });
  take_over_bug();
  hurried_ = false;
  return !options_.stop.stop_requested();
}

void CheckpointWriter::take_over_bug() {
  if (bug_) std::rethrow_exception(std::exchange(bug_, nullptr));
}

bool CheckpointWriter::reads_state() const {
  return writing_state_ || (waiting_ && !waiting_->state.empty());
}

double CheckpointWriter::next_bytes() const {
  if (waiting_) return bytes_of(*waiting_->light) + double(waiting_->state.size());
  const Part& part = *waiting_part_;
  const double share = double(part.progress.texels) / part.after->size();
  return share * (bytes_of(*part.after) + double(part.state.size()));
}

CheckpointWriter::Clock::time_point CheckpointWriter::due() const {
  const double cost = bytes_ > 0 ? seconds_ / bytes_ : kUsualCost;
  const double pause = cost * next_bytes() / (options_.share * options_.threads);
  return last_ + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(pause));
}

/// A part is of no use without the light that its pass began with.
bool CheckpointWriter::is_due() const {
  if (!waiting_ && !waiting_part_) return false;
  const bool precedes_part = waiting_ && waiting_part_;
  return hurried_ || failed_ || precedes_part || options_.share >= 1 || Clock::now() >= due();
}

/// Whether what it began with was never written: it waited for a state that has changed since.
bool CheckpointWriter::has_lost_its_pass(const Part& part) const {
  return !waiting_ && durable_ != part.pass;
}

void CheckpointWriter::loop(const std::stop_token& end) {
  std::unique_lock lock(mutex_);
  while (!end.stop_requested()) {
    if (waiting_part_ && has_lost_its_pass(*waiting_part_)) {
      waiting_part_.reset();
      changed_.notify_all();
    }
    if (!waiting_ && !waiting_part_)
      changed_.wait(lock, end, [&] { return waiting_ || waiting_part_; });
    else if (!is_due())
      changed_.wait_until(lock, end, due(),
                          [&] { return (!waiting_ && !waiting_part_) || is_due(); });
    else
      write_next(lock);
  }
}

void CheckpointWriter::write_next(std::unique_lock<std::mutex>& lock) {
  const double bytes = next_bytes();
  const auto offer = std::exchange(waiting_, std::nullopt);
  const auto part = offer ? std::nullopt : std::exchange(waiting_part_, std::nullopt);
  const PassPart piece = part ? next_part(*part) : PassPart{};
  writing_ = true;
  writing_part_ = part.has_value();
  writing_state_ = !(offer ? offer->state : part->state).empty();
  lock.unlock();
  std::exception_ptr bug;
  const double began = thread_seconds();
  bool written = false;
  try {
    written = offer ? write(*offer) : write(*part, piece);
  } catch (...) {
    bug = std::current_exception();
  }
  lock.lock();
  if (written) {
    seconds_ += thread_seconds() - began;
    bytes_ += bytes;
    stale_parts_ = part.has_value();
    if (part) parts_ = {part->pass, piece.number + 1, part->progress};
    if (offer) durable_ = offer->passes.size();
    state_on_disk_ = state_on_disk_ || (offer && writing_state_);
  }
  if (bug) bug_ = bug;
  writing_ = writing_part_ = writing_state_ = false;
  last_ = Clock::now();
  changed_.notify_all();
}

/// What of it is not on the disk yet.
PassPart CheckpointWriter::next_part(const Part& part) {
  if (parts_.pass != part.pass) parts_ = {part.pass, 0, {}};
  const solver::PassProgress &done = parts_.progress, &now = part.progress;
  return {part.pass,
          parts_.count,
          {done.texels, now.texels},
          now.rays - done.rays,
          now.seconds - done.seconds};
}

/// Whether it is on the disk.
bool CheckpointWriter::write(const Part& part, const PassPart& piece) {
  if (failed_ || piece.texels.begin >= piece.texels.end) return false;
  proto::Expected<void> done;
  try {
    done = write_part(options_.dir, options_.key, piece, *part.before, *part.after, part.state,
                      options_.stop);
  } catch (const std::bad_alloc&) {
    done = no_memory();
  }
  if (!done && !options_.stop.stop_requested()) fail(done.error());
  return done.has_value();
}

/// Whether it is on the disk.
bool CheckpointWriter::write(const Offer& offer) {
  proto::Expected<void> done;
  if (failed_) {
    tell(offer.passes);
    return false;
  }
  try {
    if (!offer.state.empty())
      done = write_state(options_.dir, options_.key, offer.state, options_.stop);
    if (done)
      done =
          write_checkpoint(options_.dir, options_.key, offer.passes, *offer.light, options_.stop);
  } catch (const std::bad_alloc&) {
    done = no_memory();
  }
  if (!done && options_.stop.stop_requested()) return false;
  if (!done) fail(done.error());
  if (done && stale_parts_) remove_parts(options_.dir);
  tell(offer.passes);
  return done.has_value();
}

void CheckpointWriter::fail(const proto::Error& error) {
  {
    const std::lock_guard lock(mutex_);
    failed_ = true;
  }
  remove_checkpoints(options_.dir);  // on a full disk, the results need the room
  listener_.on_failed(error);
}

void CheckpointWriter::tell(std::span<const proto::PassReport> passes) {
  while (told_ < passes.size()) listener_.on_durable(passes[told_++]);
}

}  // namespace kiln::checkpoint
