#include "server/http/waiting_connections.h"

#include <sys/epoll.h>

#include <algorithm>
#include <new>

namespace kiln::http {
namespace {

using Clock = Loop::Clock;
constexpr std::size_t kMaxLingering = 256;

template <class Step>
void attempt(const Step& step) {
  try {
    step();
  } catch (const std::bad_alloc&) {  // it costs the connection that needed the memory
  }
}

}  // namespace

// The flag is set before the loop is woken, and the loop looks at it when it parks the connection:
// one of the two finds the other.
void Waker::wake(const std::shared_ptr<Waker>& waker) noexcept {
  if (waker->woken_.exchange(true)) return;
  attempt([&] {  // without memory the connection goes on at its deadline
    waker->inbox_->post([waker] {
      if (const auto go_on = waker->go_on_) go_on();
    });
  });
}

WaitingConnections::WaitingConnections(Loop& loop, const EdgeLimits& limits, Ready ready,
                                       LastWords last_words)
    : loop_(loop), limits_(limits), ready_(std::move(ready)), last_words_(std::move(last_words)) {
  loop_.attach(*this);
}

WaitingConnections::~WaitingConnections() {
  close();
}

// Connections that were posted before the loop's thread gets to this are closed with the others;
// later ones are not let in.
void WaitingConnections::close() {
  loop_.detach(*this);
}

void WaitingConnections::on_detach() noexcept {
  closed_ = true;
  while (!entries_.empty()) leave(entries_.begin()->first);
}

std::shared_ptr<Waker> WaitingConnections::waker() const {
  return std::shared_ptr<Waker>(new Waker(loop_.inbox()));
}

void WaitingConnections::await_head(ConnectionPtr connection, bool fresh) {
  connection->deadline = Clock::now() + (fresh ? limits_.head_deadline : limits_.keep_alive);
  post({std::move(connection), Mode::kIdle, EPOLLIN | EPOLLRDHUP});
}

void WaitingConnections::await(ConnectionPtr connection, For what, Resume resume) {
  const std::uint32_t events = what == For::kBytes ? EPOLLIN | EPOLLRDHUP : EPOLLOUT;
  post({std::move(connection), Mode::kTransfer, events, std::move(resume)});
}

// A parked connection is watched for its end only: what the peer sends meanwhile must not keep the
// thread busy.
void WaitingConnections::park(ConnectionPtr connection, std::shared_ptr<Waker> waker,
                              Resume resume) {
  post({std::move(connection), Mode::kParked, EPOLLRDHUP, std::move(resume), std::move(waker)});
}

void WaitingConnections::linger(ConnectionPtr connection) {
  connection->release_permit();
  connection->shut_down_writing();
  connection->deadline = Clock::now() + limits_.linger;
  post({std::move(connection), Mode::kLinger, EPOLLIN | EPOLLRDHUP});
}

void WaitingConnections::post(Entry entry) {
  loop_.inbox()->post([this, entry = std::move(entry)]() mutable { enter(std::move(entry)); });
}

void WaitingConnections::wake_all() {
  loop_.inbox()->post([this] {
    all_woken_ = true;
    for (auto at = entries_.begin(); at != entries_.end();) {
      const auto& [id, entry] = *at++;  // which takes itself out
      if (entry.mode == Mode::kParked) attempt([&, which = id] { resume(which, End::kWoken); });
    }
  });
}

void WaitingConnections::enter(Entry entry) {
  const bool leaving = entry.mode == Mode::kLinger;
  if (closed_ || (leaving && lingering_ >= kMaxLingering)) return;  // closes it
  const int fd = entry.connection->fd();
  const auto deadline = entry.connection->deadline;
  const Mode mode = entry.mode;
  const Loop::Id id = loop_.add(fd, entry.events, *this);
  try {
    set_deadline(id, entries_[id] = std::move(entry), deadline);
  } catch (const std::bad_alloc&) {
    entries_.erase(id);
    return loop_.remove(id, fd);  // and closes it
  }
  if (leaving) ++lingering_;
  Entry& entered = entries_.at(id);
  if (mode == Mode::kIdle) return read_head(id);  // it may be in the buffer already
  if (mode != Mode::kParked) return;
  entered.waker->go_on_ = [this, id] { resume(id, End::kWoken); };
  if (all_woken_ || entered.waker->woken_) resume(id, End::kWoken);
}

void WaitingConnections::set_deadline(Loop::Id id, Entry& entry, Clock::time_point deadline) {
  deadlines_.erase({entry.deadline, id});
  entry.deadline = deadline;
  deadlines_.emplace(deadline, id);
}

WaitingConnections::Entry WaitingConnections::leave(Loop::Id id) noexcept {
  const auto found = entries_.find(id);
  Entry entry = std::move(found->second);
  entries_.erase(found);
  deadlines_.erase({entry.deadline, id});
  loop_.remove(id, entry.connection->fd());
  if (entry.mode == Mode::kLinger) --lingering_;
  if (entry.waker) entry.waker->go_on_ = nullptr;
  return entry;
}

void WaitingConnections::drop(Loop::Id id) noexcept {
  if (entries_.contains(id)) leave(id);
}

void WaitingConnections::resume(Loop::Id id, End end) {
  const Entry entry = leave(id);
  entry.resume(end);
}

void WaitingConnections::on_events(Loop::Id id, std::uint32_t) {
  const Entry& entry = entries_.at(id);
  switch (entry.mode) {
    case Mode::kIdle:
    case Mode::kHead:
      return read_head(id);
    case Mode::kTransfer:
      return resume(id, End::kReady);
    case Mode::kParked:
      return resume(id, End::kGone);
    case Mode::kLinger:
      if (!entry.connection->discard()) leave(id);
  }
}

void WaitingConnections::read_head(Loop::Id id) {
  Entry& entry = entries_.at(id);
  const auto fill = entry.connection->fill();
  if (fill == Connection::Fill::kMore) {
    if (entry.mode == Mode::kHead || !entry.connection->has_bytes()) return;
    entry.mode = Mode::kHead;
    return set_deadline(id, entry, std::min(entry.deadline, Clock::now() + limits_.head_deadline));
  }
  ConnectionPtr connection = leave(id).connection;
  if (fill == Connection::Fill::kHead) return ready_(std::move(connection));
  if (fill == Connection::Fill::kTooLarge) begin_linger(std::move(connection), "headers_too_large");
}

void WaitingConnections::begin_linger(ConnectionPtr connection, const char* code) {
  connection->write_at_once(last_words_(code));
  linger(std::move(connection));
}

void WaitingConnections::expire(Loop::Id id) {
  const Mode mode = entries_.at(id).mode;
  if (mode == Mode::kTransfer || mode == Mode::kParked) return resume(id, End::kLate);
  ConnectionPtr connection = leave(id).connection;
  if (mode == Mode::kHead) begin_linger(std::move(connection), "request_timeout");
}

Clock::time_point WaitingConnections::next_time() const {
  return deadlines_.empty() ? Clock::time_point::max() : deadlines_.begin()->first;
}

void WaitingConnections::on_time(Clock::time_point now) {
  while (!deadlines_.empty() && deadlines_.begin()->first <= now) {
    const Loop::Id id = deadlines_.begin()->second;
    attempt([&] { expire(id); });
  }
}

}  // namespace kiln::http
