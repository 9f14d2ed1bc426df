#pragma once

#include <csignal>
#include <stop_token>
#include <thread>

namespace kiln::cli {

/// While an object lives, SIGINT and SIGTERM request a stop instead of ending the process. Make it
/// before other threads start, so that they inherit the mask that reserves the signals for it.
class Interrupt {
 public:
  Interrupt();
  ~Interrupt();
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  std::stop_token token() const { return stop_.get_token(); }

 private:
  sigset_t before_{}, waited_{};
  std::stop_source stop_;
  std::jthread waiter_;
};

}  // namespace kiln::cli
