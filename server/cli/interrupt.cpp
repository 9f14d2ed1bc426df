#include "server/cli/interrupt.h"

namespace kiln::cli {

Interrupt::Interrupt() {
  ::sigemptyset(&waited_);
  ::sigaddset(&waited_, SIGINT);
  ::sigaddset(&waited_, SIGTERM);
  ::pthread_sigmask(SIG_BLOCK, &waited_, &before_);
  waiter_ = std::jthread([this](const std::stop_token& done) {
    int signal = 0;
    while (!done.stop_requested())
      if (::sigwait(&waited_, &signal) == 0 && !done.stop_requested()) stop_.request_stop();
  });
}

Interrupt::~Interrupt() {
  waiter_.request_stop();
  // The signal goes to that thread alone, which blocks it, so it ends the wait and nothing else.
  ::pthread_kill(waiter_.native_handle(), SIGTERM);
  waiter_.join();
  ::pthread_sigmask(SIG_SETMASK, &before_, nullptr);
}

}  // namespace kiln::cli
