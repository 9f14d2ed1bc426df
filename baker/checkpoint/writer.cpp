#include "baker/checkpoint/writer.h"

#include <time.h>

#include <new>
#include <utility>

#include "baker/checkpoint/parts.h"
#include "baker/checkpoint/store.h"

namespace kiln::checkpoint {
namespace {

/// The processor time per byte before any has been measured, seconds.
constexpr double kUsualCost = 1.5e-9;

/// From this size of light on, memory counts more than the time that a pass waits for the disk.
constexpr double kManyBytes = 32 << 20;

proto::Unexpected no_memory() {
  return proto::fail("out_of_memory", "There is no memory to write a checkpoint.");
}

double thread_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

/// Returns the bytes that a file of the pass holds.
double bytes_of(const lightmap::Lightmap& light, bool with_shared) {
  auto planes = light.planes();
  if (!with_shared) planes &= ~lightmap::shared_planes();
  return double(light.texel_bytes(planes)) * light.size();
}

}  // namespace

CheckpointWriter::CheckpointWriter(Options options, Listener listener, std::size_t known)
    : options_(std::move(options)),
      listener_(std::move(listener)),
      known_(known),
      notified_(known),
      durable_(known),
      shared_is_on_disk_(known > 0) {
  if (!options_.dir.empty())
    thread_ = std::jthread([this](const std::stop_token& end) { loop(end); });
}

CheckpointWriter::~CheckpointWriter() {
  thread_ = {};
}

void CheckpointWriter::begin_pass(const solver::PassPlan& plan) {
  std::unique_lock lock(mutex_);
  if (fills_shared(plan) || plan.completes) release_shared(lock);
  // This waits, since the light of the pass before the last would be a third one in memory.
  if (waiting_ && bytes_of(*waiting_->light, false) > kManyBytes)
    changed_.wait(lock, [&] { return !writing_; });
  shared_is_on_disk_ = shared_is_on_disk_ && !fills_shared(plan);
}

void CheckpointWriter::release_shared(std::unique_lock<std::mutex>& lock) {
  if (waiting_ && waiting_->with_shared) waiting_.reset();
  if (waiting_part_ && fills_shared(waiting_part_->plan)) waiting_part_.reset();
  changed_.wait(lock, [&] { return !writing_shared_; });
}

solver::PassProgress CheckpointWriter::restore(const solver::PassPlan& plan,
                                               const lightmap::Lightmap& before,
                                               lightmap::Lightmap& after) {
  if (options_.dir.empty() || plan.index != known_) return {};
  const StoredParts stored =
      read_parts(options_.dir, options_.key, plan, before, after, options_.stop);
  const std::lock_guard lock(mutex_);
  parts_ = {plan.index, stored.count, stored.progress};
  return stored.progress;
}

void CheckpointWriter::submit_part(const solver::PassPlan& plan,
                                   std::shared_ptr<const lightmap::Lightmap> after,
                                   const solver::PassProgress& progress) {
  std::unique_lock lock(mutex_);
  if (options_.dir.empty() || failed_) return;
  waiting_part_ = Part{plan, std::move(after), progress};
  changed_.notify_all();
  if (options_.share >= 1)
    changed_.wait(lock, options_.stop, [&] { return !waiting_part_ && !writing_; });
}

void CheckpointWriter::end_parts() {
  std::unique_lock lock(mutex_);
  waiting_part_.reset();
  changed_.wait(lock, [&] { return !writing_part_; });
}

void CheckpointWriter::submit(const solver::PassPlan& plan,
                              std::span<const proto::PassReport> passes,
                              std::shared_ptr<const lightmap::Lightmap> light) {
  if (options_.dir.empty()) return notify(passes);
  std::unique_lock lock(mutex_);
  rethrow_bug();
  shared_is_filled_ = shared_is_filled_ || fills_shared(plan);
  const bool with_shared = !plan.completes && shared_is_filled_ && !shared_is_on_disk_;
  if (!with_shared && light->has_shared()) {
    // The light that waits keeps no plane that is not written.
    auto rest = std::make_shared<lightmap::Lightmap>(*light);
    rest->drop_shared();
    light = std::move(rest);
  }
  waiting_ = Submitted{{passes.begin(), passes.end()}, std::move(light), with_shared};
  changed_.notify_all();
  if (options_.share < 1) return;
  lock.unlock();
  flush();
}

void CheckpointWriter::write_now() {
  const std::lock_guard lock(mutex_);
  now_ = true;
  changed_.notify_all();
}

bool CheckpointWriter::flush() {
  std::unique_lock lock(mutex_);
  now_ = true;
  changed_.notify_all();
  changed_.wait(lock, options_.stop,
                [&] { return bug_ || (!waiting_ && !waiting_part_ && !writing_); });
  rethrow_bug();
  now_ = false;
  return !options_.stop.stop_requested();
}

void CheckpointWriter::rethrow_bug() {
  if (bug_) std::rethrow_exception(std::exchange(bug_, nullptr));
}

double CheckpointWriter::next_bytes() const {
  if (waiting_) return bytes_of(*waiting_->light, waiting_->with_shared);
  const Part& part = *waiting_part_;
  return double(part.progress.texels) * double(part.after->texel_bytes(part.plan.writes));
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
  return now_ || failed_ || precedes_part || options_.share >= 1 || Clock::now() >= due();
}

/// Returns whether the light that the part began with was never written: it waited for shared
/// planes that have changed since.
bool CheckpointWriter::has_lost_its_pass(const Part& part) const {
  return !waiting_ && durable_ != part.plan.index;
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
  auto light = std::exchange(waiting_, std::nullopt);
  auto part = light ? std::nullopt : std::exchange(waiting_part_, std::nullopt);
  const NewPart piece = part ? next_part(*part) : NewPart{};
  const bool with_shared = light ? light->with_shared : fills_shared(part->plan);
  writing_ = true;
  writing_part_ = part.has_value();
  writing_shared_ = with_shared;
  lock.unlock();
  std::exception_ptr bug;
  const double began = thread_seconds();
  bool written = false;
  try {
    written = light ? write(*light) : write(*part, piece);
  } catch (...) {
    bug = std::current_exception();
  }
  lock.lock();
  if (written) {
    seconds_ += thread_seconds() - began;
    bytes_ += bytes;
    stale_parts_ = part.has_value();
    if (part) parts_ = {part->plan.index, piece.number + 1, part->progress};
    if (light) durable_ = light->passes.size();
    shared_is_on_disk_ = shared_is_on_disk_ || (light && with_shared);
  }
  light.reset(), part.reset();
  if (bug) bug_ = bug;
  writing_ = writing_part_ = writing_shared_ = false;
  last_ = Clock::now();
  changed_.notify_all();
}

/// Returns what the part adds to those on the disk.
CheckpointWriter::NewPart CheckpointWriter::next_part(const Part& part) {
  if (parts_.pass != part.plan.index) parts_ = {part.plan.index, 0, {}};
  const solver::PassProgress &done = parts_.progress, &now = part.progress;
  lightmap::PatchHead head;
  head.pass = part.plan.index;
  head.texels = {done.texels, now.texels};
  head.writes = part.plan.writes;
  head.rays = now.rays - done.rays;
  head.seconds = now.seconds - done.seconds;
  return {parts_.count, head};
}

/// Returns whether it is on the disk.
bool CheckpointWriter::write(const Part& part, const NewPart& piece) {
  if (failed_ || piece.head.texels.begin >= piece.head.texels.end) return false;
  proto::Expected<void> done;
  try {
    done = write_part(options_.dir, options_.key, piece.number, piece.head, *part.after,
                      options_.stop);
  } catch (const std::bad_alloc&) {
    done = no_memory();
  }
  if (!done && !options_.stop.stop_requested()) fail(done.error());
  return done.has_value();
}

/// Returns whether it is on the disk.
bool CheckpointWriter::write(const Submitted& light) {
  proto::Expected<void> done;
  if (failed_) {
    notify(light.passes);
    return false;
  }
  try {
    if (light.with_shared)
      done = write_shared(options_.dir, options_.key, *light.light, options_.stop);
    if (done)
      done =
          write_checkpoint(options_.dir, options_.key, light.passes, *light.light, options_.stop);
  } catch (const std::bad_alloc&) {
    done = no_memory();
  }
  if (!done && options_.stop.stop_requested()) return false;
  if (!done) fail(done.error());
  if (done && stale_parts_) remove_parts(options_.dir);
  notify(light.passes);
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

void CheckpointWriter::notify(std::span<const proto::PassReport> passes) {
  while (notified_ < passes.size()) listener_.on_durable(passes[notified_++]);
}

}  // namespace kiln::checkpoint
