#include "server/http/lobby.h"

#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <new>
#include <system_error>

namespace kiln::server {
namespace {

using Clock = Connection::Clock;
constexpr std::size_t kMaxLingering = 256;
constexpr int kTickMs = 250;  // how late a deadline may be noticed

void watch(int epoll, int fd) {
  epoll_event event{};
  event.events = EPOLLIN | EPOLLRDHUP;
  event.data.fd = fd;
  ::epoll_ctl(epoll, EPOLL_CTL_ADD, fd, &event);
}

}  // namespace

Lobby::Lobby(const EdgeLimits& limits, Ready ready, LastWords last_words)
    : limits_(limits),
      ready_(std::move(ready)),
      last_words_(std::move(last_words)),
      epoll_(::epoll_create1(EPOLL_CLOEXEC)),
      wake_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
  if (!epoll_.valid() || !wake_.valid())
    throw std::system_error(errno, std::system_category(), "epoll");
  watch(epoll_.get(), wake_.get());
  thread_ = std::thread([this] { loop(); });
}

Lobby::~Lobby() {
  stop();
}

void Lobby::stop() {
  stopping_ = true;
  wake();
  if (thread_.joinable()) thread_.join();
}

void Lobby::wake() const {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t full_is_fine = ::write(wake_.get(), &one, sizeof one);
}

void Lobby::adopt(std::unique_ptr<Connection> connection, bool fresh) {
  connection->deadline = Clock::now() + (fresh ? limits_.head_deadline : limits_.keep_alive);
  enter(std::move(connection), Mode::kIdle);
}

void Lobby::linger(std::unique_ptr<Connection> connection) {
  connection->release_place();
  connection->shut_down_writing();
  connection->deadline = Clock::now() + limits_.linger;
  enter(std::move(connection), Mode::kLinger);
}

void Lobby::enter(std::unique_ptr<Connection> connection, Mode mode) {
  if (stopping_) return;  // closes it
  {
    const std::lock_guard lock(mutex_);
    arrivals_.push_back({std::move(connection), mode});
  }
  wake();
}

template <class Step>
bool Lobby::attempt(const Step& step) {
  try {
    step();
    return true;
  } catch (const std::bad_alloc&) {
    return false;
  }
}

void Lobby::loop() {
  std::array<epoll_event, 256> events{};
  auto next_tick = Clock::now();
  while (!stopping_) {
    const int n = ::epoll_wait(epoll_.get(), events.data(), events.size(), kTickMs);
    for (int i = 0; i < n; ++i) {
      const int fd = events[static_cast<std::size_t>(i)].data.fd;
      if (fd != wake_.get()) {
        if (!attempt([&] { look_at(fd); }) && guests_.contains(fd)) drop(fd);
        continue;
      }
      std::uint64_t count = 0;
      [[maybe_unused]] const ssize_t got = ::read(fd, &count, sizeof count);
    }
    attempt([&] { take_arrivals(); });
    if (Clock::now() < next_tick) continue;
    attempt([&] { expire(); });
    next_tick = Clock::now() + std::chrono::milliseconds(kTickMs);
  }
  guests_.clear();
  const std::lock_guard lock(mutex_);
  arrivals_.clear();
}

void Lobby::take_arrivals() {
  std::vector<Guest> arrivals;
  {
    const std::lock_guard lock(mutex_);
    arrivals.swap(arrivals_);
  }
  for (auto& guest : arrivals) attempt([&] { admit(std::move(guest)); });
}

void Lobby::admit(Guest guest) {
  const int fd = guest.connection->fd();
  const bool leaving = guest.mode == Mode::kLinger;
  if (leaving && lingering_ >= kMaxLingering) return;  // closes it
  guests_[fd] = std::move(guest);
  if (leaving) ++lingering_;
  watch(epoll_.get(), fd);
  look_at(fd);  // bytes of the next request may be in its buffer already
}

void Lobby::drop(int fd) {
  ::epoll_ctl(epoll_.get(), EPOLL_CTL_DEL, fd, nullptr);
  const auto found = guests_.find(fd);
  if (found->second.mode == Mode::kLinger) --lingering_;
  guests_.erase(found);
}

void Lobby::look_at(int fd) {
  const auto found = guests_.find(fd);
  if (found == guests_.end()) return;
  Guest& guest = found->second;
  if (guest.mode == Mode::kLinger) {
    if (!guest.connection->discard()) drop(fd);
    return;
  }
  const auto fill = guest.connection->fill();
  if (fill == Connection::Fill::kMore) {
    if (guest.mode == Mode::kIdle && guest.connection->has_bytes()) {
      guest.mode = Mode::kHead;
      guest.connection->deadline =
          std::min(guest.connection->deadline, Clock::now() + limits_.head_deadline);
    }
    return;
  }
  Guest leaving = std::move(guest);
  drop(fd);
  if (fill == Connection::Fill::kHead) ready_(std::move(leaving.connection));
  if (fill == Connection::Fill::kTooLarge) begin_linger(std::move(leaving), "headers_too_large");
}

void Lobby::begin_linger(Guest guest, const char* code) {
  guest.connection->release_place();
  guest.connection->write_at_once(last_words_(code));
  guest.connection->shut_down_writing();
  guest.connection->deadline = Clock::now() + limits_.linger;
  guest.mode = Mode::kLinger;
  admit(std::move(guest));
}

void Lobby::expire() {
  const auto now = Clock::now();
  std::vector<int> late;
  for (const auto& [fd, guest] : guests_)
    if (guest.connection->deadline <= now) late.push_back(fd);
  for (const int fd : late) {
    Guest guest = std::move(guests_.at(fd));
    drop(fd);
    if (guest.mode == Mode::kHead) begin_linger(std::move(guest), "request_timeout");
  }
}

}  // namespace kiln::server
