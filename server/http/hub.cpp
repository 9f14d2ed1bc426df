#include "server/http/hub.h"

#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <new>
#include <system_error>

namespace kiln::http {
namespace {

using Clock = std::chrono::steady_clock;

constexpr const char* kDraining = "event: server.draining\ndata: {}\n\n";

void add_chunk(std::string& out, const std::string& text) {
  if (text.empty()) return;
  std::array<char, 24> size{};
  std::snprintf(size.data(), size.size(), "%zx\r\n", text.size());
  out += size.data() + text + "\r\n";
}

void watch(int epoll, int fd, int operation, std::uint32_t events) {
  epoll_event event{};
  event.events = events;
  event.data.fd = fd;
  ::epoll_ctl(epoll, operation, fd, &event);
}

}  // namespace

std::string sse_text(const proto::Event& event) {
  std::string text;
  if (event.id > 0) text += "id: " + std::to_string(event.id) + "\n";
  return text + "event: " + event.type + "\ndata: " + event.data + "\n\n";
}

Hub::Hub(std::chrono::milliseconds heartbeat, std::chrono::milliseconds stall)
    : heartbeat_(heartbeat),
      stall_(stall),
      epoll_(::epoll_create1(EPOLL_CLOEXEC)),
      wake_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
  if (!epoll_.valid() || !wake_.valid())
    throw std::system_error(errno, std::system_category(), "epoll");
  watch(epoll_.get(), wake_.get(), EPOLL_CTL_ADD, EPOLLIN);
  thread_ = std::thread([this] { loop(); });
}

Hub::~Hub() {
  stop();
}

void Hub::stop() {
  stopping_ = true;
  wake();
  if (thread_.joinable()) thread_.join();
}

void Hub::wake() const {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t full_is_fine = ::write(wake_.get(), &one, sizeof one);
}

void Hub::adopt(Stream stream) {
  {
    const std::lock_guard lock(mutex_);
    arrivals_.push_back(std::move(stream));
  }
  wake();
}

void Hub::notify(const base::EventRing* ring) {
  bool first = false;
  {
    const std::lock_guard lock(mutex_);
    first = news_.empty();
    news_.insert(ring);
  }
  if (first) wake();
}

void Hub::announce_draining() {
  {
    const std::lock_guard lock(mutex_);
    announce_ = true;
  }
  wake();
}

void Hub::loop() {
  std::array<epoll_event, 256> events{};
  auto next_beat = Clock::now() + heartbeat_;
  while (!stopping_) {
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(next_beat - Clock::now()).count();
    const int timeout = static_cast<int>(std::clamp<std::int64_t>(left, 0, 60'000));
    const int n = ::epoll_wait(epoll_.get(), events.data(), events.size(), timeout);
    for (int i = 0; i < n; ++i) {
      const auto& event = events[static_cast<std::size_t>(i)];
      on_socket(event.data.fd, event.events);
    }
    const bool due = Clock::now() >= next_beat;
    if (due) next_beat = Clock::now() + heartbeat_;
    try {
      take_requests();
      if (due) beat();
    } catch (const std::bad_alloc&) {  // some clients hear of this with the next event or beat
    }
  }
  end_all();
}

void Hub::on_socket(int fd, std::uint32_t events) {
  if (fd == wake_.get()) {
    std::uint64_t count = 0;
    [[maybe_unused]] const ssize_t got = ::read(fd, &count, sizeof count);
    return;
  }
  if (!clients_.contains(fd)) return;
  if (events & (EPOLLRDHUP | EPOLLHUP | EPOLLERR)) return drop(fd);
  if (events & EPOLLIN) {  // a stream's client has nothing to say: bytes are thrown away
    std::array<char, 512> bytes;
    const ssize_t got = ::recv(fd, bytes.data(), bytes.size(), MSG_DONTWAIT);
    if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR)) return drop(fd);
  }
  if (events & EPOLLOUT) serve(fd);
}

void Hub::beat() {
  std::vector<int> stalled;
  for (const auto& [fd, client] : clients_)
    if (client.waiting && Clock::now() - client.progress > stall_) stalled.push_back(fd);
  dropped_ += stalled.size();
  for (const int fd : stalled) drop(fd);
  say_all(": hb\n\n");
}

