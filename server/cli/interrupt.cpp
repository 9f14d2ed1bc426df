#include "server/cli/interrupt.h"

#include <ctime>

namespace kiln::cli {

Interrupt::Interrupt() {
  ::sigemptyset(&waited_);
  ::sigaddset(&waited_, SIGINT);
  ::sigaddset(&waited_, SIGTERM);
  ::pthread_sigmask(SIG_BLOCK, &waited_, &before_);
  waiter_ = std::jthread([this](const std::stop_token& done) {
    constexpr timespec kLook{0, 100'000'000};  // How soon the end of the object is seen.
    while (!done.stop_requested())
      if (::sigtimedwait(&waited_, nullptr, &kLook) > 0) stop_.request_stop();
  });
}

Interrupt::~Interrupt() {
  waiter_.request_stop();
  waiter_.join();
  ::pthread_sigmask(SIG_SETMASK, &before_, nullptr);
}

}  // namespace kiln::cli
