#include "server/http/loop.h"

#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <future>
#include <new>
#include <system_error>

namespace kiln::http {
namespace {

constexpr Loop::Id kWake = 0;

/// Runs one step. When memory is short, this costs what the step was for, not the service. Returns
/// false then.
template <class Step>
bool attempt(const Step& step) {
  try {
    step();
    return true;
  } catch (const std::bad_alloc&) {
    return false;
  }
}

}  // namespace

Inbox::Inbox() : wake_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
  if (!wake_.valid()) throw std::system_error(errno, std::system_category(), "eventfd");
}

bool Inbox::post(Task task) noexcept {
  bool first = false;
  try {
    const std::lock_guard lock(mutex_);
    if (closed_) return false;
    first = tasks_.empty();
    tasks_.push_back(std::move(task));
  } catch (const std::bad_alloc&) {
    return false;
  }
  const std::uint64_t one = 1;
  if (first) [[maybe_unused]]
    const ssize_t full_is_fine = ::write(wake_.get(), &one, sizeof one);
  return true;
}

bool Inbox::closed() {
  const std::lock_guard lock(mutex_);
  return closed_;
}

std::vector<Inbox::Task> Inbox::take() {
  std::uint64_t count = 0;
  [[maybe_unused]] const ssize_t got = ::read(wake_.get(), &count, sizeof count);
  const std::lock_guard lock(mutex_);
  return std::exchange(tasks_, {});
}

std::vector<Inbox::Task> Inbox::close() {
  const std::lock_guard lock(mutex_);
  closed_ = true;
  return std::exchange(tasks_, {});
}

Loop::Loop() : epoll_(::epoll_create1(EPOLL_CLOEXEC)) {
  if (!epoll_.valid()) throw std::system_error(errno, std::system_category(), "epoll");
  epoll_event event{};
  event.events = EPOLLIN;
  event.data.u64 = kWake;
  ::epoll_ctl(epoll_.get(), EPOLL_CTL_ADD, inbox_->wake_.get(), &event);
  thread_ = std::thread([this] { run(); });
}

Loop::~Loop() {
  stop();
}

void Loop::stop() {
  if (!thread_.joinable()) return;
  stopping_ = true;
  inbox_->post([] {});
  thread_.join();
}

// A loop that has stopped has no thread that the task could disturb.
void Loop::call(const Inbox::Task& task) {
  const auto done = std::make_shared<std::promise<void>>();
  const Inbox::Task run = [done, &task] {
    try {
      task();
      done->set_value();
    } catch (...) {
      done->set_exception(std::current_exception());
    }
  };
  while (!inbox_->post(run))
    if (inbox_->closed()) return task();
  done->get_future().get();
}

void Loop::attach(Watcher& watcher) {
  call([&] { watchers_.push_back(&watcher); });
}

void Loop::detach(Watcher& watcher) {
  call([&] {
    if (std::erase(watchers_, &watcher) > 0) watcher.on_detach();
  });
}

Loop::Id Loop::add(int fd, std::uint32_t events, Watcher& watcher) {
  const Id id = ++last_id_;
  sockets_.emplace(id, &watcher);
  epoll_event event{};
  event.events = events;
  event.data.u64 = id;
  ::epoll_ctl(epoll_.get(), EPOLL_CTL_ADD, fd, &event);
  return id;
}

void Loop::modify(Id id, int fd, std::uint32_t events) {
  epoll_event event{};
  event.events = events;
  event.data.u64 = id;
  ::epoll_ctl(epoll_.get(), EPOLL_CTL_MOD, fd, &event);
}

void Loop::remove(Id id, int fd) noexcept {
  sockets_.erase(id);
  ::epoll_ctl(epoll_.get(), EPOLL_CTL_DEL, fd, nullptr);
}

void Loop::run() {
  while (!stopping_) turn();
  for (Watcher* watcher : std::exchange(watchers_, {})) watcher->on_detach();
  run_tasks(inbox_->close());  // other threads may wait for them
}

void Loop::turn() {
  std::array<epoll_event, 256> events{};
  auto next = Clock::time_point::max();
  for (const Watcher* watcher : watchers_) next = std::min(next, watcher->next_time());
  // The time is rounded up, because a deadline is over when its time is.
  const auto now = Clock::now();
  const auto left = next <= now ? std::chrono::milliseconds(0)
                                : std::chrono::ceil<std::chrono::milliseconds>(
                                      std::min<Clock::duration>(next - now, std::chrono::hours(1)));
  const int count =
      ::epoll_wait(epoll_.get(), events.data(), events.size(), static_cast<int>(left.count()));
  for (int i = 0; i < count; ++i) {
    const epoll_event& event = events[static_cast<std::size_t>(i)];
    if (event.data.u64 == kWake)
      run_tasks(inbox_->take());
    else
      dispatch(event.data.u64, event.events);
  }
  const auto after = Clock::now();
  for (std::size_t i = 0; i < watchers_.size(); ++i)
    if (watchers_[i]->next_time() <= after) attempt([&] { watchers_[i]->on_time(after); });
}

// An earlier event of this turn may have closed this one's socket.
void Loop::dispatch(Id id, std::uint32_t events) {
  const auto found = sockets_.find(id);
  if (found == sockets_.end()) return;
  Watcher& watcher = *found->second;
  if (!attempt([&] { watcher.on_events(id, events); })) watcher.drop(id);
}

void Loop::run_tasks(std::vector<Inbox::Task> tasks) {
  for (Inbox::Task& task : tasks) {
    attempt(task);
    task = nullptr;  // this frees what the task holds
  }
}

}  // namespace kiln::http
