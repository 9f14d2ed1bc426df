#include "baker/solver/checkpoint_writer.h"

#include <time.h>

#include <new>
#include <utility>

#include "baker/solver/checkpoint.h"

namespace kiln::baker {
namespace {

/// Processor time per byte before any has been measured, seconds.
constexpr double kUsualCost = 1.5e-9;

/// Of light: from here on memory counts more than the time that a pass waits for the disk.
constexpr double kManyBytes = 32 << 20;

double thread_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

double bytes_of(const Lightmap& light) {
  double all = 0;
  Lightmap::for_planes(light, [&](const auto& plane) {
    all += double(plane.size()) * sizeof(plane.values().front());
  });
  return all;
}

}  // namespace

CheckpointWriter::CheckpointWriter(Options options, Listener listener, std::size_t known)
    : options_(std::move(options)),
      listener_(std::move(listener)),
      told_(known),
      state_on_disk_(known > 0) {
  if (!options_.dir.empty())
    thread_ = std::jthread([this](const std::stop_token& end) { loop(end); });
}

CheckpointWriter::~CheckpointWriter() {
  thread_ = {};
}

void CheckpointWriter::before(const Pass& pass) {
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
  changed_.wait(lock, [&] { return !writing_state_; });
}

void CheckpointWriter::offer(const Pass& pass, std::span<const proto::PassReport> passes,
                             std::shared_ptr<const Lightmap> light,
                             std::span<const std::byte> state) {
  if (options_.dir.empty()) return tell(passes);
  std::unique_lock lock(mutex_);
  take_over_bug();
  waiting_ = Offer{{passes.begin(), passes.end()}, std::move(light), {}};
  if (!pass.completes && !state_on_disk_) waiting_->state = state;
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
  changed_.wait(lock, options_.stop, [&] { return bug_ || (!waiting_ && !writing_); });
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

CheckpointWriter::Clock::time_point CheckpointWriter::due() const {
  const double cost = bytes_ > 0 ? seconds_ / bytes_ : kUsualCost;
  const double bytes = bytes_of(*waiting_->light) + double(waiting_->state.size());
  const double pause = cost * bytes / (options_.share * options_.threads);
  return last_ + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(pause));
}

bool CheckpointWriter::is_due() const {
  return waiting_ && (hurried_ || failed_ || Clock::now() >= due());
}

void CheckpointWriter::loop(const std::stop_token& end) {
  std::unique_lock lock(mutex_);
  while (!end.stop_requested()) {
    if (!waiting_) {
      changed_.wait(lock, end, [&] { return waiting_.has_value(); });
      continue;
    }
    if (!is_due()) {
      changed_.wait_until(lock, end, due(), [&] { return !waiting_ || is_due(); });
      continue;
    }
    const Offer offer = *std::exchange(waiting_, std::nullopt);
    writing_ = true;
    writing_state_ = !offer.state.empty();
    lock.unlock();
    std::exception_ptr bug;
    const double began = thread_seconds();
    bool written = false;
    try {
      written = write(offer);
    } catch (...) {
      bug = std::current_exception();
    }
    lock.lock();
    if (written) {
      seconds_ += thread_seconds() - began;
      bytes_ += bytes_of(*offer.light) + double(offer.state.size());
      state_on_disk_ = state_on_disk_ || writing_state_;
    }
    if (bug) bug_ = bug;
    writing_ = writing_state_ = false;
    last_ = Clock::now();
    changed_.notify_all();
  }
}

/// Whether it is on the disk.
bool CheckpointWriter::write(const Offer& offer) {
  proto::Expected<void> done;
  bool written = false;
  if (!failed_) {
    try {
      if (!offer.state.empty())
        done = write_state(options_.dir, options_.key, offer.state, options_.stop);
      if (done)
        done =
            write_checkpoint(options_.dir, options_.key, offer.passes, *offer.light, options_.stop);
    } catch (const std::bad_alloc&) {
      done = proto::fail("out_of_memory", "There is no memory to write a checkpoint.");
    }
    written = done.has_value();
    if (!written && options_.stop.stop_requested()) return false;
  }
  if (!done) {
    {
      const std::lock_guard lock(mutex_);
      failed_ = true;
    }
    remove_checkpoints(options_.dir);  // on a full disk, the results need the room
    listener_.on_failed(done.error());
  }
  tell(offer.passes);
  return written;
}

void CheckpointWriter::tell(std::span<const proto::PassReport> passes) {
  while (told_ < passes.size()) listener_.on_durable(passes[told_++]);
}

}  // namespace kiln::baker
