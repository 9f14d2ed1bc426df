#include "tests/http/event_stream.h"

#include <algorithm>

namespace kiln::test {

namespace {

std::vector<std::string> resume_header(const std::string& last) {
  return last.empty() ? std::vector<std::string>{}
                      : std::vector<std::string>{"Last-Event-ID: " + last};
}

}  // namespace

EventStream::EventStream(std::uint16_t port, const std::string& id, const std::string& last)
    : EventStream(port, "/v1/jobs/" + id + "/events", resume_header(last)) {}

EventStream::EventStream(std::uint16_t port, const std::string& path,
                         const std::vector<std::string>& headers)
    : wire_(port) {
  std::string head = "GET " + path + " HTTP/1.1\r\nHost: test\r\n";
  for (const auto& header : headers) head += header + "\r\n";
  wire_.send(head + "\r\n");
  const std::string text = wire_.read("\r\n\r\n", std::chrono::seconds(20));
  if (text.starts_with("HTTP/1.1 ")) status_ = std::stoi(text.substr(9, 3));
  if (const auto end = text.find("\r\n\r\n"); end != std::string::npos)
    bytes_ = text.substr(end + 4);
  take_chunks();
}

void EventStream::take_chunks() {
  for (;;) {
    const auto line = bytes_.find("\r\n");
    if (line == std::string::npos || ended_) return;
    const std::size_t size = std::stoul(bytes_.substr(0, line), nullptr, 16);
    if (bytes_.size() < line + 2 + size + 2) return;
    ended_ = size == 0;
    parser_.feed(std::string_view(bytes_).substr(line + 2, size), [&](const proto::Event& event) {
      events_.push_back(event);
      return true;
    });
    bytes_.erase(0, line + 2 + size + 2);
  }
}

bool EventStream::read_until(const std::function<bool()>& done, std::chrono::milliseconds time) {
  const auto deadline = std::chrono::steady_clock::now() + time;
  while (!done() && !ended_) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
        deadline - std::chrono::steady_clock::now());
    const std::string piece = left.count() > 0 ? wire_.read("\n", left) : "";
    if (piece.empty()) break;  // closed, or too late
    bytes_ += piece;
    take_chunks();
  }
  return done();
}

bool EventStream::wait_for(const std::string& type, std::chrono::milliseconds time) {
  return read_until([&] { return count(type) > 0; }, time);
}

bool EventStream::wait_first(std::chrono::milliseconds time) {
  return read_until([&] { return !events_.empty(); }, time);
}

bool EventStream::wait_next(std::chrono::milliseconds time) {
  return read_until([&, before = events_.size()] { return events_.size() > before; }, time);
}

bool EventStream::wait_end(std::chrono::milliseconds time) {
  return read_until([&] { return ended_; }, time);
}

std::vector<std::uint64_t> EventStream::ids() const {
  std::vector<std::uint64_t> ids;
  for (const auto& event : events_)
    if (event.id > 0) ids.push_back(event.id);
  return ids;
}

std::size_t EventStream::count(const std::string& type) const {
  return static_cast<std::size_t>(
      std::count_if(events_.begin(), events_.end(), [&](const auto& e) { return e.type == type; }));
}

}  // namespace kiln::test
