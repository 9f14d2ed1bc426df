#include "server/http/lobby.h"

#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <new>
#include <system_error>

namespace kiln::http {
namespace {

using Clock = Connection::Clock;
constexpr std::size_t kMaxLingering = 256;
constexpr int kTickMs = 250;  // how late a deadline may be noticed

void watch(int epoll, int fd, std::uint32_t events = EPOLLIN | EPOLLRDHUP) {
  epoll_event event{};
  event.events = events;
  event.data.fd = fd;
  ::epoll_ctl(epoll, EPOLL_CTL_ADD, fd, &event);
}

}  // namespace

Lobby::Lobby(const EdgeLimits& limits, Ready ready, LastWords last_words)
    : limits_(limits),
      ready_(std::move(ready)),
      last_words_(std::move(last_words)),
      epoll_(::epoll_create1(EPOLL_CLOEXEC)) {
  mail_->wake = proto::Fd(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
  if (!epoll_.valid() || !mail_->wake.valid())
    throw std::system_error(errno, std::system_category(), "epoll");
  watch(epoll_.get(), mail_->wake.get());
  thread_ = std::thread([this] { loop(); });
}

Lobby::~Lobby() {
  stop();
}

void Lobby::stop() {
  stopping_ = true;
  mail_->ring();
  if (thread_.joinable()) thread_.join();
}

void Lobby::Mail::ring() const {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t full_is_fine = ::write(wake.get(), &one, sizeof one);
}

std::shared_ptr<Lobby::Bell> Lobby::bell(const Connection& connection) const {
  return std::make_shared<Bell>(mail_, connection.fd());
}

// The flag is set before the lobby is told, and the lobby looks at it when it takes the connection
// in: one of the two finds the other.
void Lobby::Bell::ring(const std::shared_ptr<Bell>& bell) noexcept {
  if (bell->rung_.exchange(true)) return;
  Mail& mail = *bell->mail_;
  bool first = false;
  try {
    const std::lock_guard lock(mail.mutex);
    if (mail.closed) return;
    first = mail.rung.empty();
    mail.rung.push_back(bell);
  } catch (const std::bad_alloc&) {  // its connection goes on at its deadline
  }
  if (first) mail.ring();
}

void Lobby::ring_all() {
  {
    const std::lock_guard lock(mail_->mutex);
    mail_->all_rung = true;
  }
  mail_->ring();
}

void Lobby::adopt(std::unique_ptr<Connection> connection, bool fresh) {
  connection->deadline = Clock::now() + (fresh ? limits_.head_deadline : limits_.keep_alive);
  enter({std::move(connection), Mode::kIdle});
}

void Lobby::linger(std::unique_ptr<Connection> connection) {
  connection->release_place();
  connection->shut_down_writing();
  connection->deadline = Clock::now() + limits_.linger;
  enter({std::move(connection), Mode::kLinger});
}

void Lobby::park(std::unique_ptr<Connection> connection, std::shared_ptr<Bell> bell,
                 Resume resume) {
  enter({std::move(connection), Mode::kParked, std::move(bell), std::move(resume)});
}

void Lobby::enter(Guest guest) {
  {
    const std::lock_guard lock(mail_->mutex);
    if (mail_->closed) return;  // closes it
    mail_->arrivals.push_back(std::move(guest));
  }
  mail_->ring();
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
      if (fd != mail_->wake.get()) {
        if (!attempt([&] { on_socket(fd); }) && guests_.contains(fd)) drop(fd);
        continue;
      }
      std::uint64_t count = 0;
      [[maybe_unused]] const ssize_t got = ::read(fd, &count, sizeof count);
    }
    attempt([&] { take_mail(); });
    if (Clock::now() < next_tick) continue;
    attempt([&] { expire(); });
    next_tick = Clock::now() + std::chrono::milliseconds(kTickMs);
  }
  guests_.clear();
  std::vector<Guest> closed;  // goes without the lock, as do the bells, which have the mail
  std::vector<std::shared_ptr<Bell>> rung;
  const std::lock_guard lock(mail_->mutex);
  mail_->closed = true;
  closed.swap(mail_->arrivals);
  rung.swap(mail_->rung);
}

void Lobby::take_mail() {
  std::vector<Guest> arrivals;
  std::vector<std::shared_ptr<Bell>> rung;
  bool ring_all = false;
  {
    const std::lock_guard lock(mail_->mutex);
    arrivals.swap(mail_->arrivals);
    rung.swap(mail_->rung);
    ring_all = mail_->all_rung && !all_rung_;
    all_rung_ = mail_->all_rung;
  }
  for (const auto& bell : rung) {
    const auto found = guests_.find(bell->fd_);
    // Another bell's, when its own connection has gone and the number is in use again.
    if (found != guests_.end() && found->second.bell == bell)
      attempt([&] { resume(bell->fd_, End::kRung); });
  }
  if (ring_all) {
    for (auto at = guests_.begin(); at != guests_.end();) {
      const auto& [fd, guest] = *at++;  // which takes itself out
      if (guest.mode == Mode::kParked) attempt([&, number = fd] { resume(number, End::kRung); });
    }
  }
  for (auto& guest : arrivals) attempt([&] { admit(std::move(guest)); });
}

void Lobby::admit(Guest guest) {
  const int fd = guest.connection->fd();
  const bool leaving = guest.mode == Mode::kLinger;
  if (leaving && lingering_ >= kMaxLingering) return;  // closes it
  const bool parked = guest.mode == Mode::kParked;
  guests_[fd] = std::move(guest);
  if (leaving) ++lingering_;
  if (parked) {
    // Only for its end: what the peer sends meanwhile must not keep the thread busy.
    watch(epoll_.get(), fd, EPOLLRDHUP);
    if (all_rung_ || guests_.at(fd).bell->rung_) resume(fd, End::kRung);
    return;
  }
  watch(epoll_.get(), fd);
  look_at(fd);  // bytes of the next request may be in its buffer already
}

void Lobby::drop(int fd) {
  ::epoll_ctl(epoll_.get(), EPOLL_CTL_DEL, fd, nullptr);
  const auto found = guests_.find(fd);
  if (found->second.mode == Mode::kLinger) --lingering_;
  guests_.erase(found);
}

void Lobby::on_socket(int fd) {
  const auto found = guests_.find(fd);
  if (found == guests_.end()) return;
  if (found->second.mode == Mode::kParked) return resume(fd, End::kGone);
  look_at(fd);
}

void Lobby::resume(int fd, End end) {
  Guest guest = std::move(guests_.at(fd));
  drop(fd);
  guest.resume(std::move(guest.connection), end);
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
    if (guests_.at(fd).mode == Mode::kParked) {
      attempt([&] { resume(fd, End::kLate); });
      continue;
    }
    Guest guest = std::move(guests_.at(fd));
    drop(fd);
    if (guest.mode == Mode::kHead) begin_linger(std::move(guest), "request_timeout");
  }
}

}  // namespace kiln::http
