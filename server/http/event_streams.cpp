#include "server/http/event_streams.h"

#include <sys/epoll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <new>
#include <utility>
#include <vector>

namespace kiln::http {
namespace {

using Clock = Loop::Clock;

constexpr const char* kDraining = "event: server.draining\ndata: {}\n\n";
constexpr std::size_t kServedPerTurn = 64;
constexpr std::uint32_t kEvents = EPOLLIN | EPOLLRDHUP;

void add_chunk(std::string& out, const std::string& text) {
  if (text.empty()) return;
  std::array<char, 24> size{};
  std::snprintf(size.data(), size.size(), "%zx\r\n", text.size());
  out += size.data() + text + "\r\n";
}

}  // namespace

std::string sse_text(const proto::Event& event) {
  std::string text;
  if (event.id > 0) text += "id: " + std::to_string(event.id) + "\n";
  return text + "event: " + event.type + "\ndata: " + event.data + "\n\n";
}

EventStreams::EventStreams(Loop& loop, std::chrono::milliseconds heartbeat,
                           std::chrono::milliseconds stall)
    : loop_(loop), heartbeat_(heartbeat), stall_(stall), next_beat_(Clock::now() + heartbeat) {
  loop_.attach(*this);
}

EventStreams::~EventStreams() {
  stop();
}

void EventStreams::stop() {
  loop_.detach(*this);
}

void EventStreams::adopt(Stream stream) {
  const auto shared = std::make_shared<Stream>(std::move(stream));
  loop_.inbox()->post([this, shared] { welcome(*shared); });
}

void EventStreams::notify(const base::EventRing* ring) {
  {
    const std::lock_guard lock(mutex_);
    const bool first = news_.empty();
    news_.insert(ring);
    if (!first) return;
  }
  loop_.inbox()->post([this] { take_news(); });
}

void EventStreams::announce_draining() {
  loop_.inbox()->post([this] {
    draining_ = true;
    say_all(kDraining);
  });
}

// A stream that begins while the server drains gets the same event as the others.
void EventStreams::welcome(Stream& stream) {
  if (stopped_) return;  // closes it
  const int fd = stream.socket.get();
  const Loop::Id id = loop_.add(fd, kEvents, *this);
  try {
    Client& client = clients_[id];
    client.socket = std::move(stream.socket);
    client.place = std::move(stream.place);
    client.ring = std::move(stream.ring);
    client.sent = stream.after;
    client.progress = Clock::now();
    followers_[client.ring.get()].insert(id);
    client.out = std::move(stream.head);
    add_chunk(client.out, stream.intro + (draining_ ? kDraining : ""));
  } catch (const std::bad_alloc&) {
    if (clients_.contains(id)) return drop(id);
    return loop_.remove(id, fd);
  }
  streams_ = clients_.size();
  serve(id);
}

void EventStreams::take_news() {
  std::set<const base::EventRing*> news;
  {
    const std::lock_guard lock(mutex_);
    news.swap(news_);
  }
  for (const base::EventRing* ring : news) {
    const auto found = followers_.find(ring);
    if (found == followers_.end()) continue;
    for (const Loop::Id id : found->second) follow(id, clients_.at(id));
  }
}

void EventStreams::follow(Loop::Id id, Client& client) {
  if (client.pending || client.waiting)
    return;  // a client that waits for room is served when there is some
  pending_.push_back(id);
  client.pending = true;
}

Clock::time_point EventStreams::next_time() const {
  return pending_.empty() ? next_beat_ : Clock::time_point::min();
}

void EventStreams::on_time(Clock::time_point now) {
  for (std::size_t i = 0; i < kServedPerTurn && !pending_.empty(); ++i) {
    const Loop::Id id = pending_.front();
    pending_.pop_front();
    const auto found = clients_.find(id);
    if (found == clients_.end()) continue;
    found->second.pending = false;
    serve(id);
  }
  if (now < next_beat_) return;
  next_beat_ = now + heartbeat_;
  beat(now);  // when memory is short, some clients get this with the next event or beat
}

void EventStreams::beat(Clock::time_point now) {
  std::vector<Loop::Id> stalled;
  for (const auto& [id, client] : clients_)
    if (client.waiting && now - client.progress > stall_) stalled.push_back(id);
  dropped_ += stalled.size();
  for (const Loop::Id id : stalled) drop(id);
  say_all(": hb\n\n");
}

void EventStreams::say_all(const std::string& text) {
  for (auto& [id, client] : clients_) {
    if (client.ended || client.waiting) continue;  // a client that takes nothing gets no comments
    add_chunk(client.out, text);
    follow(id, client);
  }
}

void EventStreams::on_events(Loop::Id id, std::uint32_t events) {
  if (events & (EPOLLRDHUP | EPOLLHUP | EPOLLERR)) return drop(id);
  if (events & EPOLLIN) {  // a stream's client has nothing to say: bytes are thrown away
    std::array<char, 512> bytes;
    const int fd = clients_.at(id).socket.get();
    const ssize_t got = ::recv(fd, bytes.data(), bytes.size(), MSG_DONTWAIT);
    if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR)) return drop(id);
  }
  if (events & EPOLLOUT) serve(id);
}

