#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "server/http/message.h"

namespace kiln::api {

/// Does work that answers wait for, some pieces at a time, on threads of its own; the others wait
/// in line. Thread-safe.
class Desk {
 public:
  /// @param at_once pieces of work
  /// @param in_line the most that wait
  Desk(std::size_t at_once, std::size_t in_line) : at_once_(at_once), in_line_(in_line) {}
  Desk(const Desk&) = delete;
  Desk& operator=(const Desk&) = delete;

  /// Returns whether the line has room for one more.
  bool has_room();

  using Work = std::function<void(std::stop_token)>;
  using Answer = std::function<http::Response(http::Request&)>;
  /// Returns the response whose connection waits for the work and then answers. The work is stopped
  /// when the client leaves, when the service ends, and after `patience`: then the answer is
  /// `overloaded` with the text `late`. What the work throws, the request throws.
  http::Response answer(Work, Answer, std::chrono::seconds patience, std::string late);

 private:
  struct Order;
  void put(std::shared_ptr<Order>, std::function<void()> done);
  void work(const std::stop_token&);

  const std::size_t at_once_, in_line_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<std::shared_ptr<Order>> line_;
  std::vector<std::jthread> threads_;  ///< begun with the first order; the last to be made
};

}  // namespace kiln::api
