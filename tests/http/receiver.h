#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace kiln::test {

/// A webhook's receiver on loopback. Answers each request with the next of its answers, the last
/// one again and again.
class Receiver {
 public:
  struct Message {
    std::string request_line, body;
    std::map<std::string, std::string> headers;  ///< names in lower case
    std::string header(const std::string& name) const {
      const auto found = headers.find(name);
      return found == headers.end() ? "" : found->second;
    }
  };

  /// Whole answers, as bytes; "" holds the connection open without one.
  explicit Receiver(std::vector<std::string> answers = {kTaken});
  ~Receiver();
  Receiver(const Receiver&) = delete;
  Receiver& operator=(const Receiver&) = delete;

  std::string url(const std::string& path = "/hook") const {
    return "http://127.0.0.1:" + std::to_string(port_) + path;
  }
  std::uint16_t port() const { return port_; }
  /// Waits until `count` messages have come; those that have.
  std::vector<Message> wait(std::size_t count,
                            std::chrono::milliseconds time = std::chrono::seconds(20));

  static constexpr const char* kTaken = "HTTP/1.1 204 No Content\r\nConnection: close\r\n\r\n";
  static constexpr const char* kFailed =
      "HTTP/1.1 500 Oops\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";

 private:
  void loop();
  void take(int fd);

  std::vector<std::string> answers_;
  int listener_ = -1;
  std::uint16_t port_ = 0;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Message> messages_;  ///< guarded by mutex_
  std::vector<int> held_;          ///< the thread's only
  std::thread thread_;
};

}  // namespace kiln::test
