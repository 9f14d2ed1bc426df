#include "server/base/memory_budget.h"

#include <algorithm>
#include <utility>

#include "proto/job.h"

namespace kiln::base {
namespace {

proto::Unexpected overloaded() {
  return proto::fail("overloaded", "Too many scenes are being read at once.");
}

}  // namespace

MemoryBudget::MemoryBudget(std::uint64_t bytes, Imports imports)
    : bytes_(bytes), imports_(imports) {
  if (bytes_ == 0 || imports_.processes == 0) return;
  if (imports_.most_bytes > 0)
    imports_.least_bytes = std::min(imports_.least_bytes, imports_.most_bytes);
  const std::uint64_t quarter = bytes_ / 4;
  imports_.floor_bytes = std::min(imports_.floor_bytes, imports_.least_bytes);
  if (quarter / imports_.processes < imports_.floor_bytes) {
    imports_.processes = std::uint32_t(std::max<std::uint64_t>(quarter / imports_.floor_bytes, 1));
    imports_.least_bytes = std::min(imports_.floor_bytes, bytes_ / 2);
  } else {
    imports_.least_bytes = std::min(imports_.least_bytes, quarter / imports_.processes);
  }
  set_aside_ = imports_.least_bytes * imports_.processes;
}

std::uint64_t MemoryBudget::for_bakes() const {
  return bytes_ == 0 ? UINT64_MAX : bytes_ - set_aside_;
}

std::uint64_t MemoryBudget::free_without_waiting() const {
  std::uint64_t free = for_bakes() - std::min(for_bakes(), taken_);
  for (const auto& [job, taken] : reserved_) free -= std::min(free, taken);
  return free;
}

std::uint64_t MemoryBudget::free_bytes() const {
  if (bytes_ == 0) return UINT64_MAX;
  const std::lock_guard lock(mutex_);
  const std::uint64_t free = free_without_waiting() + spare_bytes();
  return free - std::min(free, wanted_);
}

bool MemoryBudget::imports_are_modest() const {
  const std::lock_guard lock(mutex_);
  return taken_ == 0 && wanted_ == 0;
}

std::uint64_t MemoryBudget::own(const std::string& job) const {
  const auto had = reserved_.find(job);
  return had == reserved_.end() ? 0 : had->second;
}

bool MemoryBudget::reserve(const std::string& job, std::uint64_t bytes) {
  std::unique_lock lock(mutex_);
  const auto missing = [&]() -> std::uint64_t {
    if (bytes_ == 0) return 0;
    const std::uint64_t needed = bytes > own(job) ? bytes + wanted_ : bytes;
    return needed - std::min(needed, free_without_waiting() + own(job));
  };
  while (missing() > 0)
    if (missing() > spare_bytes() || !give_back(lock, missing())) return false;
  const bool less = bytes < own(job);
  reserved_[job] = bytes;
  if (less) changed_.notify_all();
  return true;
}

bool MemoryBudget::give_back(std::unique_lock<std::mutex>& lock, std::uint64_t missing) {
  const std::uint64_t bytes = std::min(missing, spare_bytes());
  if (bytes == 0) return false;
  lock.unlock();
  const bool gave = spare_.give_back(bytes);
  lock.lock();
  return gave;
}

void MemoryBudget::announce() {
  {
    std::unique_lock lock(mutex_);
    while (give_back(lock, wanted_ - std::min(wanted_, free_without_waiting()))) {
    }
  }
  changed_.notify_all();
  if (hook_) hook_();
}

void MemoryBudget::release(const std::string& job) {
  const std::lock_guard lock(mutex_);
  reserved_.erase(job);
  changed_.notify_all();
}

std::uint64_t MemoryBudget::reserved() const {
  const std::lock_guard lock(mutex_);
  std::uint64_t all = 0;
  for (const auto& [job, bytes] : reserved_) all += bytes;
  return all;
}

std::uint64_t MemoryBudget::reserved(const std::string& job) const {
  const std::lock_guard lock(mutex_);
  return own(job);
}

std::uint64_t MemoryBudget::for_import() const {
  if (bytes_ == 0) return imports_.most_bytes;
  const std::uint64_t all = imports_.least_bytes + for_bakes();
  return imports_.most_bytes == 0 ? all : std::min(all, imports_.most_bytes);
}

std::uint64_t MemoryBudget::beyond_least(std::uint64_t bytes) const {
  return bytes - std::min(bytes, imports_.least_bytes);
}

proto::Expected<MemoryBudget::Place> MemoryBudget::enter(
    std::uint64_t bytes, std::stop_token stop, std::optional<std::chrono::milliseconds> patience,
    const std::string& job) {
  const std::uint64_t given =
      bytes_ == 0 ? for_import() : std::clamp(bytes, imports_.least_bytes, for_import());
  const std::uint64_t beyond = bytes_ == 0 ? 0 : beyond_least(given);
  std::unique_lock lock(mutex_);
  while (crowded_ && running_ >= imports_.processes) {
    lock.unlock();
    const bool gave_up_one = crowded_();
    lock.lock();
    if (!gave_up_one) break;
  }
  const auto missing = [&] {
    const std::uint64_t needed = beyond - std::min(beyond, own(job));
    return needed - std::min(needed, free_without_waiting());
  };
  while (give_back(lock, missing())) {
  }
  if (patience && impatient_ >= imports_.impatient &&
      (running_ >= imports_.processes || (beyond > 0 && !line_.empty()) ||
       beyond > free_without_waiting()))
    return overloaded();
  const std::uint64_t own = this->own(job);
  const std::uint64_t more = beyond - std::min(beyond, own);
  if (more > 0) reserved_.erase(job);
  const std::uint64_t needed = more > 0 ? beyond : 0;
  const std::uint64_t ticket = needed > 0 ? ++last_ticket_ : 0;
  const auto free = [&] {
    return running_ < imports_.processes &&
           (needed == 0 || (*line_.begin() == ticket && needed <= free_without_waiting()));
  };
  if (needed > 0) line_.insert(ticket);
  wanted_ += needed;
  if (more > 0 && own > 0) changed_.notify_all();
  impatient_ += patience ? 1 : 0;
  const bool there =
      patience ? changed_.wait_for(lock, stop, *patience, free) : changed_.wait(lock, stop, free);
  impatient_ -= patience ? 1 : 0;
  wanted_ -= needed;
  if (needed > 0) {
    line_.erase(ticket);
    changed_.notify_all();  // the next in line
  }
  if (!there) {
    lock.unlock();
    if (hook_ && needed > 0) hook_();
    if (stop.stop_requested()) return proto::canceled();
    return overloaded();
  }
  ++running_;
  taken_ += more;
  if (more > 0 && own > 0) reserved_[job] = own;
  return Place(*this, given, more);
}

void MemoryBudget::leave(std::uint64_t taken) {
  std::shared_ptr<const std::function<void()>> woken;
  {
    const std::lock_guard lock(mutex_);
    --running_;
    taken_ -= taken;
    for (; !woken && !watches_.empty(); watches_.pop_front()) woken = watches_.front().lock();
  }
  changed_.notify_all();
  if (woken) (*woken)();
  if (hook_ && taken > 0) hook_();
}

std::shared_ptr<const void> MemoryBudget::watch(std::function<void()> wake) {
  const auto watch = std::make_shared<const std::function<void()>>(std::move(wake));
  const std::lock_guard lock(mutex_);
  watches_.remove_if([](const auto& other) { return other.expired(); });
  watches_.push_back(watch);
  return watch;
}

std::optional<MemoryBudget::Loan> MemoryBudget::borrow(std::uint64_t bytes) {
  std::string name;
  {
    const std::lock_guard lock(mutex_);
    name = "loan " + std::to_string(++last_loan_);  // no job has such an id
  }
  if (!reserve(name, bytes)) return std::nullopt;
  return Loan(*this, std::move(name));
}

MemoryBudget::Loan::Loan(Loan&& other) noexcept
    : budget_(std::exchange(other.budget_, nullptr)), name_(std::move(other.name_)) {}

MemoryBudget::Loan::~Loan() {
  if (!budget_) return;
  budget_->release(name_);
  if (budget_->hook_) budget_->hook_();
}

MemoryBudget::Place::Place(Place&& other) noexcept
    : budget_(std::exchange(other.budget_, nullptr)), bytes_(other.bytes_), taken_(other.taken_) {}

MemoryBudget::Place::~Place() {
  if (budget_) budget_->leave(taken_);
}

}  // namespace kiln::base