// Feeds and flushes until the socket is full or nothing is left.
void EventStreams::serve(Loop::Id id) {
  while (clients_.contains(id)) {
    Client& client = clients_.at(id);
    bool fed = false;
    try {
      fed = feed(client);
    } catch (const std::bad_alloc&) {  // it may resume, by the id of its last event
    }
    if (!fed) {
      ++dropped_;
      return drop(id);
    }
    const bool last = client.out.empty();
    flush(id);
    if (last || !clients_.contains(id) || client.waiting) return;
  }
}

bool EventStreams::feed(Client& client) {
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

void EventStreams::flush(Loop::Id id) {
  Client& client = clients_.at(id);
  const int fd = client.socket.get();
  while (client.at < client.out.size()) {
    const ssize_t sent = ::send(fd, client.out.data() + client.at, client.out.size() - client.at,
                                MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent < 0 && errno == EINTR) continue;
    if (sent < 0 && errno != EAGAIN && errno != EWOULDBLOCK) return drop(id);
    if (sent < 0) break;
    client.at += static_cast<std::size_t>(sent);
    client.progress = Clock::now();
  }
  if (client.at == client.out.size()) {
    client.out.clear();
    client.at = 0;
    if (client.ended) return drop(id);
  }
  const bool waiting = !client.out.empty();
  if (waiting == client.waiting) return;
  client.waiting = waiting;
  loop_.modify(id, fd, kEvents | (waiting ? static_cast<std::uint32_t>(EPOLLOUT) : 0u));
}

void EventStreams::drop(Loop::Id id) noexcept {
  const auto found = clients_.find(id);
  if (found == clients_.end()) return;
  const auto ring = followers_.find(found->second.ring.get());
  if (ring != followers_.end()) {
    ring->second.erase(id);
    if (ring->second.empty()) followers_.erase(ring);
  }
  const int fd = found->second.socket.get();
  loop_.remove(id, fd);
  ::shutdown(fd, SHUT_WR);
  clients_.erase(found);
  streams_ = clients_.size();
}

// Every stream gets what is ready for it, and its end.
void EventStreams::on_detach() noexcept {
  stopped_ = true;
  while (!clients_.empty()) {
    const Loop::Id id = clients_.begin()->first;
    Client& client = clients_.begin()->second;
    try {
      if (feed(client) && !std::exchange(client.ended, true)) client.out += "0\r\n\r\n";
    } catch (const std::bad_alloc&) {
    }
    flush(id);
    drop(id);
  }
  pending_.clear();
}

}  // namespace kiln::http
