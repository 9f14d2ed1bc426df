#include "tests/http/receiver.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>

#include "tests/http/live.h"

namespace kiln::test {

Receiver::Receiver(std::vector<std::string> answers)
    : answers_(std::move(answers)), listener_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  if (::bind(listener_, reinterpret_cast<const sockaddr*>(&address), size) != 0 ||
      ::listen(listener_, 64) != 0 ||
      ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size) != 0)
    throw std::runtime_error("the receiver can't listen");
  port_ = ntohs(address.sin_port);
  thread_ = std::thread([this] { loop(); });
}

Receiver::~Receiver() {
  ::shutdown(listener_, SHUT_RDWR);
  thread_.join();
  ::close(listener_);
  for (const int fd : held_) ::close(fd);
}

void Receiver::loop() {
  for (int fd = 0; (fd = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC)) >= 0;) take(fd);
}

void Receiver::take(int fd) {
  std::string text;
  const auto more = [&] {
    char piece[65536];
    const ssize_t got = ::recv(fd, piece, sizeof piece, 0);
    if (got > 0) text.append(piece, static_cast<std::size_t>(got));
    return got > 0;
  };
  while (text.find("\r\n\r\n") == std::string::npos && more()) {
  }
  const auto end = text.find("\r\n\r\n");
  Message message;
  Answer head;  // its reader wants a status line
  if (end == std::string::npos || !read_head("HTTP/1.1 200" + text.substr(text.find("\r\n")), head))
    return void(::close(fd));
  message.request_line = text.substr(0, text.find("\r\n"));
  message.headers = head.headers;
  const std::size_t length = std::stoul("0" + message.header("content-length"));
  while (text.size() < end + 4 + length && more()) {
  }
  message.body = text.substr(end + 4);
  std::string answer;
  {
    const std::lock_guard lock(mutex_);
    answer = answers_.at(std::min(messages_.size(), answers_.size() - 1));
    messages_.push_back(std::move(message));
  }
  changed_.notify_all();
  if (answer.empty()) return held_.push_back(fd);
  ::send(fd, answer.data(), answer.size(), MSG_NOSIGNAL);
  ::close(fd);
}

std::vector<Receiver::Message> Receiver::wait(std::size_t count, std::chrono::milliseconds time) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, time, [&] { return messages_.size() >= count; });
  return messages_;
}

}  // namespace kiln::test