// Feeds and flushes until the socket is full or nothing is left.
void Hub::serve(int fd) {
  while (clients_.contains(fd)) {
    Client& client = clients_.at(fd);
    bool fed = false;
    try {
      fed = feed(client);
    } catch (const std::bad_alloc&) {  // it may resume, by the id of its last event
    }
    if (!fed) {
      ++dropped_;
      return drop(fd);
    }
    if (client.out.empty()) return flush(fd);
    flush(fd);
    if (!clients_.contains(fd) || client.waiting) return;
  }
}

// A stream that begins while the server drains hears of it like the others.
void Hub::welcome(Stream stream) {
  const int fd = stream.socket.get();
  followers_[stream.ring.get()].insert(fd);
  watch(epoll_.get(), fd, EPOLL_CTL_ADD, EPOLLIN | EPOLLRDHUP);
  Client& client = clients_[fd];
  client.socket = std::move(stream.socket);
  client.place = std::move(stream.place);
  client.ring = std::move(stream.ring);
  client.sent = stream.after;
  add_chunk(client.out, stream.intro + (draining_ ? kDraining : ""));
  client.progress = Clock::now();
  streams_ = clients_.size();
  serve(fd);
}

void Hub::take_requests() {
  std::vector<Stream> arrivals;
  std::set<const base::EventRing*> news;
  bool announce = false;
  {
    const std::lock_guard lock(mutex_);
    arrivals.swap(arrivals_);
    news.swap(news_);
    std::swap(announce, announce_);
  }
  for (auto& stream : arrivals) welcome(std::move(stream));
  for (const base::EventRing* ring : news) {
    const auto found = followers_.find(ring);
    if (found == followers_.end()) continue;
    const std::set<int> fds = found->second;  // serving may drop some
    for (const int fd : fds) serve(fd);
  }
  if (!announce) return;
  draining_ = true;
  say_all(kDraining);
}

bool Hub::feed(Client& client) {
  while (!client.ended && client.out.size() - client.at < kFeed) {
    const base::EventRing::Tail tail = client.ring->after(client.sent, 32);
    if (!tail.complete) return false;
    std::string text;
    for (const auto& event : tail.events) {
      text += sse_text(event);
      client.sent = event.id;
    }
    add_chunk(client.out, text);
    if (tail.ended) {
      client.out += "0\r\n\r\n";
      client.ended = true;
    }
    if (tail.events.empty()) break;
  }
  return true;
}

void Hub::say_all(const std::string& text) {
  std::vector<int> fds;
  for (auto& [fd, client] : clients_) {
    if (client.ended || client.waiting) continue;  // no comments for one who doesn't listen
    add_chunk(client.out, text);
    fds.push_back(fd);
  }
  for (const int fd : fds) flush(fd);
}

void Hub::flush(int fd) {
  Client& client = clients_.at(fd);
  while (client.at < client.out.size()) {
    const ssize_t sent = ::send(fd, client.out.data() + client.at, client.out.size() - client.at,
                                MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent < 0 && errno == EINTR) continue;
    if (sent < 0 && errno != EAGAIN && errno != EWOULDBLOCK) return drop(fd);
    if (sent < 0) break;
    client.at += static_cast<std::size_t>(sent);
    client.progress = Clock::now();
  }
  if (client.at == client.out.size()) {
    client.out.clear();
    client.at = 0;
    if (client.ended) return drop(fd);
  }
  const bool waiting = !client.out.empty();
  if (waiting == client.waiting) return;
  client.waiting = waiting;
  const std::uint32_t out = waiting ? static_cast<std::uint32_t>(EPOLLOUT) : 0u;
  watch(epoll_.get(), fd, EPOLL_CTL_MOD, EPOLLIN | EPOLLRDHUP | out);
}

void Hub::drop(int fd) {
  const auto found = clients_.find(fd);
  const auto ring = followers_.find(found->second.ring.get());
  ring->second.erase(fd);
  if (ring->second.empty()) followers_.erase(ring);
  ::epoll_ctl(epoll_.get(), EPOLL_CTL_DEL, fd, nullptr);
  ::shutdown(fd, SHUT_WR);
  clients_.erase(found);
  streams_ = clients_.size();
}

void Hub::end_all() {
  take_requests();
  for (auto& [fd, client] : clients_) {
    if (!client.ended) client.out += "0\r\n\r\n";
    client.ended = true;
  }
  while (!clients_.empty()) {
    const int fd = clients_.begin()->first;
    flush(fd);
    if (clients_.contains(fd)) drop(fd);
  }
}

}  // namespace kiln::http
